//! Copies of results files with nothing in them that another run of the same episodes would not have.

use std::path::Path;

use rusqlite::types::{Value, ValueRef};
use rusqlite::{Connection, params_from_iter};
use serde_json::json;

use crate::store::results::{
    Column, ENVIRONMENT, PLANS, SHARD, StoredPlan, checksum, create_for_bulk, insert, manifest_entries,
    not_used, not_written, open_unchecked, put_text, whole_rows,
};

/// Copies a results file without times and circumstances: two files with the same episodes and settings have
/// copies with the same bytes, on whichever machines they were made, and in how many runs.
///
/// # Errors
/// If the file cannot be read, or the copy cannot be written.
pub(crate) fn copy_without_times(path: &Path, copy: &Path) -> anyhow::Result<()> {
    let (source, _lock) = open_unchecked(path)?;
    let target = create_for_bulk(copy)?;
    let entries = manifest_entries(&source).map_err(|error| not_used(path, error))?;
    let is_shard = entries.iter().any(|(key, _)| key == SHARD);
    let write = || {
        target.execute_batch("BEGIN")?;
        for (key, text) in entries.iter().filter(|(key, _)| key != ENVIRONMENT) {
            // The parts of a shard refer to its plan.
            let plans = (key == PLANS && !is_shard).then(|| largest_plans(text)).flatten();
            put_text(&target, key, plans.as_deref().unwrap_or(text))?;
        }
        copy_rows(&source, &target)?;
        target.execute_batch("COMMIT")
    };
    write().map_err(|error| not_written(copy, error))?;
    target.close().map_err(|(_, error)| not_written(copy, error))?;
    Ok(())
}

fn copy_rows(source: &Connection, target: &Connection) -> Result<(), rusqlite::Error> {
    let mut statement = source.prepare(&whole_rows())?;
    let mut insertion = target.prepare(&insert())?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let mut values = Vec::with_capacity(Column::ALL.len());
        for column in Column::ALL {
            let time = Column::TIMES.contains(column).then_some(Value::Real(0.0));
            values.push(time.map_or_else(|| row.get(*column as usize), Ok)?);
        }
        let checked = &values[..Column::checked().len()];
        values[Column::Checksum as usize] = checksum(checked.iter().map(ValueRef::from)).into();
        insertion.execute(params_from_iter(values))?;
    }
    Ok(())
}

/// Returns stored plans without those that another one contains; `None` if the text is something else.
fn largest_plans(text: &str) -> Option<String> {
    let plans: Vec<StoredPlan> = serde_json::from_str(text).ok()?;
    let is_largest = |plan: &&StoredPlan| !plans.iter().any(|other| other != *plan && other.contains(plan));
    Some(json!(plans.iter().filter(is_largest).collect::<Vec<_>>()).to_string())
}
