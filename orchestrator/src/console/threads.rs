//! The threads of commands that work in this process.

use anyhow::Context;
use run_config::allotment::n_cores;

use crate::console::exit::Failure;

/// Starts them. Otherwise they start when they are first needed, with a panic if the system refuses.
pub(crate) fn start_threads() -> Result<(), Failure> {
    Ok(rayon::ThreadPoolBuilder::new()
        .num_threads(n_cores() as usize)
        .build_global()
        .context("failed to start threads")?)
}
