//! Limits of the process (getrlimit(2)) that a fleet needs to start, checked and raised before its first
//! child, which inherits them.

use std::path::{Path, PathBuf};

use ipc_types::link::LaneSpec;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use thiserror::Error;

/// Open files of a process without lanes or children, with a margin.
const FILES: u64 = 48;
/// Open files per lane: the sim has 14 for its ends, the orchestrator three pipes.
const FILES_PER_LANE: u64 = 20;
/// Address space of a child without lanes, in bytes.
const ADDRESS_SPACE: u64 = 1 << 30;
/// Address space of a thread in bytes: its stack and its part of the heap, which glibc reserves in 64 MiB.
const ADDRESS_SPACE_PER_THREAD: u64 = 72 << 20;

/// Errors that can occur while checking the limits.
#[derive(Debug, Error)]
pub(crate) enum LimitError {
    #[error(
        "this run needs up to {needed} open files per process, but the limit is {limit}; raise it: `ulimit -n {needed}`"
    )]
    Files { needed: u64, limit: u64 },
    #[error(
        "this run needs up to {} KiB of address space per process, but the limit is {} KiB; lift it: `ulimit -v unlimited`",
        needed >> 10, limit >> 10
    )]
    AddressSpace { needed: u64, limit: u64 },
    #[error(
        "this run needs files of up to {needed} bytes in shared memory, but the limit is {limit}; lift it: `ulimit -f unlimited`"
    )]
    FileSize { needed: u64, limit: u64 },
    #[error("this run starts its processes from {}, which is missing; mount /proc: `mount -t proc proc /proc`", path.display())]
    Program { path: PathBuf },
}

/// Checks that `program` is there and that the limits suffice for a run with `lanes` and `n_threads` threads
/// per process. Raises the limit of open files if that is allowed.
pub(crate) fn ensure(program: &Path, lanes: &[LaneSpec], n_threads: u32) -> Result<(), LimitError> {
    if !program.exists() {
        return Err(LimitError::Program { path: program.into() });
    }
    let needed = FILES + FILES_PER_LANE * lanes.len() as u64;
    let files = getrlimit(Resource::Nofile);
    if let Some(limit) = files.current.filter(|limit| *limit < needed) {
        let raised = Rlimit { current: Some(needed), maximum: files.maximum };
        setrlimit(Resource::Nofile, raised).map_err(|_| LimitError::Files { needed, limit })?;
    }
    let lane_bytes: u64 = lanes.iter().map(LaneSpec::shm_bytes).sum();
    let largest = lanes.iter().map(LaneSpec::shm_bytes).max().unwrap_or(0);
    if let Some(limit) = getrlimit(Resource::Fsize).current.filter(|limit| *limit < largest) {
        return Err(LimitError::FileSize { needed: largest, limit });
    }
    let process_bytes = ADDRESS_SPACE + ADDRESS_SPACE_PER_THREAD * u64::from(n_threads);
    let needed = process_bytes.saturating_add(lane_bytes);
    match getrlimit(Resource::As).current {
        Some(limit) if limit < needed => Err(LimitError::AddressSpace { needed, limit }),
        _ => Ok(()),
    }
}
