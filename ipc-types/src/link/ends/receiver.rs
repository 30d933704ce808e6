//! Receiving end of a lane, for either direction: messages are read in the sender's memory.

use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::{PayloadHeader as _, ZeroCopySend};
use iceoryx2::sample::Sample;

use crate::layout::Page;
use crate::link::error::LinkError;
use crate::link::memory::prefault;
use crate::link::retry::AttemptError;
use crate::link::services::{MessageService, occupied, service_error};
use crate::link::type_names::Ipc;

/// A received message. The sender cannot reuse its memory until it is dropped.
pub(crate) type ReceivedMessage<H> = Sample<Ipc, [Page], H>;

/// The receiving end of a lane, for messages with header `H`.
#[derive(Debug)]
pub(crate) struct MessageReceiver<H: ZeroCopySend + core::fmt::Debug + 'static> {
    subscriber: Subscriber<Ipc, [Page], H>,
    /// Maximum number of pages in a message.
    max_pages: usize,
    mapped: MappedChunks,
}

/// The current sender's chunks that have been prefaulted for reading.
#[derive(Debug)]
struct MappedChunks {
    sender: Option<UniquePublisherId>,
    /// Address of each chunk's first page. Allocated for all of the sender's chunks, so that it never grows.
    addresses: Vec<usize>,
}

impl<H: ZeroCopySend + core::fmt::Debug> MessageReceiver<H> {
    /// Attaches to `messages`, whose sender has `n_chunks` chunks of at most `max_pages` pages.
    pub(crate) fn create(
        messages: &MessageService<H>,
        service: &str,
        max_pages: usize,
        n_chunks: usize,
    ) -> Result<Self, AttemptError> {
        let subscriber = messages.subscriber_builder().create().map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
                AttemptError::Transient(occupied(service, &error))
            }
            _ => AttemptError::Permanent(service_error(service, &error)),
        })?;
        let mapped = MappedChunks { sender: None, addresses: Vec::with_capacity(n_chunks) };
        Ok(Self { subscriber, max_pages, mapped })
    }

    /// Connects to a sender that has attached since the last call. Messages it sends from now on remain
    /// readable after it exits.
    pub(crate) fn connect(&self) -> Result<(), LinkError> {
        self.subscriber.update_connections().map_err(|error| LinkError::Receive(error.into()))
    }

    /// Returns the oldest unread message, or `None` if there is none. Never blocks.
    pub(crate) fn receive(&mut self) -> Result<Option<ReceivedMessage<H>>, LinkError> {
        let Some(sample) = self.subscriber.receive().map_err(LinkError::Receive)? else { return Ok(None) };
        // The sender states the length, from which the payload slice is made: check it before the first
        // access.
        let pages = sample.header().number_of_elements();
        if pages > self.max_pages as u64 {
            return Err(LinkError::Oversized { pages, max_pages: self.max_pages });
        }
        self.mapped.prefault_if_new(&sample, self.max_pages);
        Ok(Some(sample))
    }
}

impl MappedChunks {
    /// Prefaults the whole chunk that holds `sample`, the first time a message arrives in that chunk.
    fn prefault_if_new<H: ZeroCopySend + core::fmt::Debug>(
        &mut self,
        sample: &ReceivedMessage<H>,
        max_pages: usize,
    ) {
        if self.sender != Some(sample.origin()) {
            self.sender = Some(sample.origin());
            self.addresses.clear();
        }
        let address = sample.payload().as_ptr().addr();
        if self.addresses.len() < self.addresses.capacity() && !self.addresses.contains(&address) {
            prefault::populate_for_reading(sample.payload(), max_pages);
            self.addresses.push(address);
        }
    }
}
