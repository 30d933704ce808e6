//! One lane as the sim sees it: what is in flight to a policy host, and the checks on what comes back.

use std::time::{Duration, Instant};

use ipc_types::layout::block_pages;
use ipc_types::link::{ActionMessage, LinkError, LinkNode, SimLane};
use ipc_types::{ActionView, ControlMode, Morphology, ObservationHeader, SCHEMA_HASH};
use thiserror::Error;

use super::protocol::Lane;

/// A host that has not answered after this long is given up.
const ANSWER_PATIENCE: Duration = Duration::from_secs(120);
/// How long a lane waits for a foreign host to come (again).
const FOREIGN_PATIENCE: Duration = Duration::from_secs(600);
/// How often a foreign host is looked after.
const FOREIGN_CHECK: Duration = Duration::from_millis(500);

/// Spreads the first epochs of a run's sims over all numbers: a late answer to a sim that was killed must not look like one
/// to its successor.
const EPOCH_STRIDE: u32 = 0x9E37_79B1;

/// Why a lane cannot go on.
#[derive(Debug, Error)]
pub(super) enum LaneError {
    #[error("policy `{policy}`: {source}")]
    Frame { policy: String, source: ipc_types::FrameError },
    #[error("policy `{policy}`: {message}")]
    Answer { policy: String, message: String },
    #[error("policy `{policy}` has not answered for {} s", .patience.as_secs())]
    Silent { policy: String, patience: Duration },
    #[error("no host for policy `{policy}` came within {} s", .patience.as_secs())]
    NoHost { policy: String, patience: Duration },
    #[error("policy `{policy}`: {source}")]
    Link { policy: String, source: LinkError },
}

/// A batch that went out and has not come back.
struct InFlight {
    sequence: u64,
    sent: Instant,
    slots: Vec<u32>,
}

/// A lane and its batches.
pub(super) struct LaneState {
    pub(super) config: Lane,
    pub(super) link: SimLane,
    run: u64,
    up: bool,
    epoch: u32,
    sequence: u64,
    in_flight: Vec<InFlight>,
    /// Empty batches whose memory is used again.
    spare: Vec<InFlight>,
    looked_at_host: Instant,
    host_gone_since: Option<Instant>,
    /// The foreign host that is being asked.
    host: Option<u128>,
}

impl LaneState {
    /// Creates the lane's shared memory and populates it.
    pub(super) fn create(node: &LinkNode, run: u64, config: Lane) -> Result<Self, LinkError> {
        let link = SimLane::create(node, run, &config.spec)?;
        let (depth, max_envs) = (config.spec.in_flight as usize, config.spec.max_envs as usize);
        let now = Instant::now();
        Ok(Self {
            link,
            run,
            up: false,
            epoch: std::process::id().wrapping_mul(EPOCH_STRIDE),
            sequence: 0,
            in_flight: Vec::with_capacity(depth),
            spare: (0..depth)
                .map(|_| InFlight { sequence: 0, sent: now, slots: Vec::with_capacity(max_envs) })
                .collect(),
            looked_at_host: now,
            host_gone_since: config.foreign.then_some(now),
            host: None,
            config,
        })
    }

    /// Whether another batch may go out.
    pub(super) fn is_open(&self) -> bool {
        self.up && !self.spare.is_empty()
    }

    /// Whether an answer is due.
    pub(super) fn awaits_answer(&self) -> bool {
        !self.in_flight.is_empty()
    }

    /// Pages of one env of this morphology.
    pub(super) fn block_pages(&self, morphology: Morphology) -> usize {
        block_pages(morphology, self.config.images)
    }

    /// The header of the next batch, which is then in flight; its memory of slots is filled by the caller.
    pub(super) fn dispatch(
        &mut self,
        slots: &[u32],
        morphology: Morphology,
        mode: ControlMode,
        now: Instant,
    ) -> ObservationHeader {
        let mut batch = self.spare.pop().expect("dispatch is called on an open lane");
        self.sequence += 1;
        batch.sequence = self.sequence;
        batch.sent = now;
        batch.slots.clear();
        batch.slots.extend_from_slice(slots);
        self.in_flight.push(batch);
        ObservationHeader {
            schema_hash: SCHEMA_HASH,
            run: self.run,
            sequence: self.sequence,
            epoch: self.epoch,
            n_envs: slots.len() as u32,
            block_pages: self.block_pages(morphology) as u32,
            morphology: morphology.code(),
            control_mode: mode.code(),
            images: u32::from(self.config.images),
            reserved: [0; 2],
        }
    }

    /// The host is there: batches may go out.
    pub(super) fn host_up(&mut self) {
        // Who is asked from here on: one who leaves before the next look must not be taken for its successor.
        self.host = if self.config.foreign { self.link.host_id() } else { None };
        self.up = !self.config.foreign || self.host.is_some();
    }

    /// The host is gone: what was in flight never comes back, and late answers belong to an earlier epoch.
    pub(super) fn host_down(&mut self) {
        self.up = false;
        self.epoch = self.epoch.wrapping_add(1);
        self.spare.append(&mut self.in_flight);
    }

    /// Takes the next answer off the lane and hands its blocks to `accept`, env by env with the slot each belongs to.
    /// Returns whether there was one.
    ///
    /// # Errors
    /// A message that is not an answer to what was asked.
    pub(super) fn receive(
        &mut self,
        mut accept: impl FnMut(u32, &ActionView<'_>, usize) -> Result<(), String>,
    ) -> Result<bool, LaneError> {
        let policy = || self.config.spec.policy.clone();
        let received = self.link.receive().map_err(|source| LaneError::Link { policy: policy(), source })?;
        let Some(message) = received else { return Ok(false) };
        let view = view(&message).map_err(|source| LaneError::Frame { policy: policy(), source })?;
        let header = view.header();
        if header.run != self.run || header.epoch != self.epoch {
            return Ok(true);
        }
        let answer = |message| LaneError::Answer { policy: policy(), message };
        let Some(at) = self.in_flight.iter().position(|batch| batch.sequence == header.sequence) else {
            return Err(answer(format!("it answered batch {}, which is not in flight", header.sequence)));
        };
        let batch = self.in_flight.swap_remove(at);
        if batch.slots.len() != header.n_envs as usize {
            let (found, expected) = (header.n_envs, batch.slots.len());
            return Err(answer(format!("its answer holds {found} envs, expected {expected}")));
        }
        for (env_idx, slot) in batch.slots.iter().enumerate() {
            accept(*slot, &view, env_idx).map_err(answer)?;
        }
        self.spare.push(batch);
        Ok(true)
    }

    /// Looks after a foreign host, and after an answer that does not come. Returns whether the host was lost.
    ///
    /// # Errors
    /// When patience has run out.
    pub(super) fn look_after(&mut self, now: Instant) -> Result<bool, LaneError> {
        let policy = || self.config.spec.policy.clone();
        if self.in_flight.iter().any(|batch| now - batch.sent > ANSWER_PATIENCE) {
            return Err(LaneError::Silent { policy: policy(), patience: ANSWER_PATIENCE });
        }
        if !self.config.foreign || now - self.looked_at_host < FOREIGN_CHECK {
            return Ok(false);
        }
        self.looked_at_host = now;
        if self.link.host_connected() && self.link.host_alive() {
            let id = self.link.host_id();
            let replaced = self.host.is_some() && self.host != id;
            (self.host, self.host_gone_since, self.up) = (id, None, !replaced);
            return Ok(replaced);
        }
        let was_up = self.up;
        self.host = None;
        let gone_since = *self.host_gone_since.get_or_insert(now);
        if now - gone_since > FOREIGN_PATIENCE {
            return Err(LaneError::NoHost { policy: policy(), patience: FOREIGN_PATIENCE });
        }
        Ok(was_up)
    }
}

fn view(message: &ActionMessage) -> Result<ActionView<'_>, ipc_types::FrameError> {
    ActionView::new(*message.header(), message.pages())
}
