//! The sim's side of the link: it creates the services of its lanes, sends observations and receives actions.

use std::path::Path;
use std::time::Duration;

use iceoryx2::identifiers::UniqueNodeId;
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
use crate::layout::{Page, SCHEMA_HASH};

/// How long a restarted sim waits for the places of its dead predecessor.
const TAKEOVER: Duration = Duration::from_secs(3);

/// The event that wakes the sim, shared by its lanes.
#[derive(Debug)]
pub struct SimLink {
    ear: WakeListener,
}

impl SimLink {
    /// Creates the event, or takes over that of a dead sim. `n_lanes` hosts can ring it.
    ///
    /// # Errors
    /// If another living sim has it, or iceoryx2 fails.
    pub fn create(node: &LinkNode, n_lanes: u32) -> Result<Self, LinkError> {
        retry(node, TAKEOVER, || {
            let event = wake::create(node, SIM_WAKE, n_lanes as usize)?;
            Ok(Self { ear: wake::listen(&event, SIM_WAKE)? })
        })
    }

    /// Waits until any host of the run has rung, or `timeout` is over. One that rang earlier counts, once: look for
    /// messages after every wait, and expect none. Also ends at a signal. A wait in vain lasts up to two ticks of the kernel
    /// longer (8 ms).
    ///
    /// # Errors
    /// If the wait itself fails.
    pub fn wait(&self, timeout: Duration) -> Result<(), LinkError> {
        self.ear.wait(timeout)
    }
}

/// The sim's end of a lane.
#[derive(Debug)]
pub struct SimLane {
    observations: MessageSender<ObservationHeader>,
    actions: MessageReceiver<ActionHeader>,
    // The services live as long as something holds them.
    observation_service: Messages<ObservationHeader>,
    _action_service: Messages<ActionHeader>,
    _wake_service: PortFactory<Ipc>,
}

impl SimLane {
    /// Creates the lane's services, or takes over those that a dead sim has left to its host, and takes all the memory for
    /// observations: afterwards none of it can run out, and none is touched for the first time.
    ///
    /// # Errors
    /// If shared memory has no room (before anything is taken), another living sim has the lane, the host that is
    /// attached was started with other sizes, or iceoryx2 fails.
    pub fn create(node: &LinkNode, run: u64, spec: &LaneSpec) -> Result<Self, LinkError> {
        budget::check_bytes(spec.shm_bytes(), Path::new(SHM))?;
        retry(node, TAKEOVER, || Self::try_create(node, run, &Agreement { schema_hash: SCHEMA_HASH, spec }))
    }

    fn try_create(node: &LinkNode, run: u64, agreement: &Agreement<'_>) -> Result<Self, Attempt> {
        let spec = agreement.spec;
        let observation = lane_service(spec, "observation");
        let action = lane_service(spec, "action");
        let wake = lane_service(spec, "wake");
        let wake_service = wake::create(node, &wake, 1)?;
        let action_service = services::create(node, &action, run, agreement)?;
        let actions =
            MessageReceiver::create(&action_service, &action, spec.action_pages(), spec.action_chunks())?;
        let observation_service = services::create(node, &observation, run, agreement)?;
        let capacity = Capacity {
            pages: spec.observation_pages(),
            chunks: spec.observation_chunks(),
            loans: spec.in_flight as usize + 1,
        };
        let bell = wake::notify(&wake_service, &wake)?;
        let observations =
            MessageSender::create(node.domain(), &observation_service, &observation, bell, capacity)?;
        Ok(Self {
            observations,
            actions,
            observation_service,
            _action_service: action_service,
            _wake_service: wake_service,
        })
    }

    /// Memory for an observation message of `n_pages` pages.
    ///
    /// # Errors
    /// If it would be longer than the lane's longest message, more than `in_flight + 1` are on loan, or the host has held
    /// all the memory for a second.
    pub fn loan(&mut self, n_pages: usize) -> Result<ObservationLoan, LinkError> {
        // Before the host can answer, so that even a host which leaves at once leaves its answer.
        self.actions.connect()?;
        self.observations.loan(n_pages).map(ObservationLoan)
    }

    /// The oldest answer not received yet. Returns at once.
    ///
    /// # Errors
    /// If `in_flight` messages are held already, or the message claims more pages than the lane's longest has.
    pub fn receive(&mut self) -> Result<Option<ActionMessage>, LinkError> {
        Ok(self.actions.receive()?.map(ActionMessage))
    }

    /// Whether a host is attached. A host that was killed stays attached until it is reaped.
    #[must_use]
    pub fn host_connected(&self) -> bool {
        self.observation_service.dynamic_config().number_of_subscribers() > 0
    }

    /// Which host is attached: a number that no other attachment has, so that a host which was replaced between two looks
    /// is noticed. What its predecessor was sent is lost.
    #[must_use]
    pub fn host_id(&self) -> Option<u128> {
        self.host().map(|(id, _)| id)
    }

    /// Whether a host is attached and its process lives, for hosts that nobody waits for as their parent. Asks the file
    /// system (about 0.2 ms). A dead host can look alive for the moment in which another process cleans up after it.
    #[must_use]
    pub fn host_alive(&self) -> bool {
        self.host().is_some_and(|(_, node)| services::is_alive(&self.observation_service, node))
    }

    fn host(&self) -> Option<(u128, UniqueNodeId)> {
        let mut host = None;
        self.observation_service.dynamic_config().list_subscribers(|port| {
            host = Some((port.subscriber_id.value(), port.node_id));
            CallbackProgression::Stop
        });
        host
    }
}

/// An observation message being written.
pub struct ObservationLoan(Loan<ObservationHeader>);

impl ObservationLoan {
    /// The message's pages, in shared memory. They hold what an earlier message left there: write them all.
    #[must_use]
    pub fn pages_mut(&mut self) -> &mut [Page] {
        self.0.pages_mut()
    }

    /// Hands the message to the host and wakes it. The header is sent as it is; the host checks it against the pages.
    ///
    /// # Errors
    /// If no host is attached, or its queue has been full for a second. The message is lost then.
    pub fn send(self, header: ObservationHeader) -> Result<(), LinkError> {
        self.0.send(header)
    }
}

/// An action message, in the host's memory until it is dropped.
#[derive(Debug)]
pub struct ActionMessage(Received<ActionHeader>);

impl ActionMessage {
    /// The header as the host sent it.
    #[must_use]
    pub fn header(&self) -> &ActionHeader {
        self.0.user_header()
    }

    /// The pages, one per env; [`crate::ActionView`] checks and reads them.
    #[must_use]
    pub fn pages(&self) -> &[Page] {
        self.0.payload()
    }
}
