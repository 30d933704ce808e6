//! Why an operation of the link failed.

use std::path::PathBuf;

use iceoryx2::node::NodeCreationFailure;
use iceoryx2::port::listener::ListenerWaitError;
use iceoryx2::port::{LoanError, ReceiveError, SendError};
use thiserror::Error;

use super::budget::BudgetError;

/// A failed operation; the message continues "failed to …".
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum LinkError {
    #[error("use {root:?} as the link's root with prefix {prefix:?}: {reason}")]
    Domain { root: PathBuf, prefix: String, reason: String },
    #[error("{action} {}: {source}", path.display())]
    Io { action: &'static str, path: PathBuf, source: std::io::Error },
    #[error("join the link as node {name:?}: {reason}")]
    NodeName { name: String, reason: String },
    #[error("join the link as node {name:?}: {source:?}")]
    Node { name: String, source: NodeCreationFailure },
    #[error(transparent)]
    Budget(#[from] BudgetError),
    #[error("reserve shared memory: {} holds {needed} bytes ({} MiB) and there is no room for them; use fewer --envs or enlarge /dev/shm ({source})", path.display(), needed.div_ceil(1 << 20))]
    Reserve { path: PathBuf, needed: u64, source: std::io::Error },
    #[error("populate {needed} bytes ({} MiB) of shared memory: {source}", needed.div_ceil(1 << 20))]
    Populate { needed: u64, source: std::io::Error },
    #[error("find service {service}: no sim has created it")]
    Absent { service: String },
    #[error("attach to service {service}: another process holds the place ({reason})")]
    Occupied { service: String, reason: String },
    #[error(
        "attach to the lane: it speaks link schema {found:#018x}, this build speaks {expected:#018x}: rebuild the older side"
    )]
    Schema { expected: u64, found: u64 },
    #[error("attach to service {service}: its {field} is {found}, expected {expected}")]
    Spec { service: String, field: &'static str, expected: String, found: String },
    #[error("attach to service {service}: its message types have other names or sizes than this build's")]
    Types { service: String },
    #[error("set up service {service}: {reason}")]
    Service { service: String, reason: String },
    #[error("loan {pages} pages: a message of this lane has 1 to {most}")]
    LoanSize { pages: usize, most: usize },
    #[error("loan {pages} pages: {source:?}")]
    Loan { pages: usize, source: LoanError },
    #[error("hand over a message: the peer released nothing for {waited_ms} ms")]
    Backpressure { waited_ms: u64 },
    #[error("hand over a message: nobody is attached to receive it")]
    NoPeer,
    #[error("hand over a message: {0:?}")]
    Send(SendError),
    #[error("receive a message: {0:?}")]
    Receive(ReceiveError),
    #[error("receive a message: it claims {pages} pages, a message of this lane has at most {most}")]
    Oversized { pages: u64, most: usize },
    #[error("wait for the peer: {0:?}")]
    Wait(ListenerWaitError),
}
