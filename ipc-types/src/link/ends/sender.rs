//! Sending end of a lane, for either direction: messages are written in loaned shared memory and sent with a
//! deadline.

use std::mem::MaybeUninit;
use std::time::{Duration, Instant};

use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{BackpressureAction, LoanError, SendError};
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy, ZeroCopySend};
use iceoryx2::sample_mut_uninit::SampleMutUninit;

use crate::layout::Page;
use crate::link::domain::Domain;
use crate::link::ends::wake::WakeNotifier;
use crate::link::error::LinkError;
use crate::link::memory::prefault;
use crate::link::retry::AttemptError;
use crate::link::services::{MessageService, occupied, service_error};
use crate::link::type_names::Ipc;

/// Maximum time that a loan or a send waits for the peer to release memory.
const BACKPRESSURE_TIMEOUT: Duration = Duration::from_secs(1);
/// Interval at which a loan checks for released memory.
const POLL_INTERVAL: Duration = Duration::from_micros(50);

/// Limits of a [`MessageSender`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct SenderCapacity {
    /// Maximum number of pages in a message.
    pub(crate) pages: usize,
    /// Maximum number of messages in existence: on loan, queued, or held by the receiver.
    pub(crate) chunks: usize,
    /// Maximum number of messages on loan.
    pub(crate) loans: usize,
}

/// The sending end of a lane, for messages with header `H`. Owns the memory of its messages.
#[derive(Debug)]
pub(crate) struct MessageSender<H: ZeroCopySend + core::fmt::Debug + 'static> {
    publisher: Publisher<Ipc, [Page], H>,
    notifier: WakeNotifier,
    capacity: SenderCapacity,
}

/// Memory on loan for one message.
pub(crate) struct Loan<H: ZeroCopySend> {
    sample: SampleMutUninit<Ipc, [MaybeUninit<Page>], H>,
    notifier: WakeNotifier,
}

impl<H: ZeroCopySend + core::fmt::Debug + Default> MessageSender<H> {
    /// Attaches to `messages` as its sender and allocates all memory: reserves every chunk and prefaults as
    /// many as can be on loan. A lane whose peer keeps up uses only these, because chunks are reused last in,
    /// first out.
    pub(crate) fn create(
        domain: &Domain,
        messages: &MessageService<H>,
        service: &str,
        notifier: WakeNotifier,
        capacity: SenderCapacity,
    ) -> Result<Self, AttemptError> {
        let publisher = messages
            .publisher_builder()
            .initial_max_slice_len(capacity.pages)
            .max_loaned_samples(capacity.loans)
            .allocation_strategy(AllocationStrategy::Static)
            .override_sample_preallocation(move |_| capacity.chunks)
            .backpressure_strategy(BackpressureStrategy::RetryUntilDelivered)
            .set_backpressure_handler(|info| {
                let timed_out = info.elapsed_time >= BACKPRESSURE_TIMEOUT;
                if timed_out { BackpressureAction::DiscardDataAndFail } else { BackpressureAction::Retry }
            })
            .create()
            .map_err(|error| match error {
                PublisherCreateError::ExceedsMaxSupportedPublishers => {
                    AttemptError::Transient(occupied(service, &error))
                }
                _ => AttemptError::Permanent(service_error(service, &error)),
            })?;
        prefault::reserve(domain, publisher.id().value())?;
        let sender = Self { publisher, notifier, capacity };
        sender.populate()?;
        Ok(sender)
    }

    /// Loans memory for `n_pages` pages. Waits up to [`BACKPRESSURE_TIMEOUT`] for the peer to release memory.
    pub(crate) fn loan(&self, n_pages: usize) -> Result<Loan<H>, LinkError> {
        let max_pages = self.capacity.pages;
        if n_pages == 0 || n_pages > max_pages {
            return Err(LinkError::LoanSize { pages: n_pages, max_pages });
        }
        let mut since = None;
        loop {
            match self.publisher.loan_slice_uninit(n_pages) {
                Ok(sample) => return Ok(Loan { sample, notifier: self.notifier.clone() }),
                Err(LoanError::OutOfMemory) => {
                    let since = *since.get_or_insert_with(Instant::now);
                    if since.elapsed() >= BACKPRESSURE_TIMEOUT {
                        return Err(backpressure());
                    }
                    // Reclaims the messages held by a peer that has detached or been reaped.
                    let _ = self.publisher.update_connections();
                    std::thread::sleep(POLL_INTERVAL);
                }
                Err(source) => return Err(LinkError::Loan { pages: n_pages, source }),
            }
        }
    }

    fn populate(&self) -> Result<(), LinkError> {
        let mut loans = Vec::with_capacity(self.capacity.loans);
        for _ in 0..self.capacity.loans {
            loans.push(self.loan(self.capacity.pages)?);
        }
        loans.iter_mut().try_for_each(|loan| prefault::populate_for_writing(loan.sample.payload_mut()))
    }
}

impl<H: ZeroCopySend + core::fmt::Debug> Loan<H> {
    /// Returns the pages, which still contain the bytes of an earlier message.
    pub(crate) fn pages_mut(&mut self) -> &mut [Page] {
        let pages = self.sample.payload_mut();
        // SAFETY: the pages lie in a shared mapping that the kernel zeroed, so every byte is initialised, and
        // any value is a valid `Page` (it is Pod). `MaybeUninit<Page>` has the layout of `Page`. Until the
        // loan is sent, no other process accesses it, and the borrow of `self` excludes other accesses in
        // this one.
        unsafe { &mut *(core::ptr::from_mut(pages) as *mut [Page]) }
    }

    /// Sends the message and wakes the peer.
    pub(crate) fn send(mut self, header: H) -> Result<(), LinkError> {
        *self.sample.user_header_mut() = header;
        // SAFETY: as in `pages_mut`, every byte is initialised and any value is a valid `Page`.
        let n_receivers = unsafe { self.sample.assume_init() }.send().map_err(|error| match error {
            SendError::UnableToDeliver => backpressure(),
            _ => LinkError::Send(error),
        })?;
        if n_receivers == 0 {
            return Err(LinkError::NoPeer);
        }
        self.notifier.notify();
        Ok(())
    }
}

fn backpressure() -> LinkError {
    LinkError::Backpressure { waited_ms: BACKPRESSURE_TIMEOUT.as_millis() as u64 }
}
