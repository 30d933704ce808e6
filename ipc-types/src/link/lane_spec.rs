//! The sizes of a lane: what both sides must agree on, and how much shared memory follows from it.

use serde::{Deserialize, Serialize};

use crate::layout::PAGE_BYTES;

/// Beside its messages a lane keeps queues, port lists and event states: measured 50 KiB, with 2 messages in flight.
const BOOKKEEPING_BYTES: u64 = 256 * 1024;

/// One lane: one (sim, policy) pair.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LaneSpec {
    /// Number of the lane, counted from 0 within its run.
    pub lane: u32,
    /// Name of the policy as the user gave it; a foreign host finds its lane by it.
    pub policy: String,
    /// Most envs in one message.
    pub max_envs: u32,
    /// Pages of one env's observation block ([`crate::layout::block_pages`]); the largest if they differ.
    pub block_pages: u32,
    /// Most observations that may be unanswered at a time.
    pub in_flight: u32,
}

impl LaneSpec {
    /// Bytes of shared memory that the two sides of this lane reserve in all.
    #[must_use]
    pub fn shm_bytes(&self) -> u64 {
        segment_bytes(self.observation_chunks(), self.observation_pages()) + self.host_bytes()
    }

    /// Bytes that the host's side reserves, and the queues and lists of the lane.
    pub(super) fn host_bytes(&self) -> u64 {
        segment_bytes(self.action_chunks(), self.action_pages()) + BOOKKEEPING_BYTES
    }

    /// Most pages in an observation message.
    pub(super) fn observation_pages(&self) -> usize {
        self.max_envs as usize * self.block_pages as usize
    }

    /// Most pages in an action message.
    pub(super) fn action_pages(&self) -> usize {
        self.max_envs as usize
    }

    /// Observations that exist at a time: all that are unanswered, and one that is being written. A host that keeps an
    /// observation after it has answered makes the sim's next loan wait.
    pub(super) fn observation_chunks(&self) -> usize {
        self.in_flight as usize + 1
    }

    /// Actions that exist at a time: as many as the sim may hold, as many again in its queue, and one being written.
    pub(super) fn action_chunks(&self) -> usize {
        2 * self.in_flight as usize + 1
    }
}

/// A chunk is its pages and one more for the headers in front of them.
fn segment_bytes(chunks: usize, pages: usize) -> u64 {
    chunks as u64 * (pages as u64 + 1) * PAGE_BYTES as u64
}
