//! Recording of what the threads of a process do and when, for `run --trace`, and measurement of the CPU time
//! that they use.
//!
//! Recording is off until [`enable`] is called; then each [`span`] costs two readings of the clock and an
//! entry in a list, and otherwise one atomic load. The clock is the system's monotonic one, which all
//! processes of a machine share. Nothing reads the spans but the trace file.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};

/// Largest number of spans that wait for [`take`]; further ones are dropped.
const MAX_WAITING: usize = 1 << 20;

static ENABLED: AtomicBool = AtomicBool::new(false);
static SPANS: Mutex<Vec<TraceSpan>> = Mutex::new(Vec::new());
static N_THREADS: AtomicU32 = AtomicU32::new(0);

thread_local! {
    /// Number of the thread within its process, in the order of their first spans.
    static THREAD: u32 = N_THREADS.fetch_add(1, Ordering::Relaxed);
}

/// The kinds of work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Activity {
    /// Building the world of an episode.
    Build,
    /// Control steps of one env.
    Step,
    /// Assembling a batch of observations: records and images.
    Observe,
    /// Rendering of images.
    Render,
    /// A batch from sending its observations to receiving the answers.
    InFlight,
    /// Inference for a batch.
    Infer,
    /// Inference by one thread for its share of a batch.
    Share,
    /// Waiting for a message.
    Wait,
    /// Storing a finished episode.
    Store,
}

/// An activity of a thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TraceSpan {
    /// The kind of work.
    pub activity: Activity,
    /// Number of the thread within its process.
    pub thread: u32,
    /// Start on the system's monotonic clock, in ns.
    pub start_ns: u64,
    /// Duration in ns.
    pub duration_ns: u64,
    /// Number of items: control steps, envs or images.
    pub n: u64,
}

/// An activity that is going on. It is recorded by [`finish`](Self::finish), and if dropped, with 0 items.
#[derive(Debug)]
#[must_use]
pub struct OpenSpan {
    activity: Activity,
    /// `None` while nothing is recorded.
    start_ns: Option<u64>,
    n: u64,
}

/// A moment on the kernel's clock of the CPU time of this process or thread.
#[derive(Clone, Copy, Debug)]
pub struct CpuTime {
    clock: ClockId,
    at: Duration,
}

/// Starts recording in this process.
pub fn enable() {
    ENABLED.store(true, Ordering::Relaxed);
}

/// Returns the monotonic time in ns while recording, and `None` otherwise.
#[must_use]
pub fn now() -> Option<u64> {
    ENABLED.load(Ordering::Relaxed).then(|| read(ClockId::Monotonic).as_nanos() as u64)
}

/// Starts an activity of the current thread.
pub fn span(activity: Activity) -> OpenSpan {
    OpenSpan { activity, start_ns: now(), n: 0 }
}

/// Records an activity that started at `start_ns`, a time returned by [`now`], and ends now.
pub fn record(activity: Activity, start_ns: Option<u64>, n: u64) {
    if let (Some(start_ns), Some(end_ns)) = (start_ns, now()) {
        let (thread, duration_ns) = (THREAD.with(|thread| *thread), end_ns.saturating_sub(start_ns));
        let mut spans = SPANS.lock().unwrap_or_else(PoisonError::into_inner);
        if spans.len() < MAX_WAITING {
            spans.push(TraceSpan { activity, thread, start_ns, duration_ns, n });
        }
    }
}

/// Returns the spans recorded since the last call.
#[must_use]
pub fn take() -> Vec<TraceSpan> {
    std::mem::take(&mut *SPANS.lock().unwrap_or_else(PoisonError::into_inner))
}

impl CpuTime {
    /// Returns the CPU time that all threads of this process have used.
    #[must_use]
    pub fn of_process() -> Self {
        Self::on(ClockId::ProcessCPUTime)
    }

    /// Returns the CPU time that this thread has used.
    #[must_use]
    pub fn of_thread() -> Self {
        Self::on(ClockId::ThreadCPUTime)
    }

    fn on(clock: ClockId) -> Self {
        Self { clock, at: read(clock) }
    }

    /// Returns the CPU time used since then, on the same thread if it is that of a thread.
    #[must_use]
    pub fn elapsed(self) -> Duration {
        read(self.clock).saturating_sub(self.at)
    }
}

fn read(clock: ClockId) -> Duration {
    let time = clock_gettime(clock);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

impl OpenSpan {
    /// Ends the activity, in which `n` items were handled.
    pub fn finish(mut self, n: u64) {
        self.n = n;
    }
}

impl Drop for OpenSpan {
    fn drop(&mut self) {
        record(self.activity, self.start_ns, self.n);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The only test of the process-wide recorder, so that tests do not disturb each other.
    #[test]
    fn spans_are_recorded_once_enabled() {
        span(Activity::Step).finish(5);
        assert_eq!(take(), []);
        enable();
        let outer = span(Activity::Observe);
        std::thread::spawn(|| span(Activity::Render).finish(3)).join().unwrap();
        outer.finish(1);
        let spans = take();
        let [inner, outer] = spans.as_slice() else { panic!("{spans:?}") };
        assert_eq!(
            (inner.activity, inner.n, outer.activity, outer.n),
            (Activity::Render, 3, Activity::Observe, 1)
        );
        assert_ne!(inner.thread, outer.thread);
        assert!(outer.start_ns <= inner.start_ns);
        assert!(outer.start_ns + outer.duration_ns >= inner.start_ns + inner.duration_ns);
        assert_eq!(take(), []);
    }
}
