//! New checksums for rows that a test has changed.

use std::path::Path;

use rusqlite::Connection;
use rusqlite::types::{Value, ValueRef};

use crate::store::results::integrity::{ACTIONS_CHECKSUM, checksum, sealed_actions};
use crate::store::results::schema;

/// Selects all episodes with their actions.
const SELECT: &str = "
    SELECT policy, task, perturbation, episode, seed, steps, success_once, success_at_end,
        first_success_step, failed_predicate, fingerprint, error, physics_s, render_s, policy_s, wait_s,
        actions
    FROM episodes";

/// Writes checksums.
const UPDATE: &str = "
    UPDATE episodes SET checksum = ?1, actions = ?2
    WHERE policy = ?3 AND task = ?4 AND perturbation = ?5 AND episode = ?6";

/// Writes the checksums of all rows anew.
///
/// # Errors
/// If the file cannot be read or written.
pub(crate) fn seal(path: &Path) -> Result<(), rusqlite::Error> {
    let mut connection = Connection::open(path)?;
    connection.execute_batch("PRAGMA journal_mode = MEMORY; PRAGMA synchronous = OFF;")?;
    let transaction = connection.transaction()?;
    let rows: Vec<(Vec<Value>, Option<Vec<u8>>)> = transaction
        .prepare(SELECT)?
        .query_map([], |row| {
            let values = (0..schema::N_CHECKED).map(|idx| row.get(idx)).collect::<Result<_, _>>()?;
            Ok((values, row.get(schema::N_CHECKED)?))
        })?
        .collect::<Result<_, _>>()?;
    for (values, actions) in rows {
        let seed = if let Value::Integer(seed) = values[4] { seed.cast_unsigned() } else { 0 };
        let actions = actions.map(|mut actions| {
            actions.truncate(actions.len().saturating_sub(ACTIONS_CHECKSUM));
            sealed_actions(actions, seed)
        });
        let checksum = checksum(values.iter().map(ValueRef::from));
        let [policy, task, perturbation, episode] = [&values[0], &values[1], &values[2], &values[3]];
        let key = rusqlite::params![checksum, actions, policy, task, perturbation, episode];
        transaction.prepare_cached(UPDATE)?.execute(key)?;
    }
    transaction.commit()
}
