//! Receiving: messages read where the sender wrote them. The same for both directions.

use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::{PayloadHeader as _, ZeroCopySend};
use iceoryx2::sample::Sample;

use super::error::LinkError;
use super::prefault;
use super::retry::Attempt;
use super::services::{Messages, failed, occupied};
use super::type_names::Ipc;
use crate::layout::Page;

/// A received message; the sender cannot re-use its memory while this lives.
pub(super) type Received<H> = Sample<Ipc, [Page], H>;

/// The receiving end of a lane.
#[derive(Debug)]
pub(super) struct MessageReceiver<H: ZeroCopySend + core::fmt::Debug + 'static> {
    subscriber: Subscriber<Ipc, [Page], H>,
    /// Most pages in a message.
    pages: usize,
    mapped: Mapped,
}

/// Chunks of the present sender that have been mapped for reading.
#[derive(Debug)]
struct Mapped {
    sender: Option<UniquePublisherId>,
    /// Addresses of their first pages. As long as the sender has chunks, so that it never grows.
    chunks: Vec<usize>,
}

impl<H: ZeroCopySend + core::fmt::Debug> MessageReceiver<H> {
    /// Attaches to the receiving end of `messages`, of at most `pages` pages, in one of `chunks` places in memory.
    pub(super) fn create(
        messages: &Messages<H>,
        service: &str,
        pages: usize,
        chunks: usize,
    ) -> Result<Self, Attempt> {
        let subscriber = messages.subscriber_builder().create().map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
                Attempt::Later(occupied(service, &error))
            }
            _ => Attempt::Never(failed(service, &error)),
        })?;
        let mapped = Mapped { sender: None, chunks: Vec::with_capacity(chunks) };
        Ok(Self { subscriber, pages, mapped })
    }

    /// Connects to a sender that has come since the last look: what it sends from now on outlives it.
    pub(super) fn connect(&self) -> Result<(), LinkError> {
        self.subscriber.update_connections().map_err(|error| LinkError::Receive(error.into()))
    }

    /// The oldest message not received yet. Returns at once.
    pub(super) fn receive(&mut self) -> Result<Option<Received<H>>, LinkError> {
        let Some(sample) = self.subscriber.receive().map_err(LinkError::Receive)? else { return Ok(None) };
        // The length is the sender's word, and a slice is made of it: it must be checked before the first access.
        let pages = sample.header().number_of_elements();
        if pages > self.pages as u64 {
            return Err(LinkError::Oversized { pages, max_pages: self.pages });
        }
        self.mapped.see(&sample, self.pages);
        Ok(Some(sample))
    }
}

impl Mapped {
    /// Maps the whole chunk in which a message lies when one comes in it for the first time.
    fn see<H: ZeroCopySend + core::fmt::Debug>(&mut self, sample: &Received<H>, pages: usize) {
        if self.sender != Some(sample.origin()) {
            self.sender = Some(sample.origin());
            self.chunks.clear();
        }
        let address = sample.payload().as_ptr().addr();
        if self.chunks.len() < self.chunks.capacity() && !self.chunks.contains(&address) {
            prefault::populate_for_reading(sample.payload(), pages);
            self.chunks.push(address);
        }
    }
}
