//! Checks that a results file is one that a run wrote and that nobody has changed since: its tables, the
//! values of its rows, and their checksums.

use std::path::Path;

use rusqlite::types::ValueRef;
use rusqlite::{Connection, Row};
use xxhash_rust::xxh3::{Xxh3, xxh3_64_with_seed};

use crate::selection::condition::parse_condition;
use crate::selection::policy::is_plain;
use crate::store::results::columns::{Column, Values};
use crate::store::results::error::{ResultsFileError, not_used};
use crate::store::results::schema;

/// Bytes of the checksum at the end of stored actions.
pub(crate) const ACTIONS_CHECKSUM: usize = 8;
/// Longest time of an episode in s.
const MAX_SECONDS: f64 = 1e9;

/// Checks that the file has our tables, and nothing else: a view or a trigger would run somebody's code
/// whenever the file is read or written.
pub(crate) fn check_schema(connection: &Connection, path: &Path) -> Result<(), ResultsFileError> {
    let expected = Connection::open_in_memory().and_then(|own| {
        own.execute_batch(&schema::create())?;
        objects(&own)
    });
    let expected = expected.map_err(|error| not_used(path, error))?;
    let found = objects(connection).map_err(|error| not_used(path, error))?;
    let foreign = found.iter().find(|object| !expected.contains(object));
    let finding = match foreign {
        Some((kind, name, _)) => format!("it contains the {kind} `{name}`, which no run writes"),
        None => match expected.iter().find(|object| !found.contains(object)) {
            Some((kind, name, _)) => format!("its {kind} `{name}` is missing"),
            None => return Ok(()),
        },
    };
    Err(ResultsFileError::Changed { path: path.into(), finding })
}

/// Returns type, name and definition of everything in a database.
fn objects(connection: &Connection) -> Result<Vec<(String, String, Option<String>)>, rusqlite::Error> {
    let mut statement = connection.prepare("SELECT type, name, sql FROM sqlite_schema")?;
    statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)))?.collect()
}

/// Checks the values and the checksum of every row.
pub(crate) fn check_rows(connection: &Connection, path: &Path) -> Result<(), ResultsFileError> {
    let read = || {
        let mut statement = connection.prepare(&schema::rows())?;
        let mut rows = statement.query([])?;
        // Rows are sorted by condition, so the names of one condition are checked once.
        let mut names = <[String; 3]>::default();
        while let Some(row) = rows.next()? {
            if let Some(finding) = row_finding(row, &mut names)? {
                return Ok(Some(finding));
            }
        }
        Ok(None)
    };
    match read().map_err(|error| not_used(path, error))? {
        None => Ok(()),
        Some(finding) => Err(ResultsFileError::Changed { path: path.into(), finding }),
    }
}

/// Returns what is wrong with a row, which has all columns up to the checksum. `names` are those of the last
/// row without a finding.
pub(crate) fn row_finding(row: &Row<'_>, names: &mut [String; 3]) -> Result<Option<String>, rusqlite::Error> {
    let key = |idx| row.get_ref(idx).map_or_else(|_| String::new(), shown);
    let with_key =
        |finding| format!("episode {} of {} on {} under {}: {finding}", key(3), key(0), key(1), key(2));
    Ok(value_finding(row, names)?.map(with_key))
}

fn value_finding(row: &Row<'_>, names: &mut [String; 3]) -> Result<Option<String>, rusqlite::Error> {
    let text = |idx: usize| row.get_ref(idx).map(|value| value.as_str().unwrap_or_default());
    let found = [text(0)?, text(1)?, text(2)?];
    if found.iter().ne(names.iter()) {
        if !is_plain(found[0]) {
            return Ok(Some("`policy` is not the name of a policy".to_owned()));
        }
        if let Err(error) = parse_condition(found[1], found[2]) {
            return Ok(Some(error.to_string()));
        }
        *names = found.map(str::to_owned);
    }
    for column in Column::checked() {
        let (name, value) = (column.name(), row.get_ref(*column as usize)?);
        let expected = match (column.values(), value) {
            (Values::UpTo(high) | Values::UpToOrNull(high), ValueRef::Integer(number))
                if (0..=high).contains(&number) =>
            {
                continue;
            }
            (Values::UpToOrNull(_), ValueRef::Null) | (Values::Text | Values::Sealed, _) => continue,
            (Values::Seconds, ValueRef::Real(seconds)) if (0.0..=MAX_SECONDS).contains(&seconds) => continue,
            (Values::UpTo(high) | Values::UpToOrNull(high), _) => {
                format!("{}, expected 0 to {high}", shown(value))
            }
            (Values::Seconds, _) => format!("{} s, expected 0 to {MAX_SECONDS}", shown(value)),
        };
        return Ok(Some(format!("`{name}` is {expected}")));
    }
    let values = Column::checked()
        .iter()
        .map(|column| row.get_ref(*column as usize))
        .collect::<Result<Vec<_>, _>>()?;
    let is_intact = row.get_ref(Column::Checksum as usize)? == ValueRef::Integer(checksum(values));
    Ok((!is_intact)
        .then(|| "its checksum does not fit its values, so that they have been changed".to_owned()))
}

/// Formats a value for people.
pub(crate) fn shown(value: ValueRef<'_>) -> String {
    match value {
        ValueRef::Null => "empty".to_owned(),
        ValueRef::Integer(number) => number.to_string(),
        ValueRef::Real(number) => number.to_string(),
        ValueRef::Text(text) => format!("`{}`", String::from_utf8_lossy(text)),
        ValueRef::Blob(bytes) => format!("{} bytes", bytes.len()),
    }
}

/// Returns the checksum of a row: XXH3 over its values from `policy` to `wait_s`, each as a byte for its type
/// (0 NULL, 1 integer, 2 real, 3 text) and its content, 8 little-endian bytes for a number, length and bytes
/// for a text.
pub(crate) fn checksum<'a>(values: impl IntoIterator<Item = ValueRef<'a>>) -> i64 {
    let mut hash = Xxh3::new();
    for value in values {
        match value {
            ValueRef::Null => hash.update(&[0]),
            ValueRef::Integer(number) => {
                hash.update(&[1]);
                hash.update(&number.to_le_bytes());
            }
            ValueRef::Real(number) => {
                hash.update(&[2]);
                hash.update(&number.to_le_bytes());
            }
            ValueRef::Text(text) | ValueRef::Blob(text) => {
                hash.update(&[3]);
                hash.update(&(text.len() as u64).to_le_bytes());
                hash.update(text);
            }
        }
    }
    hash.digest().cast_signed()
}

/// Appends the checksum of actions, which depends on the episode whose actions they are.
pub(crate) fn sealed_actions(mut actions: Vec<u8>, seed: u64) -> Vec<u8> {
    let checksum = xxh3_64_with_seed(&actions, seed);
    actions.extend(checksum.to_le_bytes());
    actions
}

/// Returns the actions without their checksum; `None` if it does not fit.
pub(crate) fn opened_actions(sealed: &[u8], seed: u64) -> Option<&[u8]> {
    let (actions, checksum) = sealed.split_at_checked(sealed.len().checked_sub(ACTIONS_CHECKSUM)?)?;
    (xxh3_64_with_seed(actions, seed).to_le_bytes() == *checksum).then_some(actions)
}
