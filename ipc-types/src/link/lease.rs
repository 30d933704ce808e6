//! The lock file that marks a domain as in use.
//!
//! Every process of a run that joins the domain holds the lock shared, from before its first segment exists
//! until the process exits; the kernel releases it however the process ends. [`super::Domain::remove_stale`]
//! takes the lock exclusively, so it cannot remove the domain of a run that is just starting.

use std::ffi::OsStr;
use std::fs::{DirBuilder, File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

use super::error::LinkError;

/// File name of the lock in the domain's root. Its presence also identifies a folder as a domain.
const LOCK_NAME: &str = "claim.lock";
/// Attempts to acquire a lease. An attempt fails only if a clean-up removes the folder at the same moment,
/// and each such clean-up removes one folder.
const MAX_ATTEMPTS: usize = 16;

/// Protects a domain from [`super::Domain::remove_stale`] until it is dropped.
#[derive(Debug)]
pub struct DomainLease {
    _lock: File,
}

impl DomainLease {
    /// Creates the domain's root (mode 0700) if it does not exist and locks it shared.
    pub(crate) fn acquire(root: &Path) -> Result<Self, LinkError> {
        let failed = |source| LinkError::Io { action: "lock", path: root.into(), source };
        for _ in 0..MAX_ATTEMPTS {
            DirBuilder::new().recursive(true).mode(0o700).create(root).map_err(failed)?;
            match open(root, true).and_then(|lock| lock.lock_shared().map(|()| lock)) {
                Ok(lock) if is_current(&lock, root) => return Ok(Self { _lock: lock }),
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(failed(error)),
            }
        }
        Err(failed(io::Error::other("another process keeps removing the folder")))
    }

    /// Locks an unused domain exclusively. Returns `None` if the folder is not a domain's root or is in use.
    pub(crate) fn try_acquire_exclusive(root: &Path) -> Option<Self> {
        let lock = open(root, false).ok()?;
        match lock.try_lock() {
            Ok(()) => is_current(&lock, root).then_some(Self { _lock: lock }),
            Err(TryLockError::WouldBlock | TryLockError::Error(_)) => None,
        }
    }

    /// Removes the lock file of a domain.
    pub(crate) fn remove(root: &Path) -> Result<(), LinkError> {
        match std::fs::remove_file(DomainLease::path(root)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(LinkError::Io { action: "remove", path: DomainLease::path(root), source: error })
            }
            _ => Ok(()),
        }
    }

    /// Returns `true` if this is the name of a domain's lock file.
    pub(crate) fn is_lock(name: &OsStr) -> bool {
        name == LOCK_NAME
    }

    /// Returns `true` if `root` contains the lock file of a domain.
    pub(crate) fn exists(root: &Path) -> bool {
        Self::path(root).is_file()
    }

    /// Returns the path of a domain's lock file.
    pub(crate) fn path(root: &Path) -> PathBuf {
        root.join(LOCK_NAME)
    }
}

fn open(root: &Path, create: bool) -> io::Result<File> {
    OpenOptions::new().read(true).write(true).create(create).truncate(false).open(DomainLease::path(root))
}

/// Returns `true` if the locked file is still the one in the folder. A clean-up may remove it between open
/// and lock.
fn is_current(lock: &File, root: &Path) -> bool {
    match (lock.metadata(), std::fs::metadata(DomainLease::path(root))) {
        (Ok(held), Ok(named)) => (held.dev(), held.ino()) == (named.dev(), named.ino()),
        _ => false,
    }
}
