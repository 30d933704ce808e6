//! Core-seconds: the unit of both sides' ledgers. Time a process is kept from its cores by others does not count.

use rustix::time::{ClockId, clock_gettime};

/// Core-seconds that all threads of this process have used so far.
#[must_use]
pub fn core_seconds() -> f64 {
    let used = clock_gettime(ClockId::ProcessCPUTime);
    used.tv_sec as f64 + used.tv_nsec as f64 * 1e-9
}
