//! The link: messages between one sim and its policy hosts, through shared memory and without a copy.
//!
//! It owns every iceoryx2 port and every name in a run's [`Domain`]. It never interprets a message (see
//! [`crate::frame`]), never decides when to send or how to handle an exited peer, and never waits without a
//! timeout.
//!
//! A lane connects one sim with one policy. It consists of a service for observations, a service for actions,
//! and an event that wakes the host. A further event, shared by all lanes, wakes the sim. The message
//! services carry the schema hash and the lane's sizes as attributes.
//!
//! | service | pattern | from → to |
//! |--|--|--|
//! | `hyp/lane/<lane>/observation` | pub-sub, pages with [`crate::ObservationHeader`] | sim → host |
//! | `hyp/lane/<lane>/action` | pub-sub, pages with [`crate::ActionHeader`] | host → sim |
//! | `hyp/lane/<lane>/wake` | event | sim → host |
//! | `hyp/sim/wake` | event | every host → sim |

mod domain;
pub(crate) mod ends;
mod error;
mod lane_spec;
mod lease;
mod management;
pub(crate) mod memory;
mod node;
mod retry;
mod services;
mod type_names;

pub use domain::Domain;
pub use ends::host::{ActionLoan, HostLane, ObservationMessage};
pub use ends::sim::{ActionMessage, ObservationLoan, SimLane, SimLink};
pub use error::LinkError;
pub use lane_spec::LaneSpec;
pub use lease::DomainLease;
pub use memory::budget::{BudgetError, check_budget};
pub use memory::shm::SHM;
pub use memory::shortage::Shortage;
pub use node::LinkNode;
