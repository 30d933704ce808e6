//! The policy host's side of the link: it attaches to a lane that a sim has created, receives observations and answers.

use std::path::Path;
use std::time::Duration;

use iceoryx2::prelude::{CallbackProgression, PortFactory as _};
use iceoryx2::service::port_factory::event::PortFactory;

use super::budget;
use super::domain::SHM;
use super::error::LinkError;
use super::lane_spec::LaneSpec;
use super::node::LinkNode;
use super::receiver::{MessageReceiver, Received};
use super::retry::{Attempt, retry};
use super::sender::{Capacity, Loan, MessageSender};
use super::services::{self, Agreement, Messages, lane_service};
use super::type_names::Ipc;
use super::wake::{self, SIM_WAKE, WakeListener};
use crate::frame::{ActionHeader, ObservationHeader};
use crate::layout::{ActionBlock, Page, SCHEMA_HASH};

/// The host's end of a lane.
#[derive(Debug)]
pub struct HostLane {
    observations: MessageReceiver<ObservationHeader>,
    actions: MessageSender<ActionHeader>,
    ear: WakeListener,
    // The services live as long as something holds them: with these a restarted sim finds its host where it was.
    observation_service: Messages<ObservationHeader>,
    _action_service: Messages<ActionHeader>,
    _wake_service: PortFactory<Ipc>,
    _sim_wake_service: PortFactory<Ipc>,
}

impl HostLane {
    /// Attaches to a lane; waits up to `patience` for the sim to create it, or for the lane's last host to leave.
    ///
    /// # Errors
    /// If none of that happens, the sim was built with another schema or started with other sizes, shared memory has no
    /// room for the answers, or iceoryx2 fails.
    pub fn open(node: &LinkNode, spec: &LaneSpec, patience: Duration) -> Result<Self, LinkError> {
        budget::check_bytes(spec.host_bytes(), Path::new(SHM))?;
        Self::open_as(node, patience, &Agreement { schema_hash: SCHEMA_HASH, spec })
    }

    fn open_as(node: &LinkNode, patience: Duration, agreement: &Agreement<'_>) -> Result<Self, LinkError> {
        retry(node, patience, || Self::try_open(node, agreement))
    }

    fn try_open(node: &LinkNode, agreement: &Agreement<'_>) -> Result<Self, Attempt> {
        let spec = agreement.spec;
        let observation = lane_service(spec, "observation");
        let action = lane_service(spec, "action");
        let wake = lane_service(spec, "wake");
        let observation_service = services::open(node, &observation, agreement)?;
        let action_service = services::open(node, &action, agreement)?;
        let wake_service = wake::open(node, &wake)?;
        let sim_wake_service = wake::open(node, SIM_WAKE)?;
        let ear = wake::listen(&wake_service, &wake)?;
        let bell = wake::notify(&sim_wake_service, SIM_WAKE)?;
        let capacity = Capacity {
            pages: spec.action_pages(),
            chunks: spec.action_chunks(),
            loans: spec.in_flight as usize + 1,
        };
        let actions = MessageSender::create(node.domain(), &action_service, &action, bell, capacity)?;
        // Last: from here on the sim sees a host, and everything it needs is there.
        let observations = MessageReceiver::create(
            &observation_service,
            &observation,
            spec.observation_pages(),
            spec.observation_chunks(),
        )?;
        Ok(Self {
            observations,
            actions,
            ear,
            observation_service,
            _action_service: action_service,
            _wake_service: wake_service,
            _sim_wake_service: sim_wake_service,
        })
    }

    /// The oldest observation not received yet. Returns at once.
    ///
    /// # Errors
    /// If `in_flight` messages are held already, or the message claims more pages than the lane's longest has.
    pub fn receive(&mut self) -> Result<Option<ObservationMessage>, LinkError> {
        Ok(self.observations.receive()?.map(ObservationMessage))
    }

    /// Memory for the answers to `n_envs` envs, one page each.
    ///
    /// # Errors
    /// If there are more than `max_envs`, more than `in_flight + 1` messages are on loan, or the sim has held all the
    /// memory for a second.
    pub fn loan(&mut self, n_envs: usize) -> Result<ActionLoan, LinkError> {
        self.actions.loan(n_envs).map(ActionLoan)
    }

    /// Waits until the sim has rung, or `timeout` is over. A ring that came earlier counts, once: look for messages after
    /// every wait, and expect none. Also ends at a signal. A wait in vain lasts up to two ticks of the kernel longer (8 ms).
    /// It only waits: spinning on [`Self::receive`] for some 50 µs first is the caller's choice.
    ///
    /// # Errors
    /// If the wait itself fails.
    pub fn wait(&self, timeout: Duration) -> Result<(), LinkError> {
        self.ear.wait(timeout)
    }

    /// Whether a sim is attached. A sim that was killed stays attached until it is reaped.
    #[must_use]
    pub fn sim_connected(&self) -> bool {
        self.observation_service.dynamic_config().number_of_publishers() > 0
    }

    /// Whether a sim is attached and its process lives. Asks the file system (about 0.2 ms).
    #[must_use]
    pub fn sim_alive(&self) -> bool {
        let mut node = None;
        self.observation_service.dynamic_config().list_publishers(|port| {
            node = Some(port.node_id);
            CallbackProgression::Stop
        });
        node.is_some_and(|node| services::is_alive(&self.observation_service, node))
    }
}

/// An observation message, in the sim's memory until it is dropped. Drop it before the answer is sent, or soon after: the
/// sim has one chunk of memory more than it may have unanswered observations.
#[derive(Debug)]
pub struct ObservationMessage(Received<ObservationHeader>);

impl ObservationMessage {
    /// The header as the sim sent it.
    #[must_use]
    pub fn header(&self) -> &ObservationHeader {
        self.0.user_header()
    }

    /// The pages, mapped read-only; [`crate::ObservationView`] checks and reads them.
    #[must_use]
    pub fn pages(&self) -> &[Page] {
        self.0.payload()
    }
}

/// An action message being written.
pub struct ActionLoan(Loan<ActionHeader>);

impl ActionLoan {
    /// The message's blocks, one per env, in shared memory. They hold what an earlier message left there: write them all.
    #[must_use]
    pub fn blocks_mut(&mut self) -> &mut [ActionBlock] {
        bytemuck::cast_slice_mut(self.0.pages_mut())
    }

    /// Hands the message to the sim and wakes it. The header is sent as it is; the sim checks it against the pages.
    ///
    /// # Errors
    /// If no sim is attached, or its queue has been full for a second. The message is lost then.
    pub fn send(self, header: ActionHeader) -> Result<(), LinkError> {
        self.0.send(header)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::{Domain, LinkNode, SimLane, SimLink};

    const SPEC: fn() -> LaneSpec =
        || LaneSpec { lane: 3, policy: "act".into(), max_envs: 2, block_pages: 1, in_flight: 1 };

    /// A lane whose host differs as `differ` says; what opening it says.
    fn opened_differently(
        run: u64,
        differ: impl FnOnce(&mut LaneSpec, &mut u64),
    ) -> Result<HostLane, LinkError> {
        let base = tempfile::tempdir_in("/tmp").unwrap();
        let domain = Domain::new(base.path(), 0x7e57_0000_0000 + u64::from(std::process::id()) * 64 + run);
        let node = LinkNode::new(&domain, "test").unwrap();
        let _sim = (SimLink::create(&node, 1).unwrap(), SimLane::create(&node, 1, &SPEC()).unwrap());
        let (mut spec, mut schema_hash) = (SPEC(), SCHEMA_HASH);
        differ(&mut spec, &mut schema_hash);
        let opened = HostLane::open_as(&node, Duration::ZERO, &Agreement { schema_hash, spec: &spec });
        domain.remove().unwrap();
        opened
    }

    #[test]
    fn a_host_of_another_schema_is_told_both() {
        let Err(error) = opened_differently(0, |_, hash| *hash = 5) else { panic!("it was let in") };
        assert!(matches!(error, LinkError::Schema { expected: 5, found: SCHEMA_HASH }), "{error}");
    }

    #[test]
    fn a_host_of_other_sizes_is_told_which() {
        type Differ = fn(&mut LaneSpec);
        let cases: [(&str, Differ); 4] = [
            ("policy", |spec| spec.policy = "pi05".into()),
            ("max_envs", |spec| spec.max_envs = 3),
            ("block_pages", |spec| spec.block_pages = 87),
            ("in_flight", |spec| spec.in_flight = 2),
        ];
        for (run, (name, differ)) in (1..).zip(cases) {
            let Err(error) = opened_differently(run, |spec, _| differ(spec)) else { panic!("{name} let in") };
            assert!(matches!(error, LinkError::Spec { field, .. } if field == name), "{error}");
        }
    }

    #[test]
    fn a_host_of_the_same_kind_is_let_in() {
        assert!(opened_differently(9, |_, _| ()).is_ok());
    }
}
