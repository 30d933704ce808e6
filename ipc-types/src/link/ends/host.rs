//! The policy host's side of the link: attaches to a lane created by a sim, receives observations and sends
//! actions.

use std::path::Path;
use std::time::Duration;

use iceoryx2::prelude::{CallbackProgression, PortFactory as _};
use iceoryx2::service::port_factory::event::PortFactory;

use crate::frame::{ActionHeader, ObservationHeader};
use crate::layout::{ACTION_PAGES, ActionBlock, Page, SCHEMA_HASH};
use crate::link::ends::receiver::{MessageReceiver, ReceivedMessage};
use crate::link::ends::sender::{Loan, MessageSender, SenderCapacity};
use crate::link::ends::wake::{self, SIM_WAKE, WakeListener};
use crate::link::error::LinkError;
use crate::link::lane_spec::LaneSpec;
use crate::link::memory::budget;
use crate::link::memory::shm::SHM;
use crate::link::node::LinkNode;
use crate::link::retry::{AttemptError, retry};
use crate::link::services::{self, Agreement, MessageService, lane_service};
use crate::link::type_names::Ipc;

/// The policy host's end of a lane.
#[derive(Debug)]
pub struct HostLane {
    observations: MessageReceiver<ObservationHeader>,
    actions: MessageSender<ActionHeader>,
    listener: WakeListener,
    // A service exists while some process holds it. These keep the lane open for a restarted sim.
    observation_service: MessageService<ObservationHeader>,
    _action_service: MessageService<ActionHeader>,
    _wake_service: PortFactory<Ipc>,
    _sim_wake_service: PortFactory<Ipc>,
}

impl HostLane {
    /// Attaches to a lane. Waits up to `timeout` for the sim to create it and for the lane's previous host to
    /// detach.
    ///
    /// # Errors
    /// If the timeout expires, the sim was built with a different schema or started with different sizes,
    /// shared memory has no room for the actions, or iceoryx2 fails.
    pub fn open(node: &LinkNode, spec: &LaneSpec, timeout: Duration) -> Result<Self, LinkError> {
        Self::open_while(node, spec, timeout, &|| true)
    }

    /// Like [`open`](Self::open), and gives up as soon as `is_wanted` returns `false`.
    ///
    /// # Errors
    /// As [`open`](Self::open); also if it is no longer wanted.
    pub fn open_while(
        node: &LinkNode,
        spec: &LaneSpec,
        timeout: Duration,
        is_wanted: &dyn Fn() -> bool,
    ) -> Result<Self, LinkError> {
        budget::check_bytes(spec.host_bytes(), Path::new(SHM))?;
        Self::open_with(node, timeout, is_wanted, &Agreement { schema_hash: SCHEMA_HASH, spec })
    }

    fn open_with(
        node: &LinkNode,
        timeout: Duration,
        is_wanted: &dyn Fn() -> bool,
        agreement: &Agreement<'_>,
    ) -> Result<Self, LinkError> {
        retry(node, timeout, is_wanted, || Self::try_open(node, agreement))
    }

    fn try_open(node: &LinkNode, agreement: &Agreement<'_>) -> Result<Self, AttemptError> {
        let spec = agreement.spec;
        let observation = lane_service(spec, "observation");
        let action = lane_service(spec, "action");
        let wake = lane_service(spec, "wake");
        let observation_service = services::open(node, &observation, agreement)?;
        let action_service = services::open(node, &action, agreement)?;
        let wake_service = wake::open(node, &wake)?;
        let sim_wake_service = wake::open(node, SIM_WAKE)?;
        let listener = wake::create_listener(&wake_service, &wake)?;
        let notifier = wake::create_notifier(&sim_wake_service, SIM_WAKE)?;
        let capacity = SenderCapacity {
            pages: spec.action_pages(),
            chunks: spec.action_chunks(),
            loans: spec.in_flight as usize + 1,
        };
        let actions = MessageSender::create(node.domain(), &action_service, &action, notifier, capacity)?;
        // Last: from here on the sim considers the host attached, so everything else must be in place.
        let observations = MessageReceiver::create(
            &observation_service,
            &observation,
            spec.observation_pages(),
            spec.observation_chunks(),
        )?;
        Ok(Self {
            observations,
            actions,
            listener,
            observation_service,
            _action_service: action_service,
            _wake_service: wake_service,
            _sim_wake_service: sim_wake_service,
        })
    }

    /// Returns the oldest unread observation, or `None` if there is none. Never blocks.
    ///
    /// # Errors
    /// If the host already holds `in_flight` messages, or the message claims more pages than the lane allows.
    pub fn receive(&mut self) -> Result<Option<ObservationMessage>, LinkError> {
        Ok(self.observations.receive()?.map(ObservationMessage))
    }

    /// Loans memory for the actions of `n_envs` envs, one [`ActionBlock`] each.
    ///
    /// # Errors
    /// If `n_envs` is 0 or exceeds `max_envs`, more than `in_flight + 1` messages are on loan, or the sim has
    /// released no memory for a second.
    pub fn loan(&mut self, n_envs: usize) -> Result<ActionLoan, LinkError> {
        self.actions.loan(n_envs * ACTION_PAGES).map(ActionLoan)
    }

    /// Waits until the sim notifies this host, a signal arrives, or `timeout` has passed. Returns at once if
    /// a notification is pending, so a wake-up does not imply a message: poll [`Self::receive`] after every
    /// wait. A timeout is up to two kernel ticks (8 ms) late. This method never spins; a caller may spin on
    /// [`Self::receive`] for some 50 µs first.
    ///
    /// # Errors
    /// If the wait itself fails.
    pub fn wait(&self, timeout: Duration) -> Result<(), LinkError> {
        self.listener.wait(timeout)
    }

    /// Returns `true` if a sim is attached. A killed sim stays attached until it is reaped.
    #[must_use]
    pub fn sim_connected(&self) -> bool {
        self.observation_service.dynamic_config().number_of_publishers() > 0
    }

    /// Returns `true` if a sim is attached and its process is alive. Queries the file system (about 0.2 ms).
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

/// An observation message in the sim's memory. Drop it before sending the answer, or soon after: the sim has
/// only one more chunk of memory than the number of observations it may have in flight.
#[derive(Debug)]
pub struct ObservationMessage(ReceivedMessage<ObservationHeader>);

impl ObservationMessage {
    /// Returns the header, unchecked.
    #[must_use]
    pub fn header(&self) -> &ObservationHeader {
        self.0.user_header()
    }

    /// Returns the pages, mapped read-only; [`crate::ObservationView`] checks and reads them.
    #[must_use]
    pub fn pages(&self) -> &[Page] {
        self.0.payload()
    }
}

/// An action message that is being written.
pub struct ActionLoan(Loan<ActionHeader>);

impl ActionLoan {
    /// Returns the message's blocks, one per env, in shared memory. They still contain an earlier message:
    /// overwrite all of them.
    #[must_use]
    pub fn blocks_mut(&mut self) -> &mut [ActionBlock] {
        bytemuck::cast_slice_mut(self.0.pages_mut())
    }

    /// Returns `header` with the checksum of itself and the blocks as they are now.
    #[must_use]
    pub fn with_checksum(&mut self, header: ActionHeader) -> ActionHeader {
        header.with_checksum(self.0.pages_mut())
    }

    /// Sends the message to the sim and wakes it. The header is sent unchecked; the sim checks it against the
    /// pages.
    ///
    /// # Errors
    /// If no sim is attached, or its queue has been full for a second. In both cases the message is lost.
    pub fn send(self, header: ActionHeader) -> Result<(), LinkError> {
        self.0.send(header)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::{Domain, LinkNode, SimLane, SimLink};

    fn spec() -> LaneSpec {
        LaneSpec { lane: 3, policy: "act".into(), max_envs: 2, block_pages: 1, in_flight: 1 }
    }

    /// Creates a lane and opens it with a host whose lane spec and schema hash have been changed by `change`.
    fn open_changed(run: u64, change: impl FnOnce(&mut LaneSpec, &mut u64)) -> Result<HostLane, LinkError> {
        let base = tempfile::tempdir_in("/tmp").unwrap();
        let domain = Domain::new(base.path(), 0x7e57_0000_0000 + u64::from(std::process::id()) * 64 + run);
        let node = LinkNode::new(&domain, "test").unwrap();
        let _sim = (SimLink::create(&node, 1).unwrap(), SimLane::create(&node, 1, &spec()).unwrap());
        let (mut spec, mut schema_hash) = (spec(), SCHEMA_HASH);
        change(&mut spec, &mut schema_hash);
        let opened =
            HostLane::open_with(&node, Duration::ZERO, &|| true, &Agreement { schema_hash, spec: &spec });
        domain.remove().unwrap();
        opened
    }

    #[test]
    fn open_reports_both_hashes_on_schema_mismatch() {
        let Err(error) = open_changed(0, |_, hash| *hash = 5) else { panic!("the host was accepted") };
        assert!(matches!(error, LinkError::Schema { expected: 5, found: SCHEMA_HASH }), "{error}");
    }

    #[test]
    fn open_names_the_first_differing_size() {
        type Change = fn(&mut LaneSpec);
        let cases: [(&str, Change); 4] = [
            ("policy", |spec| spec.policy = "pi05".into()),
            ("max_envs", |spec| spec.max_envs = 3),
            ("block_pages", |spec| spec.block_pages = 87),
            ("in_flight", |spec| spec.in_flight = 2),
        ];
        for (run, (name, change)) in (1..).zip(cases) {
            let Err(error) = open_changed(run, |spec, _| change(spec)) else {
                panic!("a host with a different {name} was accepted")
            };
            assert!(matches!(error, LinkError::Spec { field, .. } if field == name), "{error}");
        }
    }

    #[test]
    fn open_accepts_an_identical_spec() {
        assert!(open_changed(9, |_, _| ()).is_ok());
    }
}
