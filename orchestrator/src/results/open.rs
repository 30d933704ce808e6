//! Opening a results file, and every way in which a path may turn out not to be one.

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rusqlite::{Connection, ErrorCode, OpenFlags};
use thiserror::Error;

use super::manifest::Mismatch;
use super::schema::{APPLICATION_ID, CREATE, VERSION};

/// How long to wait for a reader that holds the file.
const BUSY: Duration = Duration::from_secs(5);

/// Why a results file cannot be used.
#[derive(Debug, Error)]
pub(crate) enum OpenError {
    #[error("failed to open the results file {}: it is a folder; name a file with --db", path.display())]
    Folder { path: PathBuf },
    #[error("failed to open the results file {}: {source}", path.display())]
    Io { path: PathBuf, source: io::Error },
    #[error("failed to use the results file {}: another run is writing to it", path.display())]
    InUse { path: PathBuf },
    #[error("failed to use {} as results file: it is not one of ours; name another", path.display())]
    Foreign { path: PathBuf },
    #[error(
        "failed to use the results file {}: its tables are version {found}, this program writes version {VERSION}; name \
         another with --db",
        path.display()
    )]
    Version { path: PathBuf, found: i64 },
    #[error("failed to use the results file {}: {source}", path.display())]
    Sqlite { path: PathBuf, source: rusqlite::Error },
    #[error("failed to continue the results file {}: its manifest has no valid {key}", path.display())]
    Manifest { path: PathBuf, key: String },
    #[error(transparent)]
    Mismatch(#[from] Mismatch),
}

/// Opens or creates a file of ours, in write-ahead mode, and locks it against a second writer.
pub(super) fn open(path: &Path) -> Result<(Connection, File), OpenError> {
    let lock = lock(path)?;
    let is_new = lock.metadata().map_err(|source| OpenError::Io { path: path.into(), source })?.len() == 0;
    let sqlite = |source| not_used(path, source);
    let connection = connect(path, is_new).map_err(sqlite)?;
    check(&connection, path)?;
    connection.pragma_update(None, "journal_mode", "WAL").map_err(sqlite)?;
    // In write-ahead mode this loses no transaction when the process dies, only when the machine does.
    connection.pragma_update(None, "synchronous", "NORMAL").map_err(sqlite)?;
    Ok((connection, lock))
}

/// Opens a file of ours that is there, to read; somebody may be writing to it.
pub(super) fn open_to_read(path: &Path) -> Result<Connection, OpenError> {
    let sqlite = |source| not_used(path, source);
    let connection = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY).map_err(sqlite)?;
    connection.busy_timeout(BUSY).map_err(sqlite)?;
    check(&connection, path)?;
    Ok(connection)
}

/// Whether it is a file of ours, of this version.
fn check(connection: &Connection, path: &Path) -> Result<(), OpenError> {
    let pragma = |name| {
        connection
            .pragma_query_value(None, name, |row| row.get::<_, i64>(0))
            .map_err(|source| not_used(path, source))
    };
    if pragma("application_id")? != APPLICATION_ID {
        return Err(OpenError::Foreign { path: path.into() });
    }
    match pragma("user_version")? {
        VERSION => Ok(()),
        found => Err(OpenError::Version { path: path.into(), found }),
    }
}

fn not_used(path: &Path, source: rusqlite::Error) -> OpenError {
    match source.sqlite_error_code() {
        Some(ErrorCode::NotADatabase) => OpenError::Foreign { path: path.into() },
        _ => OpenError::Sqlite { path: path.into(), source },
    }
}

fn lock(path: &Path) -> Result<File, OpenError> {
    if path.is_dir() {
        return Err(OpenError::Folder { path: path.into() });
    }
    let io = |source| OpenError::Io { path: path.into(), source };
    let file =
        OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path).map_err(io)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(OpenError::InUse { path: path.into() }),
        Err(TryLockError::Error(source)) => Err(io(source)),
    }
}

/// Nothing is written to a file that was there before. A new one gets its tables and marks in one transaction.
fn connect(path: &Path, is_new: bool) -> Result<Connection, rusqlite::Error> {
    let connection = Connection::open(path)?;
    connection.busy_timeout(BUSY)?;
    if is_new {
        connection.execute_batch(&format!(
            "BEGIN; {CREATE} PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {VERSION}; COMMIT;"
        ))?;
    }
    Ok(connection)
}
