//! The sizes of a lane that both sides must agree on, and the shared memory they imply.

use serde::{Deserialize, Serialize};

use crate::layout::{ACTION_PAGES, PAGE_BYTES};

/// Upper bound on the memory of a lane's queues, port lists and event states. Measured: 50 KiB with 2
/// messages in flight.
const BOOKKEEPING_BYTES: u64 = 256 * 1024;

/// Identity and sizes of one lane, the connection between a sim and a policy.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LaneSpec {
    /// Index of the lane within its run.
    pub lane: u32,
    /// Name of the policy as the user gave it; a foreign host uses it to find its lane.
    pub policy: String,
    /// Maximum number of envs in one message.
    pub max_envs: u32,
    /// Pages of one env's observation block ([`crate::layout::block_pages`]), the largest one if morphologies
    /// differ.
    pub block_pages: u32,
    /// Maximum number of unanswered observations.
    pub in_flight: u32,
}

impl LaneSpec {
    /// Returns the bytes of shared memory that both sides of this lane reserve together.
    #[must_use]
    pub fn shm_bytes(&self) -> u64 {
        segment_bytes(self.observation_chunks(), self.observation_pages()) + self.host_bytes()
    }

    /// Returns the bytes that the host reserves, including the lane's bookkeeping.
    pub(crate) fn host_bytes(&self) -> u64 {
        segment_bytes(self.action_chunks(), self.action_pages()) + BOOKKEEPING_BYTES
    }

    /// Returns the maximum number of pages in an observation message.
    pub(crate) fn observation_pages(&self) -> usize {
        self.max_envs as usize * self.block_pages as usize
    }

    /// Returns the maximum number of pages in an action message.
    pub(crate) fn action_pages(&self) -> usize {
        self.max_envs as usize * ACTION_PAGES
    }

    /// Returns the number of observation buffers: one per unanswered message plus the one being written. A
    /// host that keeps an observation after answering it delays the sim's next loan.
    pub(crate) fn observation_chunks(&self) -> usize {
        self.in_flight as usize + 1
    }

    /// Returns the number of action buffers: those the sim may hold, as many again in its queue, and the one
    /// being written.
    pub(crate) fn action_chunks(&self) -> usize {
        2 * self.in_flight as usize + 1
    }
}

/// Returns the bytes of a segment. Each chunk has one page more than its payload, for the headers in front of
/// it.
fn segment_bytes(chunks: usize, pages: usize) -> u64 {
    chunks as u64 * (pages as u64 + 1) * PAGE_BYTES as u64
}
