//! Opening and copying of results files, with a specific error for each kind of path that is not one.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rusqlite::types::{Value, ValueRef};
use rusqlite::{Connection, OpenFlags, params_from_iter};
use serde_json::json;

use crate::store::results::columns::Column;
use crate::store::results::error::{ResultsFileError, not_used, not_written};
use crate::store::results::manifest::{ENVIRONMENT, PLANS, SHARD, StoredPlan};
use crate::store::results::schema::{APPLICATION_ID, VERSION, create, insert, n_finished, whole_rows};
use crate::store::results::{integrity, manifest};

/// Maximum wait for a reader that locks the file.
const BUSY_TIMEOUT: Duration = Duration::from_secs(5);
/// Attempts to lock the file, and the time between two. A child inherits the lock of a writer that has just
/// closed the file, until it executes its program.
const LOCK_ATTEMPTS: u32 = 25;
const LOCK_INTERVAL: Duration = Duration::from_millis(20);

/// Opens or creates a results file in write-ahead mode, and locks it against a second writer.
pub(crate) fn open(path: &Path) -> Result<(Connection, File), ResultsFileError> {
    let lock = lock(path)?;
    let sqlite = |source| not_used(path, source);
    let connection = connect(&file_name(path)?).map_err(sqlite)?;
    check(&connection, path)?;
    connection.pragma_update(None, "journal_mode", "WAL").map_err(sqlite)?;
    // In write-ahead mode a crash of the process loses no transaction; only a crash of the machine can.
    connection.pragma_update(None, "synchronous", "NORMAL").map_err(sqlite)?;
    Ok((connection, lock))
}

/// Opens an existing results file for reading. Another process may be writing to it.
pub(crate) fn open_read_only(path: &Path) -> Result<Connection, ResultsFileError> {
    let connection = open_for_reading(path, false)?;
    check_rows(&connection, path)?;
    Ok(connection)
}

/// Opens an existing results file for reading all of its rows, which the caller checks. A file to which no
/// run writes is read without SQLite's locks, which some network file systems do not grant; the returned
/// lock keeps runs away where they do.
pub(crate) fn open_unchecked(path: &Path) -> Result<(Connection, File), ResultsFileError> {
    let io = |source| ResultsFileError::Io { path: path.into(), source };
    let lock = run_config::input::open(path).map_err(io)?;
    let is_free = !matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock));
    let connection = open_for_reading(path, is_free && !is_ahead(path))?;
    // SQLite's own locks are lost when any descriptor of the file is closed, so this one stays open.
    Ok((connection, lock))
}

/// Opens a results file that another one is to replace: nobody else may be using it, because a log beside it
/// would be applied to the new file.
pub(crate) fn open_for_replacement(path: &Path) -> Result<(Connection, File), ResultsFileError> {
    if is_ahead(path) {
        let (connection, _lock) = open(path)?;
        close(&connection);
    }
    let lock = lock(path)?;
    if is_ahead(path) {
        return Err(ResultsFileError::InUse { path: path.into() });
    }
    Ok((open_for_reading(path, true)?, lock))
}

/// Opens a results file whose rows the caller checks, and without SQLite's locks if it is `immutable`.
fn open_for_reading(path: &Path, immutable: bool) -> Result<Connection, ResultsFileError> {
    let name = uri(&file_name(path)?) + if immutable { "?immutable=1" } else { "" };
    let flags =
        OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX | OpenFlags::SQLITE_OPEN_URI;
    let sqlite = |source| not_used(path, source);
    let connection = Connection::open_with_flags(name, flags).map_err(sqlite)?;
    connection.busy_timeout(BUSY_TIMEOUT).map_err(sqlite)?;
    check_kind(&connection, path)?;
    Ok(connection)
}

/// Creates a results file for many rows at once, without locks and without a journal: it is thrown away
/// unless it is complete.
pub(crate) fn create_for_bulk(path: &Path) -> Result<Connection, ResultsFileError> {
    let sqlite = |source| not_used(path, source);
    let connection = connect(Path::new(&format!("{}?nolock=1", uri(&file_name(path)?)))).map_err(sqlite)?;
    for (pragma, value) in [("journal_mode", "OFF"), ("synchronous", "OFF"), ("locking_mode", "EXCLUSIVE")] {
        connection.pragma_update(None, pragma, value).map_err(sqlite)?;
    }
    Ok(connection)
}

/// Returns `true` for a file in write-ahead mode whose log is not beside it.
pub(crate) fn lacks_wal(path: &Path) -> bool {
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    is_ahead(path) && !Path::new(&log).exists()
}

/// Returns `true` for a file in write-ahead mode.
fn is_ahead(path: &Path) -> bool {
    /// Byte of a SQLite file that is 2 in write-ahead mode.
    const WRITE_VERSION: usize = 18;
    let mut header = [0; WRITE_VERSION + 1];
    File::open(path).is_ok_and(|mut file| file.read_exact(&mut header).is_ok()) && header[WRITE_VERSION] == 2
}

/// Copies the state of a results file at this moment into a new file, without free space. The new file is
/// written without locks, which some network file systems do not grant.
pub(crate) fn copy_snapshot(path: &Path, copy: &Path) -> Result<(), ResultsFileError> {
    let target = format!("{}?nolock=1", uri(&file_name(copy)?));
    let copied = open_read_only(path)?.execute("VACUUM INTO ?1", [target]);
    copied.map(|_| ()).map_err(|error| not_written(copy, error))
}

/// Copies a results file without times and circumstances: two files with the same episodes and settings have
/// copies with the same bytes, on whichever machines they were made, and in how many runs.
///
/// # Errors
/// If the file cannot be read, or the copy cannot be written.
pub(crate) fn copy_without_times(path: &Path, copy: &Path) -> Result<(), ResultsFileError> {
    let (source, _lock) = open_unchecked(path)?;
    let target = create_for_bulk(copy)?;
    let entries = manifest::entries_of(&source).map_err(|error| not_used(path, error))?;
    let is_shard = entries.iter().any(|(key, _)| key == SHARD);
    let write = || {
        target.execute_batch("BEGIN")?;
        for (key, text) in entries.iter().filter(|(key, _)| key != ENVIRONMENT) {
            // The parts of a shard refer to its plan.
            let plans = (key == PLANS && !is_shard).then(|| largest_plans(text)).flatten();
            manifest::put_text(&target, key, plans.as_deref().unwrap_or(text))?;
        }
        copy_rows(&source, &target)?;
        target.execute_batch("COMMIT")
    };
    write().map_err(|error| not_written(copy, error))?;
    target.close().map_err(|(_, error)| not_written(copy, error))
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
        values[Column::Checksum as usize] = integrity::checksum(checked.iter().map(ValueRef::from)).into();
        insertion.execute(params_from_iter(values))?;
    }
    Ok(())
}

/// Returns stored plans without those that another one contains; `None` if the text is something else.
fn largest_plans(text: &str) -> Option<String> {
    let plans: Vec<StoredPlan> = serde_json::from_str(text).ok()?;
    let mut largest: Vec<StoredPlan> = Vec::new();
    for plan in plans {
        if !largest.iter().any(|other| other.contains(&plan)) {
            largest.retain(|other| !plan.contains(other));
            largest.push(plan);
        }
    }
    Some(json!(largest).to_string())
}

/// Returns the number of episodes without an error in a results file.
pub(crate) fn n_finished_in(path: &Path) -> Result<u64, ResultsFileError> {
    let count = open_read_only(path)?.query_row(&n_finished(), [], |row| row.get::<_, i64>(0));
    count.map(i64::unsigned_abs).map_err(|error| not_used(path, error))
}

/// Returns the URI by which SQLite opens the file at an absolute path.
fn uri(path: &Path) -> String {
    let path = path.to_string_lossy().replace('%', "%25").replace('?', "%3f").replace('#', "%23");
    format!("file:{path}")
}

/// Ends the write-ahead mode, so that the file can be read without the right to write next to it. If
/// somebody is reading it now, it stays in that mode.
pub(crate) fn close(connection: &Connection) {
    let _ = connection.busy_timeout(Duration::ZERO);
    let _ = connection.pragma_update(None, "journal_mode", "DELETE");
}

/// Returns a name by which SQLite opens just this file. It takes `:memory:` and names that start with `file:`
/// for something else, but no absolute path.
fn file_name(path: &Path) -> Result<PathBuf, ResultsFileError> {
    std::path::absolute(path).map_err(|source| ResultsFileError::Io { path: path.into(), source })
}

/// Checks that this is a results file of the current version, undamaged and unchanged.
fn check(connection: &Connection, path: &Path) -> Result<(), ResultsFileError> {
    check_kind(connection, path)?;
    check_rows(connection, path)
}

/// Checks that the file is undamaged and that nobody has changed its rows.
fn check_rows(connection: &Connection, path: &Path) -> Result<(), ResultsFileError> {
    let finding: String = connection
        .query_row("PRAGMA integrity_check(1)", [], |row| row.get(0))
        .map_err(|source| not_used(path, source))?;
    if finding == "ok" {
        return integrity::check_rows(connection, path);
    }
    // A line that names the database comes first.
    let finding = finding.lines().last().unwrap_or_default().to_owned();
    Err(ResultsFileError::Damaged { path: path.into(), finding })
}

/// Checks that this is a results file of the current version with our tables and nothing else.
fn check_kind(connection: &Connection, path: &Path) -> Result<(), ResultsFileError> {
    // Functions with side effects are for nobody's views, triggers and constraints.
    connection.pragma_update(None, "trusted_schema", false).map_err(|source| not_used(path, source))?;
    let pragma = |name| {
        connection
            .pragma_query_value(None, name, |row| row.get::<_, i64>(0))
            .map_err(|source| not_used(path, source))
    };
    if pragma("application_id")? != APPLICATION_ID {
        return Err(ResultsFileError::Foreign { path: path.into() });
    }
    match pragma("user_version")? {
        VERSION => {}
        found => return Err(ResultsFileError::Version { path: path.into(), found }),
    }
    integrity::check_schema(connection, path)
}

fn lock(path: &Path) -> Result<File, ResultsFileError> {
    if path.is_dir() {
        return Err(ResultsFileError::Folder { path: path.into() });
    }
    let io = |source: io::Error| match source.kind() {
        io::ErrorKind::NotFound => ResultsFileError::NoFolder { path: path.into() },
        _ => ResultsFileError::Io { path: path.into(), source },
    };
    if std::fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
        return Err(ResultsFileError::Special { path: path.into() });
    }
    let file =
        OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path).map_err(io)?;
    for _ in 0..LOCK_ATTEMPTS {
        match file.try_lock() {
            Ok(()) => return Ok(file),
            Err(TryLockError::WouldBlock) => std::thread::sleep(LOCK_INTERVAL),
            Err(TryLockError::Error(source)) => return Err(io(source)),
        }
    }
    Err(ResultsFileError::InUse { path: path.into() })
}

/// Connects to the file. A new one gets its tables, application id and version in one transaction; an
/// existing one is not written. A file whose creation was cut off counts as new: SQLite empties it when it is
/// first read.
fn connect(path: &Path) -> Result<Connection, rusqlite::Error> {
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE
        | OpenFlags::SQLITE_OPEN_CREATE
        | OpenFlags::SQLITE_OPEN_NO_MUTEX
        | OpenFlags::SQLITE_OPEN_URI;
    let connection = Connection::open_with_flags(path, flags)?;
    connection.busy_timeout(BUSY_TIMEOUT)?;
    let n_pages: i64 = connection.pragma_query_value(None, "page_count", |row| row.get(0))?;
    if n_pages == 0 {
        connection.execute_batch(&format!(
            "BEGIN; {} PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {VERSION}; COMMIT;",
            create()
        ))?;
    }
    Ok(connection)
}
