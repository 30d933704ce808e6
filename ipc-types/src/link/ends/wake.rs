//! Events that end a peer's wait. An event carries no data: after a wake-up the process polls for messages.

use std::sync::Arc;
use std::time::Duration;

use iceoryx2::port::listener::{Listener, ListenerCreateError, ListenerWaitError};
use iceoryx2::port::notifier::{Notifier, NotifierCreateError};
use iceoryx2::prelude::EventId;
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::port_factory::event::PortFactory;

use crate::link::error::LinkError;
use crate::link::node::LinkNode;
use crate::link::retry::AttemptError;
use crate::link::services::{occupied, service_error, service_name};
use crate::link::type_names::Ipc;

/// Name of the event that wakes the sim.
pub(crate) const SIM_WAKE: &str = "hyp/sim/wake";
/// The only event id. iceoryx2 also sends it when a peer is reaped.
const WAKE: EventId = EventId::new(0);
/// Processes that may have an event open besides its notifiers: the listener, and exited processes not reaped
/// yet.
const SPARE_NODES: usize = 16;

/// The waiting side of an event.
#[derive(Debug)]
pub(crate) struct WakeListener {
    listener: Listener<Ipc>,
}

/// The notifying side of an event, shared by all messages on loan.
#[derive(Clone, Debug)]
pub(crate) struct WakeNotifier {
    notifier: Arc<Notifier<Ipc>>,
}

impl WakeListener {
    /// Waits for a notification, a signal, or the end of `timeout`. Returns at once if notifications have
    /// arrived since the last wait, and consumes all of them.
    pub(crate) fn wait(&self, timeout: Duration) -> Result<(), LinkError> {
        // iceoryx2 passes the timeout to a socket in whole microseconds, and a socket treats 0 as infinite
        // (SO_RCVTIMEO in socket(7)).
        let outcome = if timeout < Duration::from_micros(1) {
            self.listener.try_wait(|_| ())
        } else {
            self.listener.timed_wait(|_| (), timeout)
        };
        match outcome {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(error) => Err(LinkError::Wait(error)),
        }
    }
}

impl WakeNotifier {
    /// Wakes the peer. A lost notification is not an error, because every wait has a timeout.
    pub(crate) fn notify(&self) {
        let _ = self.notifier.notify();
    }
}

/// Creates the event `event` on behalf of the sim, or opens it if it exists.
pub(crate) fn create(
    node: &LinkNode,
    event: &str,
    n_notifiers: usize,
) -> Result<PortFactory<Ipc>, AttemptError> {
    use EventOpenOrCreateError::{EventCreateError as Create, EventOpenError as Open, SystemInFlux};
    node.inner()
        .service_builder(&service_name(event)?)
        .event()
        .max_listeners(1)
        .max_notifiers(n_notifiers)
        .max_nodes(n_notifiers + SPARE_NODES)
        .event_id_max_value(WAKE.as_value())
        .notifier_dead_event(WAKE)
        .open_or_create()
        .map_err(|error| match error {
            Open(error) => open_failure(event, error),
            Create(EventCreateError::AlreadyExists | EventCreateError::IsBeingCreatedByAnotherInstance)
            | SystemInFlux => AttemptError::Transient(service_error(event, &error)),
            Create(_) => AttemptError::Permanent(service_error(event, &error)),
        })
}

/// Opens the event `event`, created by the sim, on behalf of a host.
pub(crate) fn open(node: &LinkNode, event: &str) -> Result<PortFactory<Ipc>, AttemptError> {
    let builder = node.inner().service_builder(&service_name(event)?).event();
    builder.open().map_err(|error| open_failure(event, error))
}

/// Creates the event's only listener.
pub(crate) fn create_listener(service: &PortFactory<Ipc>, event: &str) -> Result<WakeListener, AttemptError> {
    match service.listener_builder().create() {
        Ok(listener) => Ok(WakeListener { listener }),
        Err(error @ ListenerCreateError::ExceedsMaxSupportedListeners) => {
            Err(AttemptError::Transient(occupied(event, &error)))
        }
        Err(error) => Err(AttemptError::Permanent(service_error(event, &error))),
    }
}

/// Creates a notifier of the event.
pub(crate) fn create_notifier(service: &PortFactory<Ipc>, event: &str) -> Result<WakeNotifier, AttemptError> {
    match service.notifier_builder().default_event_id(WAKE).create() {
        Ok(notifier) => Ok(WakeNotifier { notifier: Arc::new(notifier) }),
        Err(error @ NotifierCreateError::ExceedsMaxSupportedNotifiers) => {
            Err(AttemptError::Transient(occupied(event, &error)))
        }
        Err(error) => Err(AttemptError::Permanent(service_error(event, &error))),
    }
}

fn open_failure(event: &str, error: EventOpenError) -> AttemptError {
    use EventOpenError as E;
    match error {
        E::DoesNotExist | E::HangsInCreation | E::IsMarkedForDestruction => {
            AttemptError::Transient(LinkError::Absent { service: event.into() })
        }
        E::ExceedsMaxNumberOfNodes => AttemptError::Transient(occupied(event, &error)),
        E::Interrupt => AttemptError::Transient(service_error(event, &error)),
        _ => AttemptError::Permanent(service_error(event, &error)),
    }
}
