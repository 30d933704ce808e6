//! Retries of operations that may have to wait for a sim to start or for an exited peer to be cleaned up.

use std::time::{Duration, Instant};

use super::error::LinkError;
use super::node::LinkNode;

const RETRY_INTERVAL: Duration = Duration::from_millis(5);

/// Errors of a single attempt, by the use of repeating it.
pub(crate) enum AttemptError {
    /// Another attempt may succeed.
    Transient(LinkError),
    /// No further attempt can succeed.
    Permanent(LinkError),
}

impl From<LinkError> for AttemptError {
    fn from(error: LinkError) -> Self {
        Self::Permanent(error)
    }
}

/// Repeats `attempt` until it succeeds, fails permanently, `timeout` has passed, or `is_wanted` returns
/// `false`. Cleans up after exited peers between attempts.
pub(crate) fn retry<T>(
    node: &LinkNode,
    timeout: Duration,
    is_wanted: &dyn Fn() -> bool,
    mut attempt: impl FnMut() -> Result<T, AttemptError>,
) -> Result<T, LinkError> {
    let start = Instant::now();
    loop {
        match attempt() {
            Ok(value) => return Ok(value),
            Err(AttemptError::Permanent(error)) => return Err(error),
            Err(AttemptError::Transient(error)) if start.elapsed() >= timeout || !is_wanted() => {
                return Err(error);
            }
            Err(AttemptError::Transient(_)) => {
                if matches!(node.inner().try_cleanup_dead_nodes().cleanups, 0) {
                    std::thread::sleep(RETRY_INTERVAL);
                }
            }
        }
    }
}
