//! The clock of the fleet's timeouts. It stops while this process does not run (suspended by Ctrl-Z, or the
//! machine is asleep), so that children do not time out because of that.

use std::time::{Duration, Instant};

/// Maximum time between two updates that counts as running.
pub(crate) const MAX_TICK: Duration = Duration::from_secs(2);

/// The time during which this process has run.
#[derive(Debug)]
pub(crate) struct RunningClock {
    updated: Instant,
    now: Duration,
}

impl RunningClock {
    pub(crate) fn new() -> Self {
        Self { updated: Instant::now(), now: Duration::ZERO }
    }

    /// Advances the clock. Must be called at least every [`MAX_TICK`].
    pub(crate) fn update(&mut self) {
        self.now += self.updated.elapsed().min(MAX_TICK);
        self.updated = Instant::now();
    }

    /// Returns the time at the last update.
    pub(crate) fn now(&self) -> Duration {
        self.now
    }
}
