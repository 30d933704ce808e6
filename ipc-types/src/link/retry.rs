//! Attempts that may have to wait: for a sim that is not there yet, or for the place of a peer that has just died.

use std::time::{Duration, Instant};

use super::error::LinkError;
use super::node::LinkNode;

/// Pause between two attempts.
const PAUSE: Duration = Duration::from_millis(5);

/// Why an attempt failed, and whether another may succeed.
pub(super) enum Attempt {
    /// The world may change: try again while there is patience.
    Later(LinkError),
    /// It cannot succeed.
    Never(LinkError),
}

impl From<LinkError> for Attempt {
    fn from(error: LinkError) -> Self {
        Self::Never(error)
    }
}

/// Repeats `attempt` until it succeeds, cannot, or `patience` is used up; cleans up after dead peers in between.
pub(super) fn retry<T>(
    node: &LinkNode,
    patience: Duration,
    mut attempt: impl FnMut() -> Result<T, Attempt>,
) -> Result<T, LinkError> {
    let start = Instant::now();
    loop {
        match attempt() {
            Ok(value) => return Ok(value),
            Err(Attempt::Never(error)) => return Err(error),
            Err(Attempt::Later(error)) if start.elapsed() >= patience => return Err(error),
            Err(Attempt::Later(_)) => {
                if matches!(node.inner().try_cleanup_dead_nodes().cleanups, 0) {
                    std::thread::sleep(PAUSE);
                }
            }
        }
    }
}
