//! Results files.

use std::path::Path;
use std::sync::LazyLock;

use orchestrator::fuzzing::{read_results, write_results};
use rusqlite::types::Value as Cell;
use rusqlite::{Connection, params};

use super::edits::Edits;
use super::refused;

/// A valid results file.
pub(crate) static SAMPLE: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sample.db");
    write_results(&path);
    std::fs::read(path).unwrap()
});
/// Columns of the table `episodes`.
const COLUMNS: [&str; 17] = [
    "policy",
    "task",
    "perturbation",
    "episode",
    "seed",
    "steps",
    "success_once",
    "success_at_end",
    "first_success_step",
    "failed_predicate",
    "fingerprint",
    "error",
    "physics_s",
    "render_s",
    "policy_s",
    "wait_s",
    "actions",
];
const TEXTS: [&str; 8] =
    ["", "RaiseCube", "MO-Color", "All", "../../escape", "<script>\u{1b}[2J\n\"&", "ffffffffffffffff", "∞,é"];

/// Settings for files that need not survive a crash.
const NO_SYNC: &str = "PRAGMA journal_mode = MEMORY; PRAGMA synchronous = OFF;";
/// Changes of the tables, which no run makes.
const SCHEMAS: [&str; 5] = [
    "ALTER TABLE episodes RENAME TO other; CREATE VIEW episodes AS SELECT * FROM other",
    "CREATE TRIGGER t AFTER INSERT ON episodes BEGIN DELETE FROM episodes; END",
    "CREATE VIEW v AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n",
    "CREATE INDEX i ON episodes (upper(error))",
    "DROP TABLE manifest",
];

/// Reads a results file with other bytes, or with other values.
///
/// # Panics
/// If an error is unclear, or a file that was read cannot be analysed.
pub fn run(data: &[u8]) -> bool {
    let mut edits = Edits::new(data);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.db");
    let output = folder.path().join("output");
    std::fs::create_dir(&output).unwrap();
    let mut bytes = SAMPLE.clone();
    if edits.below(4) == 1 {
        edits.bytes(&mut bytes);
        std::fs::write(&path, bytes).unwrap();
    } else {
        std::fs::write(&path, bytes).unwrap();
        if edits.below(16) == 1 {
            let connection = Connection::open(&path).unwrap();
            connection.execute_batch(NO_SYNC).unwrap();
            connection.execute_batch(edits.word(&SCHEMAS)).unwrap();
        } else {
            edit_values(&mut edits, &path).unwrap();
            orchestrator::fuzzing::seal_results(&path);
        }
    }
    match read_results(&path, &output) {
        Ok(n_episodes) => n_episodes > 0,
        Err(message) => refused(&message, &path),
    }
}

/// Changes values by SQL. A change that the tables' constraints refuse is dropped.
fn edit_values(edits: &mut Edits<'_>, path: &Path) -> rusqlite::Result<()> {
    let connection = Connection::open(path)?;
    connection.execute_batch(NO_SYNC)?;
    for _ in 0..=edits.below(4) {
        if edits.is_empty() {
            break;
        }
        let _ = if edits.below(4) == 0 {
            edit_manifest(edits, &connection)
        } else {
            edit_rows(edits, &connection)
        };
    }
    Ok(())
}

fn edit_rows(edits: &mut Edits<'_>, connection: &Connection) -> rusqlite::Result<usize> {
    let column = edits.word(&COLUMNS);
    let value = match edits.below(8) {
        0 => Cell::Null,
        1 | 2 => Cell::Integer(edits.number().cast_signed()),
        3 => Cell::Real(f64::from_bits(edits.number())),
        4 => Cell::Real(*edits.pick(&[f64::INFINITY, f64::NEG_INFINITY, -1e300, 1e300, 1e-320])),
        5 | 6 => Cell::Text(edits.word(&TEXTS).to_owned()),
        _ => Cell::Blob(edits.literal(64).to_vec()),
    };
    let (rows, n) = *edits.pick(&[
        ("episode = ?2", 3),
        ("episode >= ?2", 0),
        ("episode = ?2 AND policy = 'expert'", 1),
        ("episode = ?2 AND policy = 'random' AND task = 'RaiseCube' AND perturbation = 'None'", 0),
    ]);
    if edits.below(12) == 0 {
        return connection.execute(&format!("DELETE FROM episodes WHERE {}", rows.replace("?2", "?1")), [n]);
    }
    connection.execute(&format!("UPDATE episodes SET {column} = ?1 WHERE {rows}"), params![value, n])
}

fn edit_manifest(edits: &mut Edits<'_>, connection: &Connection) -> rusqlite::Result<usize> {
    let mut statement = connection.prepare("SELECT key, value FROM manifest ORDER BY key")?;
    let entries: Vec<(String, String)> =
        statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?.collect::<Result<_, _>>()?;
    let (key, value) = edits.pick(&entries);
    match edits.below(4) {
        0 => connection.execute("DELETE FROM manifest WHERE key = ?1", [key]),
        1 => connection.execute("UPDATE manifest SET key = ?2 WHERE key = ?1", [key, &edits.text(key)]),
        _ => {
            let json = edits.json(value.as_bytes());
            let text = String::from_utf8_lossy(&json);
            connection.execute("UPDATE manifest SET value = ?2 WHERE key = ?1", params![key, text])
        }
    }
}
