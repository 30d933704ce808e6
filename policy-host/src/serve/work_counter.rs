//! Cumulative work of the host, for its ledger events.

use run_config::trace::CpuTime;
use std::time::{Duration, Instant};

use super::protocol::HostEvent;

/// Minimum time between two ledger events.
const LEDGER_PERIOD: Duration = Duration::from_millis(100);

/// Cumulative work of the host, and the time of the last report.
pub(crate) struct WorkCounter {
    queries: u64,
    batches: u64,
    busy_s: f64,
    device_s: f64,
    pub(crate) flop: u64,
    /// Start of the time since which a device has had a batch.
    device_since: Option<(CpuTime, Instant)>,
    /// Start of the first query.
    first_query: Option<CpuTime>,
    reported: Instant,
    reported_batches: u64,
}

impl WorkCounter {
    pub(crate) fn new() -> Self {
        Self {
            queries: 0,
            batches: 0,
            busy_s: 0.0,
            device_s: 0.0,
            flop: 0,
            device_since: None,
            first_query: None,
            reported: Instant::now(),
            reported_batches: 0,
        }
    }

    /// Counts an answered batch.
    pub(crate) fn add_batch(&mut self, queries: u32) {
        self.queries += u64::from(queries);
        self.batches += 1;
    }

    /// Counts the time in the policy from `start` until now.
    pub(crate) fn add_time(&mut self, start: CpuTime) {
        self.busy_s += start.elapsed().as_secs_f64();
        self.first_query.get_or_insert(start);
    }

    /// Starts counting the time of a device, from `start` on, unless it is being counted already.
    pub(crate) fn device_has_batch(&mut self, start: (CpuTime, Instant)) {
        self.device_since.get_or_insert(start);
    }

    /// Stops counting the time of a device, which has no batch left. Everything that this process did in that
    /// time was for the policy.
    pub(crate) fn device_is_idle(&mut self) {
        if let Some((cpu, wall)) = self.device_since.take() {
            self.add_time(cpu);
            self.device_s += wall.elapsed().as_secs_f64();
        }
    }

    /// Returns an event if there is new work and the last report is at least [`LEDGER_PERIOD`] ago.
    pub(crate) fn due(&mut self) -> Option<HostEvent> {
        let news = self.batches > self.reported_batches && self.reported.elapsed() >= LEDGER_PERIOD;
        news.then(|| {
            self.reported = Instant::now();
            self.reported_batches = self.batches;
            self.event()
        })
    }

    pub(crate) fn event(&self) -> HostEvent {
        let cpu_s = self.first_query.map_or(0.0, |start| start.elapsed().as_secs_f64());
        let Self { queries, batches, mut busy_s, mut device_s, flop, .. } = *self;
        if let Some((cpu, wall)) = &self.device_since {
            busy_s += cpu.elapsed().as_secs_f64();
            device_s += wall.elapsed().as_secs_f64();
        }
        HostEvent::Ledger { queries, batches, busy_s, cpu_s, device_s, flop }
    }
}
