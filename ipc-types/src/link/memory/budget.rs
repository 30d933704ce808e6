//! Checks that a run fits into shared memory and into its folder, made before anything is allocated.

use std::path::{Path, PathBuf};

use rustix::fs::StatVfs;
use thiserror::Error;

use crate::link::lane_spec::LaneSpec;

/// Errors that can occur while checking the shared-memory budget of a run.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum BudgetError {
    #[error("failed to use {} for shared memory: it is {found}; mount a tmpfs there", path.display())]
    NotAFolder { path: PathBuf, found: &'static str },
    #[error("failed to query the free space of {}", path.display())]
    Unknown { path: PathBuf, source: std::io::Error },
    #[error(
        "the lanes of this run need {needed} bytes ({} MiB) in {}, but only {available} bytes ({} MiB) are free; reduce \
         --envs or enlarge the file system (mount -o remount,size=2G; docker run --shm-size=2g)",
        mebibytes(*needed), path.display(), *available >> 20
    )]
    TooSmall { path: PathBuf, needed: u64, available: u64 },
    #[error(
        "this run needs about {needed} files in {}, but its file system has inodes for {available} only (`df -i`); remove \
         files, or mount it with more of them (nr_inodes)",
        path.display()
    )]
    Inodes { path: PathBuf, needed: u64, available: u64 },
    #[error(
        "this run needs about {needed} bytes for sockets and other files in {}, but only {available} bytes are free; free \
         some, or set XDG_RUNTIME_DIR to another folder",
        path.display()
    )]
    Folder { path: PathBuf, needed: u64, available: u64 },
}

/// Files and folders that a run needs in each of its two places, apart from those of its lanes, with a
/// margin.
const FILES: u64 = 32;
/// Files that a lane needs in each place: 9 segments, or 24 files of services and ports.
const FILES_PER_LANE: u64 = 24;
/// Bytes that a file of at most a page takes.
const FILE_BYTES: u64 = 4096;

/// Checks that `shm`, the tmpfs that backs shared memory, has room for all `lanes`. Returns the bytes they
/// will occupy.
///
/// # Errors
/// If there is too little room, or the file system cannot be queried.
pub fn check_budget(lanes: &[LaneSpec], shm: &Path) -> Result<u64, BudgetError> {
    check_bytes(lanes.iter().map(LaneSpec::shm_bytes).sum(), shm)
}

/// Checks that `shm` is a folder with room for all `lanes` and for the small files that come with them, and
/// that the run's `folder` has room for its files.
///
/// # Errors
/// If there is too little room, or a file system cannot be queried.
pub(crate) fn check_places(lanes: &[LaneSpec], shm: &Path, folder: &Path) -> Result<(), BudgetError> {
    let found = match std::fs::metadata(shm) {
        Ok(metadata) if metadata.is_dir() => None,
        Ok(_) => Some("no folder"),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Some("missing"),
        Err(source) => return Err(BudgetError::Unknown { path: shm.into(), source }),
    };
    if let Some(found) = found {
        return Err(BudgetError::NotAFolder { path: shm.into(), found });
    }
    let n_files = FILES + FILES_PER_LANE * lanes.len() as u64;
    let lane_bytes: u64 = lanes.iter().map(LaneSpec::shm_bytes).sum();
    check_bytes(lane_bytes.saturating_add(n_files * FILE_BYTES), shm)?;
    for path in [shm, folder] {
        let stat = stat(path)?;
        // File systems without a fixed number of inodes report 0 of them.
        if stat.f_files > 0 && stat.f_favail < n_files {
            return Err(BudgetError::Inodes { path: path.into(), needed: n_files, available: stat.f_favail });
        }
    }
    let (needed, available) = (n_files * FILE_BYTES, free_bytes(&stat(folder)?));
    if available < needed {
        return Err(BudgetError::Folder { path: folder.into(), needed, available });
    }
    Ok(())
}

/// Checks that `shm` has at least `needed` free bytes. Returns `needed`.
pub(crate) fn check_bytes(needed: u64, shm: &Path) -> Result<u64, BudgetError> {
    let available = free_bytes(&stat(shm)?);
    if needed > available {
        return Err(BudgetError::TooSmall { path: shm.into(), needed, available });
    }
    Ok(needed)
}

fn stat(path: &Path) -> Result<StatVfs, BudgetError> {
    rustix::fs::statvfs(path)
        .map_err(|errno| BudgetError::Unknown { path: path.into(), source: errno.into() })
}

/// Returns the bytes that an unprivileged user can still allocate.
pub(crate) fn free_bytes(stat: &StatVfs) -> u64 {
    stat.f_bavail.saturating_mul(stat.f_frsize)
}

/// Converts bytes to MiB, rounding up so that the amount shown to the user is always sufficient.
fn mebibytes(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}
