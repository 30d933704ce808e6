//! The errors of results files, and the causes that SQLite does not tell.

use std::io;
use std::path::{Path, PathBuf};

use rusqlite::ErrorCode;
use rustix::process::{Resource, getrlimit};
use thiserror::Error;

use crate::store::results::schema::VERSION;

/// Free bytes below which a file system counts as full: SQLite's own files need more.
const FULL: u64 = 128 << 10;

/// Errors that can occur while opening a results file.
#[derive(Debug, Error)]
pub(crate) enum ResultsFileError {
    #[error("failed to open the results file {}: it is a folder; choose a file with --db", path.display())]
    Folder { path: PathBuf },
    #[error("failed to open the results file {}: it is not a regular file; choose another with --db", path.display())]
    Special { path: PathBuf },
    #[error("failed to open the results file {}: its folder does not exist; create it", path.display())]
    NoFolder { path: PathBuf },
    #[error("failed to open the results file {}", path.display())]
    Io { path: PathBuf, source: io::Error },
    #[error("failed to use the results file {}: another run is writing to it", path.display())]
    InUse { path: PathBuf },
    #[error(
        "failed to use {} as a results file: it is another kind of file; choose another, or unzip it if it is a package",
        path.display()
    )]
    Foreign { path: PathBuf },
    #[error(
        "failed to use the results file {}: its tables are version {found}, this program uses version {VERSION}; choose \
         another file with --db",
        path.display()
    )]
    Version { path: PathBuf, found: i64 },
    #[error("failed to use the results file {}: {cause}; choose another with --db", path.display())]
    Sqlite { path: PathBuf, cause: String },
    #[error(
        "failed to use the results file {}: it is damaged ({finding}); use a copy of it, or choose another file",
        path.display()
    )]
    Damaged { path: PathBuf, finding: String },
    #[error(
        "failed to use the results file {}: {finding}; somebody has changed it. Use a copy of the file as the run left it",
        path.display()
    )]
    Changed { path: PathBuf, finding: String },
    #[error("failed to write {}: {cause}", path.display())]
    Copy { path: PathBuf, cause: String },
    #[error("failed to resume the results file {}: its manifest has no valid {key}", path.display())]
    Manifest { path: PathBuf, key: String },
    #[error(transparent)]
    Mismatch(#[from] ManifestMismatch),
}

/// A difference between the manifest of a results file and the command.
#[derive(Debug, Error, PartialEq, Eq)]
#[error(
    "failed to resume the results file {}: {}; use the same value, or another file with --db",
    path.display(),
    differences.join(", and ")
)]
pub(crate) struct ManifestMismatch {
    pub(crate) path: PathBuf,
    /// One clause per differing entry.
    pub(crate) differences: Vec<String>,
}

/// An error that occurred while reading or writing an open results file.
#[derive(Debug, Error)]
pub(crate) enum StoreError {
    #[error("failed to read the results file {}", path.display())]
    Read { path: PathBuf, source: rusqlite::Error },
    #[error(
        "failed to write to the results file {}: {cause}; finished episodes are stored, and the same command resumes",
        path.display()
    )]
    Write { path: PathBuf, cause: String },
    #[error(
        "failed to write to the results file {}: it was deleted or replaced during the run; run the same command again",
        path.display()
    )]
    Gone { path: PathBuf },
    #[error(
        "{n} finished episodes have vanished from the results file {} during the run: another program has changed it; run \
         the same command again",
        path.display()
    )]
    Vanished { path: PathBuf, n: u64 },
}

/// Describes an error of SQLite while a new results file is written.
pub(crate) fn not_written(path: &Path, error: rusqlite::Error) -> ResultsFileError {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    ResultsFileError::Copy { path: path.into(), cause: cause(folder, error) }
}

/// Classifies an error of SQLite while a results file is opened or checked.
pub(crate) fn not_used(path: &Path, source: rusqlite::Error) -> ResultsFileError {
    match source.sqlite_error_code() {
        Some(ErrorCode::NotADatabase) => ResultsFileError::Foreign { path: path.into() },
        Some(ErrorCode::DatabaseCorrupt) => {
            ResultsFileError::Damaged { path: path.into(), finding: source.to_string() }
        }
        _ => ResultsFileError::Sqlite { path: path.into(), cause: cause(path, source) },
    }
}

/// Returns SQLite's sentence about an error, which the whole error repeats. For an error of reading or
/// writing, adds what the system may have refused, because SQLite often does not say so.
pub(crate) fn cause(path: &Path, error: rusqlite::Error) -> String {
    /// Extended codes of locks that were refused: those of the file and of the shared memory beside it.
    const LOCKS: [i32; 6] = [2058, 2314, 2570, 3850, 4618, 5130];
    let failed = matches!(
        error.sqlite_error_code(),
        Some(ErrorCode::SystemIoFailure | ErrorCode::DiskFull | ErrorCode::CannotOpen)
    );
    let is_locked = error.sqlite_error().is_some_and(|error| LOCKS.contains(&error.extended_code));
    let sentence = match error {
        rusqlite::Error::SqliteFailure(_, Some(sentence)) => sentence,
        error => error.to_string(),
    };
    if !failed {
        return sentence;
    }
    if is_locked {
        return format!("{sentence} (its file system grants no locks, as some network ones)");
    }
    let stat = rustix::fs::statvfs(path).ok();
    let free = stat.map_or(u64::MAX, |stat| stat.f_bavail.saturating_mul(stat.f_frsize));
    match getrlimit(Resource::Fsize).current {
        _ if free < FULL => format!("{sentence} (its file system has only {} KiB free)", free >> 10),
        Some(limit) => {
            format!("{sentence} (files may have {limit} bytes: lift that limit, `ulimit -f unlimited`)")
        }
        None => sentence,
    }
}
