//! The sim's side of a lane: the batches in flight to a policy host, validation of its answers, and timeouts.

use std::time::{Duration, Instant};

use ipc_types::layout::ACTION_PAGES;
use ipc_types::link::{ActionMessage, LinkError, LinkNode, SimLane};
use ipc_types::{
    ActionHeader, ActionView, ControlMode, FrameError, Morphology, ObservationHeader, Page, SCHEMA_HASH,
};
use run_config::trace::{self, Activity};
use thiserror::Error;

use super::protocol::{Lane, Latencies};

/// Longest wait for a foreign host to connect or to reconnect.
const FOREIGN_HOST_TIMEOUT: Duration = Duration::from_secs(Lane::FOREIGN_HOST_TIMEOUT_S as u64);
/// Interval between liveness checks of a foreign host.
const FOREIGN_CHECK_INTERVAL: Duration = Duration::from_millis(500);

/// Odd multiplier that spreads the first epochs of a run's sims over all 32-bit numbers, so that a late
/// answer to a sim that was killed is not mistaken for an answer to its successor.
const EPOCH_STRIDE: u32 = 0x9E37_79B1;

/// Errors that can occur while serving a lane. Other lanes are not affected.
#[derive(Debug, Error)]
pub(crate) enum LaneError {
    #[error("policy `{policy}` sent an invalid answer")]
    Answer { policy: String, source: InvalidAnswerError },
    #[error("policy `{policy}` has not answered for {} s", .timeout.as_secs())]
    AnswerTimeout { policy: String, timeout: Duration },
    #[error("no host for policy `{policy}` connected within {} s", .timeout.as_secs())]
    NoHost { policy: String, timeout: Duration },
    #[error("the link to policy `{policy}` failed")]
    Link { policy: String, source: LinkError },
}

/// Errors that can occur while validating an answer.
#[derive(Debug, Error)]
pub(crate) enum InvalidAnswerError {
    #[error(transparent)]
    Frame(#[from] FrameError),
    #[error("its host found an observation that was overwritten in shared memory")]
    Damaged,
    #[error("batch {sequence} is not in flight")]
    UnknownBatch { sequence: u64 },
    #[error("the answer holds {found} envs, expected {expected}")]
    EnvCount { found: u32, expected: usize },
    #[error("env {slot} runs no episode")]
    EmptySlot { slot: u32 },
    #[error("env {slot}: `{field}` is {found}, expected {expected}")]
    Field { slot: u32, field: &'static str, found: u32, expected: u32 },
}

/// A batch of observations that was sent and has not been answered.
struct InFlightBatch {
    sequence: u64,
    sent: Instant,
    /// The same on the clock of the trace.
    sent_ns: Option<u64>,
    slots: Vec<u32>,
}

/// A lane and its batches in flight.
pub(crate) struct LaneState {
    pub(crate) config: Lane,
    pub(crate) link: SimLane,
    run_id: u64,
    /// `true` if messages have checksums.
    check_frames: bool,
    host_connected: bool,
    epoch: u32,
    sequence: u64,
    in_flight: Vec<InFlightBatch>,
    /// Unused batches, whose allocations are reused.
    spare: Vec<InFlightBatch>,
    /// The pages of the current answer, copied once: the host can still write to its own memory.
    answer: Vec<Page>,
    last_host_check: Instant,
    host_absent_since: Option<Instant>,
    /// Identity of the foreign host that receives the queries.
    host_id: Option<u128>,
    /// Time in which a foreign host had an unanswered query, up to `queried_until`.
    queried: Duration,
    queried_until: Instant,
    given_up: bool,
}

impl LaneError {
    /// Returns `true` if no further attempt is worth its time.
    pub(crate) fn is_final(&self) -> bool {
        matches!(self, Self::NoHost { .. })
    }
}

impl LaneState {
    /// Creates the lane's shared memory and populates it.
    pub(crate) fn create(
        node: &LinkNode,
        run_id: u64,
        check_frames: bool,
        config: Lane,
    ) -> Result<Self, LinkError> {
        let link = SimLane::create(node, run_id, &config.spec)?;
        let (depth, max_envs) = (config.spec.in_flight as usize, config.spec.max_envs as usize);
        let now = Instant::now();
        Ok(Self {
            link,
            run_id,
            check_frames,
            host_connected: false,
            epoch: std::process::id().wrapping_mul(EPOCH_STRIDE),
            sequence: 0,
            in_flight: Vec::with_capacity(depth),
            spare: (0..depth)
                .map(|_| InFlightBatch {
                    sequence: 0,
                    sent: now,
                    sent_ns: None,
                    slots: Vec::with_capacity(max_envs),
                })
                .collect(),
            answer: Vec::with_capacity(max_envs * ACTION_PAGES),
            last_host_check: now,
            host_absent_since: config.foreign.then_some(now),
            host_id: None,
            queried: Duration::ZERO,
            queried_until: now,
            given_up: false,
            config,
        })
    }

    /// Returns `true` if another batch may be sent.
    pub(crate) fn can_send(&self) -> bool {
        self.host_connected && !self.spare.is_empty()
    }

    /// Returns `true` if a host is connected.
    pub(crate) fn is_connected(&self) -> bool {
        self.host_connected
    }

    /// Returns `true` if the lane is no longer served.
    pub(crate) fn is_given_up(&self) -> bool {
        self.given_up
    }

    /// Stops serving the lane.
    pub(crate) fn give_up(&mut self) {
        self.host_down();
        self.given_up = true;
    }

    /// Returns `true` if a batch is in flight.
    pub(crate) fn awaits_answer(&self) -> bool {
        !self.in_flight.is_empty()
    }

    /// Counts the time up to `now`, at which a batch in flight has no answer yet.
    pub(crate) fn count_queried(&mut self, now: Instant) {
        if self.config.foreign && self.awaits_answer() {
            self.queried += now.saturating_duration_since(self.queried_until);
            self.queried_until = now;
        }
    }

    /// Returns the seconds in which a foreign host had an unanswered query ([`Counters::foreign_s`]).
    ///
    /// [`Counters::foreign_s`]: super::protocol::Counters::foreign_s
    pub(crate) fn queried_s(&self) -> f64 {
        self.queried.as_secs_f64()
    }

    /// Records a batch as in flight and returns its header. The caller sends it with the observations in
    /// `pages`.
    pub(crate) fn dispatch(
        &mut self,
        slots: &[u32],
        morphology: Morphology,
        mode: ControlMode,
        pages: &[Page],
        now: Instant,
    ) -> ObservationHeader {
        let mut batch = self.spare.pop().expect("dispatch requires can_send");
        if self.in_flight.is_empty() {
            self.queried_until = now;
        }
        self.sequence += 1;
        batch.sequence = self.sequence;
        batch.sent = now;
        batch.sent_ns = trace::now();
        batch.slots.clear();
        batch.slots.extend_from_slice(slots);
        self.in_flight.push(batch);
        let header = ObservationHeader {
            schema_hash: SCHEMA_HASH,
            run: self.run_id,
            sequence: self.sequence,
            epoch: self.epoch,
            n_envs: slots.len() as u32,
            control_mode: mode.code(),
            ..Default::default()
        }
        .with_images(morphology, self.config.images);
        if self.check_frames { header.with_checksum(pages) } else { header }
    }

    /// Marks the host as connected: batches may be sent.
    pub(crate) fn host_up(&mut self) {
        // Remember which foreign host receives the queries, so that a replacement is noticed even if it
        // connects before the next check.
        self.host_id = if self.config.foreign { self.link.host_id() } else { None };
        self.host_connected = !self.config.foreign || self.host_id.is_some();
    }

    /// Marks the host as lost: batches in flight are dropped, and the new epoch makes late answers to them
    /// recognisable.
    pub(crate) fn host_down(&mut self) {
        self.host_connected = false;
        self.epoch = self.epoch.wrapping_add(1);
        self.spare.append(&mut self.in_flight);
    }

    /// Receives the next answer, adds its latency at the time `now`, and calls `accept` with env, answer and
    /// env index for every env of its batch. Answers of an earlier epoch are dropped. Returns `true` if a
    /// message was received.
    ///
    /// # Errors
    /// If the message is not a valid answer to a batch in flight, or the link fails.
    pub(crate) fn receive(
        &mut self,
        latencies: &mut Latencies,
        now: Instant,
        accept: impl FnMut(u32, &ActionView<'_>, usize) -> Result<(), InvalidAnswerError>,
    ) -> Result<bool, LaneError> {
        let received = self.link.receive();
        let received = received.map_err(|source| LaneError::Link { policy: self.policy(), source })?;
        let Some(message) = received else { return Ok(false) };
        let accepted = self.handle_answer(&message, latencies, now, accept);
        accepted.map_err(|source| LaneError::Answer { policy: self.policy(), source })?;
        Ok(true)
    }

    fn handle_answer(
        &mut self,
        message: &ActionMessage,
        latencies: &mut Latencies,
        now: Instant,
        mut accept: impl FnMut(u32, &ActionView<'_>, usize) -> Result<(), InvalidAnswerError>,
    ) -> Result<(), InvalidAnswerError> {
        let header = *message.header();
        self.answer.clear();
        self.answer.extend_from_slice(message.pages());
        // A foreign host need not support checksums.
        if self.check_frames && (header.has_checksum == 1 || !self.config.foreign) {
            header.check_checksum(&self.answer)?;
        }
        let view = ActionView::new(header, &self.answer)?;
        let header = view.header();
        if header.run != self.run_id || header.epoch != self.epoch {
            return Ok(());
        }
        let Some(at) = self.in_flight.iter().position(|batch| batch.sequence == header.sequence) else {
            return Err(InvalidAnswerError::UnknownBatch { sequence: header.sequence });
        };
        let batch = self.in_flight.swap_remove(at);
        let accepted = if header.status == ActionHeader::DAMAGED {
            Err(InvalidAnswerError::Damaged)
        } else if batch.slots.len() == header.n_envs as usize {
            let mut envs = batch.slots.iter().enumerate();
            envs.try_for_each(|(env_idx, slot)| accept(*slot, &view, env_idx))
        } else {
            Err(InvalidAnswerError::EnvCount { found: header.n_envs, expected: batch.slots.len() })
        };
        if accepted.is_ok() {
            trace::record(Activity::InFlight, batch.sent_ns, u64::from(header.n_envs));
            latencies.record(now - batch.sent, u64::from(header.n_envs));
        }
        // Also after an invalid answer, or the lane could never send as many again.
        self.spare.push(batch);
        accepted
    }

    /// Checks for overdue answers and, for a foreign host, that it is alive. Returns `true` if the host was
    /// lost.
    ///
    /// # Errors
    /// If a timeout has expired.
    pub(crate) fn check_host(&mut self, now: Instant) -> Result<bool, LaneError> {
        let timeout = Duration::from_secs(self.config.answer_timeout_s.into());
        if self.in_flight.iter().any(|batch| now - batch.sent > timeout) {
            return Err(LaneError::AnswerTimeout { policy: self.policy(), timeout });
        }
        if !self.config.foreign || now - self.last_host_check < FOREIGN_CHECK_INTERVAL {
            return Ok(false);
        }
        self.last_host_check = now;
        if self.link.host_connected() && self.link.host_alive() {
            let id = self.link.host_id();
            let replaced = self.host_id.is_some() && self.host_id != id;
            (self.host_id, self.host_absent_since, self.host_connected) = (id, None, !replaced);
            return Ok(replaced);
        }
        let was_connected = self.host_connected;
        self.host_id = None;
        let absent_since = *self.host_absent_since.get_or_insert(now);
        if now - absent_since > FOREIGN_HOST_TIMEOUT {
            self.host_absent_since = None;
            return Err(LaneError::NoHost { policy: self.policy(), timeout: FOREIGN_HOST_TIMEOUT });
        }
        Ok(was_connected)
    }

    /// Returns the name of the lane's policy.
    pub(crate) fn policy(&self) -> String {
        self.config.spec.policy.clone()
    }
}
