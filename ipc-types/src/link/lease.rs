//! The lock file by which a domain is known to be in use.
//!
//! Every process of ours in a domain holds it shared, from before its first segment until it ends (the kernel releases it
//! then, whatever the end). A sweep takes it exclusively, so it can never meet a run that is just starting.

use std::fs::{DirBuilder, File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

use super::error::LinkError;

/// The lock's name in the domain's root; also the mark by which a sweep knows a folder for one of ours.
const LOCK_NAME: &str = "claim.lock";
/// A claim races only with a sweep that is just removing the folder; each round of that race removes one folder.
const ATTEMPTS: usize = 16;

/// A domain in use: while this lives no sweep touches the domain.
#[derive(Debug)]
pub struct DomainLease {
    _lock: File,
}

impl DomainLease {
    /// Creates the root (mode 0700) if needed and holds its lock shared.
    pub(super) fn hold(root: &Path) -> Result<Self, LinkError> {
        let failed = |source| LinkError::Io { action: "claim", path: root.into(), source };
        for _ in 0..ATTEMPTS {
            DirBuilder::new().recursive(true).mode(0o700).create(root).map_err(failed)?;
            match open(root, true).and_then(|lock| lock.lock_shared().map(|()| lock)) {
                Ok(lock) if is_current(&lock, root) => return Ok(Self { _lock: lock }),
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(failed(error)),
            }
        }
        Err(failed(io::Error::other("another process keeps removing it")))
    }

    /// Holds the lock of an unused domain exclusively; `None` if the folder is not a domain's, or is in use.
    pub(super) fn take_unused(root: &Path) -> Option<Self> {
        let lock = open(root, false).ok()?;
        match lock.try_lock() {
            Ok(()) => is_current(&lock, root).then_some(Self { _lock: lock }),
            Err(TryLockError::WouldBlock | TryLockError::Error(_)) => None,
        }
    }

    /// Whether `root` carries the mark of a domain.
    pub(super) fn marks(root: &Path) -> bool {
        lock_path(root).is_file()
    }
}

fn open(root: &Path, create: bool) -> io::Result<File> {
    OpenOptions::new().read(true).write(true).create(create).truncate(false).open(lock_path(root))
}

/// Whether the locked file is still the one in the folder: a sweep may have removed it between open and lock.
fn is_current(lock: &File, root: &Path) -> bool {
    match (lock.metadata(), std::fs::metadata(lock_path(root))) {
        (Ok(held), Ok(named)) => (held.dev(), held.ino()) == (named.dev(), named.ino()),
        _ => false,
    }
}

fn lock_path(root: &Path) -> PathBuf {
    root.join(LOCK_NAME)
}
