//! The error type of all link operations.

use std::path::PathBuf;

use iceoryx2::node::NodeCreationFailure;
use iceoryx2::port::listener::ListenerWaitError;
use iceoryx2::port::{LoanError, ReceiveError, SendError};
use thiserror::Error;

use crate::link::memory::budget::BudgetError;
use crate::link::memory::shortage::Shortage;

/// Errors that can occur while joining a domain, setting up a lane, or exchanging messages.
///
/// A message never contains the text of its `source`: whoever shows it joins the two.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum LinkError {
    #[error("failed to use {root:?} with prefix {prefix:?} as the link's domain: {reason}")]
    Domain { root: PathBuf, prefix: String, reason: String },
    #[error("failed to {action} {}", path.display())]
    Io { action: &'static str, path: PathBuf, source: std::io::Error },
    #[error("failed to join the link as node {name:?}: {reason}")]
    NodeName { name: String, reason: String },
    #[error("failed to join the link as node {name:?}")]
    Node { name: String, source: NodeCreationFailure },
    #[error(transparent)]
    Budget(#[from] BudgetError),
    #[error(
        "failed to reserve {needed} bytes ({} MiB) of shared memory for {}; reduce --envs or enlarge /dev/shm",
        needed.div_ceil(1 << 20), path.display()
    )]
    Reserve { path: PathBuf, needed: u64, source: std::io::Error },
    #[error("failed to prefault {needed} bytes ({} MiB) of shared memory", needed.div_ceil(1 << 20))]
    Populate { needed: u64, source: std::io::Error },
    #[error("failed to attach to service {service}: no sim has created it")]
    Absent { service: String },
    #[error("failed to attach to service {service}: another process is already attached ({reason})")]
    Occupied { service: String, reason: String },
    #[error(
        "failed to attach to the lane: it uses link schema {found:#018x}, this build uses {expected:#018x}; rebuild the \
         older side"
    )]
    Schema { expected: u64, found: u64 },
    #[error("failed to attach to service {service}: its {field} is {found}, expected {expected}")]
    Spec { service: String, field: &'static str, expected: String, found: String },
    #[error(
        "failed to attach to service {service}: its message types differ in name or size from those of this build"
    )]
    Types { service: String },
    #[error("failed to set up service {service}: {reason}")]
    Service { service: String, reason: String },
    #[error("failed to create {}; /dev/shm must be a tmpfs in which this user can create files (mode 1777)", path.display())]
    SharedMemory { path: PathBuf, source: std::io::Error },
    #[error("failed to set up the link ({failure})")]
    Shortage { failure: String, source: Shortage },
    #[error(
        "failed to use the segment {}: it belongs to user {owner}, who can read and change it; run the same command again",
        path.display()
    )]
    Foreign { path: PathBuf, owner: u32 },
    #[error("failed to loan {pages} pages: a message of this lane has 1 to {max_pages} pages")]
    LoanSize { pages: usize, max_pages: usize },
    #[error("failed to loan {pages} pages")]
    Loan { pages: usize, source: LoanError },
    #[error("failed to send a message: the peer has released no memory for {waited_ms} ms")]
    Backpressure { waited_ms: u64 },
    #[error("failed to send a message: no peer is attached to receive it")]
    NoPeer,
    #[error("failed to send a message")]
    Send(#[source] SendError),
    #[error("failed to receive a message")]
    Receive(#[source] ReceiveError),
    #[error("received a message that claims {pages} pages; a message of this lane has at most {max_pages}")]
    Oversized { pages: u64, max_pages: usize },
    #[error("failed to wait for the peer")]
    Wait(#[source] ListenerWaitError),
}

impl LinkError {
    /// Returns `true` if the user has to fix the cause before another attempt can succeed.
    #[must_use]
    pub fn is_user_error(&self) -> bool {
        match self {
            Self::Domain { .. }
            | Self::Budget(_)
            | Self::Reserve { .. }
            | Self::SharedMemory { .. }
            | Self::Shortage { .. }
            | Self::Foreign { .. } => true,
            Self::Io { source, .. } | Self::Populate { source, .. } => crate::remedy(source).is_some(),
            _ => false,
        }
    }
}
