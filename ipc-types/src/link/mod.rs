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

mod budget;
mod domain;
mod error;
mod host;
mod lane_spec;
mod lease;
mod management;
mod node;
mod prefault;
mod receiver;
mod retry;
mod sender;
mod services;
mod shm;
mod shortage;
mod sim;
mod type_names;
mod wake;

pub use budget::{BudgetError, check_budget};
pub use domain::Domain;
pub use error::LinkError;
pub use host::{ActionLoan, HostLane, ObservationMessage};
pub use lane_spec::LaneSpec;
pub use lease::DomainLease;
pub use node::LinkNode;
pub use shm::SHM;
pub use shortage::Shortage;
pub use sim::{ActionMessage, ObservationLoan, SimLane, SimLink};
