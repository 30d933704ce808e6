//! The sim's side of the link: creates the services of its lanes, sends observations and receives actions.

use std::path::Path;
use std::time::Duration;

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::prelude::{CallbackProgression, PortFactory as _};
use iceoryx2::service::port_factory::event::PortFactory;

use crate::frame::{ActionHeader, ObservationHeader};
use crate::layout::{Page, SCHEMA_HASH};
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

/// Maximum time a restarted sim waits for its exited predecessor to be cleaned up.
const TAKEOVER_TIMEOUT: Duration = Duration::from_secs(3);

/// The wake event of a sim, shared by all its lanes.
#[derive(Debug)]
pub struct SimLink {
    listener: WakeListener,
}

impl SimLink {
    /// Creates the event, or takes over that of an exited sim. Up to `n_lanes` hosts can notify it.
    ///
    /// # Errors
    /// If another running sim holds it, or iceoryx2 fails.
    pub fn create(node: &LinkNode, n_lanes: u32) -> Result<Self, LinkError> {
        retry(node, TAKEOVER_TIMEOUT, &|| true, || {
            let event = wake::create(node, SIM_WAKE, n_lanes as usize)?;
            Ok(Self { listener: wake::create_listener(&event, SIM_WAKE)? })
        })
    }

    /// Waits until a host of the run notifies the sim, a signal arrives, or `timeout` has passed. Returns at
    /// once if a notification is pending, so a wake-up does not imply a message: poll every lane after every
    /// wait. A timeout is up to two kernel ticks (8 ms) late.
    ///
    /// # Errors
    /// If the wait itself fails.
    pub fn wait(&self, timeout: Duration) -> Result<(), LinkError> {
        self.listener.wait(timeout)
    }
}

/// The sim's end of a lane.
#[derive(Debug)]
pub struct SimLane {
    observations: MessageSender<ObservationHeader>,
    actions: MessageReceiver<ActionHeader>,
    // A service exists while some process holds it.
    observation_service: MessageService<ObservationHeader>,
    _action_service: MessageService<ActionHeader>,
    _wake_service: PortFactory<Ipc>,
}

impl SimLane {
    /// Creates the lane's services, or takes over those that an exited sim has left behind. Allocates all
    /// memory for observations, so that later loans neither run out of shared memory nor fault in new pages.
    ///
    /// # Errors
    /// If shared memory has too little room (checked before anything is allocated), another running sim holds
    /// the lane, the attached host was started with different sizes, or iceoryx2 fails.
    pub fn create(node: &LinkNode, run: u64, spec: &LaneSpec) -> Result<Self, LinkError> {
        budget::check_bytes(spec.shm_bytes(), Path::new(SHM))?;
        retry(node, TAKEOVER_TIMEOUT, &|| true, || {
            Self::try_create(node, run, &Agreement { schema_hash: SCHEMA_HASH, spec })
        })
    }

    fn try_create(node: &LinkNode, run: u64, agreement: &Agreement<'_>) -> Result<Self, AttemptError> {
        let spec = agreement.spec;
        let observation = lane_service(spec, "observation");
        let action = lane_service(spec, "action");
        let wake = lane_service(spec, "wake");
        let wake_service = wake::create(node, &wake, 1)?;
        let action_service = services::create(node, &action, run, agreement)?;
        let actions =
            MessageReceiver::create(&action_service, &action, spec.action_pages(), spec.action_chunks())?;
        let observation_service = services::create(node, &observation, run, agreement)?;
        let capacity = SenderCapacity {
            pages: spec.observation_pages(),
            chunks: spec.observation_chunks(),
            loans: spec.in_flight as usize + 1,
        };
        let notifier = wake::create_notifier(&wake_service, &wake)?;
        let observations =
            MessageSender::create(node.domain(), &observation_service, &observation, notifier, capacity)?;
        Ok(Self {
            observations,
            actions,
            observation_service,
            _action_service: action_service,
            _wake_service: wake_service,
        })
    }

    /// Loans memory for an observation message of `n_pages` pages.
    ///
    /// # Errors
    /// If `n_pages` is 0 or exceeds the lane's maximum, more than `in_flight + 1` messages are on loan, or
    /// the host has released no memory for a second.
    pub fn loan(&mut self, n_pages: usize) -> Result<ObservationLoan, LinkError> {
        // Connect before the host can answer: then its answer survives even if the host exits immediately
        // afterwards.
        self.actions.connect()?;
        self.observations.loan(n_pages).map(ObservationLoan)
    }

    /// Returns the oldest unread action message, or `None` if there is none. Never blocks.
    ///
    /// # Errors
    /// If the sim already holds `in_flight` messages, or the message claims more pages than the lane allows.
    pub fn receive(&mut self) -> Result<Option<ActionMessage>, LinkError> {
        Ok(self.actions.receive()?.map(ActionMessage))
    }

    /// Returns `true` if a host is attached. A killed host stays attached until it is reaped.
    #[must_use]
    pub fn host_connected(&self) -> bool {
        self.observation_service.dynamic_config().number_of_subscribers() > 0
    }

    /// Returns the id of the attached host, or `None` if there is none. Every attachment has a unique id, so
    /// that a change reveals a replaced host. Messages sent to the previous host are lost.
    #[must_use]
    pub fn host_id(&self) -> Option<u128> {
        self.host().map(|(id, _)| id)
    }

    /// Returns `true` if a host is attached and its process is alive. Intended for foreign hosts, which have
    /// no parent here to wait for them. Queries the file system (about 0.2 ms). An exited host can briefly
    /// appear alive while another process cleans up after it.
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

/// An observation message that is being written.
pub struct ObservationLoan(Loan<ObservationHeader>);

impl ObservationLoan {
    /// Returns the message's pages, in shared memory. They still contain an earlier message: overwrite all of
    /// them.
    #[must_use]
    pub fn pages_mut(&mut self) -> &mut [Page] {
        self.0.pages_mut()
    }

    /// Sends the message to the host and wakes it. The header is sent unchecked; the host checks it against
    /// the pages.
    ///
    /// # Errors
    /// If no host is attached, or its queue has been full for a second. In both cases the message is lost.
    pub fn send(self, header: ObservationHeader) -> Result<(), LinkError> {
        self.0.send(header)
    }
}

/// An action message in the host's memory.
#[derive(Debug)]
pub struct ActionMessage(ReceivedMessage<ActionHeader>);

impl ActionMessage {
    /// Returns the header, unchecked.
    #[must_use]
    pub fn header(&self) -> &ActionHeader {
        self.0.user_header()
    }

    /// Returns the pages, one per env; [`crate::ActionView`] checks and reads them.
    #[must_use]
    pub fn pages(&self) -> &[Page] {
        self.0.payload()
    }
}
