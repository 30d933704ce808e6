//! New checksums for rows that a test has changed.

use std::path::Path;

use rusqlite::Connection;
use rusqlite::types::{Value, ValueRef};

use crate::store::results::columns::{Column, names};
use crate::store::results::integrity::{ACTIONS_CHECKSUM, checksum, sealed_actions};
use crate::store::results::schema;

/// Writes the checksums of all rows anew.
///
/// # Errors
/// If the file cannot be read or written.
pub(crate) fn seal(path: &Path) -> Result<(), rusqlite::Error> {
    let mut connection = Connection::open(path)?;
    connection.execute_batch("PRAGMA journal_mode = MEMORY; PRAGMA synchronous = OFF;")?;
    let transaction = connection.transaction()?;
    let rows: Vec<(Vec<Value>, Option<Vec<u8>>)> = transaction
        .prepare(&format!("SELECT {} FROM episodes", names(Column::ALL)))?
        .query_map([], |row| {
            let values =
                Column::checked().iter().map(|column| row.get(*column as usize)).collect::<Result<_, _>>()?;
            Ok((values, row.get(Column::Actions as usize)?))
        })?
        .collect::<Result<_, _>>()?;
    for (values, actions) in rows {
        let seed =
            if let Value::Integer(seed) = values[Column::Seed as usize] { seed.cast_unsigned() } else { 0 };
        let actions = actions.map(|mut actions| {
            actions.truncate(actions.len().saturating_sub(ACTIONS_CHECKSUM));
            sealed_actions(actions, seed)
        });
        let checksum = checksum(values.iter().map(ValueRef::from));
        let update = format!(
            "UPDATE episodes SET {} = ?5, {} = ?6 WHERE {}",
            Column::Checksum.name(),
            Column::Actions.name(),
            schema::is_episode()
        );
        let [policy, task, perturbation, episode] = Column::KEY.map(|column| &values[column as usize]);
        let key = rusqlite::params![policy, task, perturbation, episode, checksum, actions];
        transaction.prepare_cached(&update)?.execute(key)?;
    }
    transaction.commit()
}
