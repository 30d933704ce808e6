//! Whether the lanes of a run fit into shared memory, asked before any of it is taken.

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::spec::LaneSpec;

/// Why the lanes of a run cannot be created.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum BudgetError {
    #[error("ask for the free space of {}: {source}", path.display())]
    Unknown { path: PathBuf, source: std::io::Error },
    #[error(
        "fit the lanes into {}: {needed} bytes ({} MiB) are needed, {available} bytes ({} MiB) are free; use fewer \
         --envs or enlarge it",
        path.display(), mebibytes(*needed), *available >> 20
    )]
    TooSmall { path: PathBuf, needed: u64, available: u64 },
}

/// Checks that `shm`, the tmpfs of shared memory, has room for all `lanes`; returns the bytes they will take.
///
/// # Errors
/// If it has not, or cannot be asked.
pub fn check_budget(lanes: &[LaneSpec], shm: &Path) -> Result<u64, BudgetError> {
    check_bytes(lanes.iter().map(LaneSpec::shm_bytes).sum(), shm)
}

/// Checks that `shm` has room for `needed` bytes; returns them.
pub(super) fn check_bytes(needed: u64, shm: &Path) -> Result<u64, BudgetError> {
    let stat = rustix::fs::statvfs(shm)
        .map_err(|errno| BudgetError::Unknown { path: shm.into(), source: errno.into() })?;
    let available = stat.f_bavail.saturating_mul(stat.f_frsize);
    if needed > available {
        return Err(BudgetError::TooSmall { path: shm.into(), needed, available });
    }
    Ok(needed)
}

/// Rounded up, so that the number a user is told suffices.
fn mebibytes(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}
