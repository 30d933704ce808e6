//! Events that end a peer's wait. They carry nothing: whoever wakes looks for messages.

use std::sync::Arc;
use std::time::Duration;

use iceoryx2::port::listener::{Listener, ListenerCreateError, ListenerWaitError};
use iceoryx2::port::notifier::{Notifier, NotifierCreateError};
use iceoryx2::prelude::EventId;
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::port_factory::event::PortFactory;

use super::error::LinkError;
use super::node::LinkNode;
use super::retry::Attempt;
use super::services::{failed, occupied, service_name};
use super::type_names::Ipc;

/// Name of the event that wakes the sim.
pub(super) const SIM_WAKE: &str = "hyp/sim/wake";
/// The only event there is. A reaped peer rings it too.
const RING: EventId = EventId::new(0);
/// Processes that may know an event beside its notifiers: the listener, and those that have died and are not reaped yet.
const SPARE_NODES: usize = 16;

/// The side that waits.
#[derive(Debug)]
pub(super) struct WakeListener {
    listener: Listener<Ipc>,
}

/// The side that wakes; shared by everything that sends.
#[derive(Clone, Debug)]
pub(super) struct WakeNotifier {
    notifier: Arc<Notifier<Ipc>>,
}

impl WakeListener {
    /// Waits until the bell has rung or `timeout` is over; rings that came before count, and are forgotten. A signal ends
    /// it too.
    pub(super) fn wait(&self, timeout: Duration) -> Result<(), LinkError> {
        // The timeout becomes a socket's, in whole microseconds, and a socket takes 0 for ever.
        let rung = if timeout < Duration::from_micros(1) {
            self.listener.try_wait(|_| ())
        } else {
            self.listener.timed_wait(|_| (), timeout)
        };
        match rung {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(error) => Err(LinkError::Wait(error)),
        }
    }
}

impl WakeNotifier {
    /// Ends the peer's wait. A ring that nobody hears is no failure: every wait ends by itself.
    pub(super) fn ring(&self) {
        let _ = self.notifier.notify();
    }
}

/// The sim's side of an event: it exists once this has succeeded.
pub(super) fn create(node: &LinkNode, event: &str, n_notifiers: usize) -> Result<PortFactory<Ipc>, Attempt> {
    use EventOpenOrCreateError::{EventCreateError as Create, EventOpenError as Open, SystemInFlux};
    node.inner()
        .service_builder(&service_name(event)?)
        .event()
        .max_listeners(1)
        .max_notifiers(n_notifiers)
        .max_nodes(n_notifiers + SPARE_NODES)
        .event_id_max_value(RING.as_value())
        .notifier_dead_event(RING)
        .open_or_create()
        .map_err(|error| match error {
            Open(error) => open_failure(event, error),
            Create(EventCreateError::AlreadyExists | EventCreateError::IsBeingCreatedByAnotherInstance)
            | SystemInFlux => Attempt::Later(failed(event, &error)),
            Create(_) => Attempt::Never(failed(event, &error)),
        })
}

/// The host's side of an event.
pub(super) fn open(node: &LinkNode, event: &str) -> Result<PortFactory<Ipc>, Attempt> {
    let builder = node.inner().service_builder(&service_name(event)?).event();
    builder.open().map_err(|error| open_failure(event, error))
}

/// The one place from which an event is awaited.
pub(super) fn listen(service: &PortFactory<Ipc>, event: &str) -> Result<WakeListener, Attempt> {
    match service.listener_builder().create() {
        Ok(listener) => Ok(WakeListener { listener }),
        Err(error @ ListenerCreateError::ExceedsMaxSupportedListeners) => {
            Err(Attempt::Later(occupied(event, &error)))
        }
        Err(error) => Err(Attempt::Never(failed(event, &error))),
    }
}

/// A place from which an event is rung.
pub(super) fn notify(service: &PortFactory<Ipc>, event: &str) -> Result<WakeNotifier, Attempt> {
    match service.notifier_builder().default_event_id(RING).create() {
        Ok(notifier) => Ok(WakeNotifier { notifier: Arc::new(notifier) }),
        Err(error @ NotifierCreateError::ExceedsMaxSupportedNotifiers) => {
            Err(Attempt::Later(occupied(event, &error)))
        }
        Err(error) => Err(Attempt::Never(failed(event, &error))),
    }
}

fn open_failure(event: &str, error: EventOpenError) -> Attempt {
    use EventOpenError as E;
    match error {
        E::DoesNotExist | E::HangsInCreation | E::IsMarkedForDestruction => {
            Attempt::Later(LinkError::Absent { service: event.into() })
        }
        E::ExceedsMaxNumberOfNodes => Attempt::Later(occupied(event, &error)),
        E::Interrupt => Attempt::Later(failed(event, &error)),
        _ => Attempt::Never(failed(event, &error)),
    }
}
