//! Check that the lanes of a run fit into shared memory, made before any memory is allocated.

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::lane_spec::LaneSpec;

/// Errors that can occur while checking the shared-memory budget of a run.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum BudgetError {
    #[error("failed to query the free space of {}", path.display())]
    Unknown { path: PathBuf, source: std::io::Error },
    #[error(
        "the lanes of this run need {needed} bytes ({} MiB) in {}, but only {available} bytes ({} MiB) are free; reduce \
         --envs or enlarge the file system",
        mebibytes(*needed), path.display(), *available >> 20
    )]
    TooSmall { path: PathBuf, needed: u64, available: u64 },
}

/// Checks that `shm`, the tmpfs that backs shared memory, has room for all `lanes`. Returns the bytes they
/// will occupy.
///
/// # Errors
/// If there is too little room, or the file system cannot be queried.
pub fn check_budget(lanes: &[LaneSpec], shm: &Path) -> Result<u64, BudgetError> {
    check_bytes(lanes.iter().map(LaneSpec::shm_bytes).sum(), shm)
}

/// Checks that `shm` has at least `needed` free bytes. Returns `needed`.
pub(super) fn check_bytes(needed: u64, shm: &Path) -> Result<u64, BudgetError> {
    let stat = rustix::fs::statvfs(shm)
        .map_err(|errno| BudgetError::Unknown { path: shm.into(), source: errno.into() })?;
    let available = stat.f_bavail.saturating_mul(stat.f_frsize);
    if needed > available {
        return Err(BudgetError::TooSmall { path: shm.into(), needed, available });
    }
    Ok(needed)
}

/// Converts bytes to MiB, rounding up so that the amount shown to the user is always sufficient.
fn mebibytes(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}
