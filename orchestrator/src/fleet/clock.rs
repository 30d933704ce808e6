//! The fleet's clock, for patience. It stands still while the orchestrator itself does not run (stopped by Ctrl-Z, or the
//! machine asleep), so that nobody is blamed for that.

use std::time::{Duration, Instant};

/// Longest time between two looks that counts as running.
const LONGEST_LOOK: Duration = Duration::from_secs(2);

/// Time during which the orchestrator ran.
#[derive(Debug)]
pub(super) struct Clock {
    looked: Instant,
    now: Duration,
}

impl Clock {
    pub(super) fn new() -> Self {
        Self { looked: Instant::now(), now: Duration::ZERO }
    }

    /// Looks at the world's clock. To be called often.
    pub(super) fn look(&mut self) {
        self.now += self.looked.elapsed().min(LONGEST_LOOK);
        self.looked = Instant::now();
    }

    /// The time at the last look.
    pub(super) fn now(&self) -> Duration {
        self.now
    }
}
