//! Sending: memory on loan, written in place, handed over with a deadline. The same for both directions.

use std::mem::MaybeUninit;
use std::time::{Duration, Instant};

use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{BackpressureAction, LoanError, SendError};
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy, ZeroCopySend};
use iceoryx2::sample_mut_uninit::SampleMutUninit;

use super::domain::Domain;
use super::error::LinkError;
use super::prefault;
use super::retry::Attempt;
use super::services::{Messages, failed, occupied};
use super::type_names::Ipc;
use super::wake::WakeNotifier;
use crate::layout::Page;

/// Longest time that a loan or a send waits for a peer that releases nothing.
const DEADLINE: Duration = Duration::from_secs(1);
/// Pause between two looks for released memory.
const PAUSE: Duration = Duration::from_micros(50);

/// How much an outlet may hold.
#[derive(Clone, Copy, Debug)]
pub(super) struct Capacity {
    /// Most pages in a message.
    pub(super) pages: usize,
    /// Messages that exist at a time, wherever they are.
    pub(super) chunks: usize,
    /// Messages on loan at a time.
    pub(super) loans: usize,
}

/// The sending end of a lane, with all its memory.
#[derive(Debug)]
pub(super) struct MessageSender<H: ZeroCopySend + core::fmt::Debug + 'static> {
    publisher: Publisher<Ipc, [Page], H>,
    bell: WakeNotifier,
    capacity: Capacity,
}

/// Memory on loan for one message.
pub(super) struct Loan<H: ZeroCopySend> {
    sample: SampleMutUninit<Ipc, [MaybeUninit<Page>], H>,
    bell: WakeNotifier,
}

impl<H: ZeroCopySend + core::fmt::Debug + Default> MessageSender<H> {
    /// Attaches to the sending end of `messages` and takes its memory: reserves all of it, maps what can be on loan (which
    /// is what a lane in step uses, for memory is re-used last in, first out).
    pub(super) fn create(
        domain: &Domain,
        messages: &Messages<H>,
        service: &str,
        bell: WakeNotifier,
        capacity: Capacity,
    ) -> Result<Self, Attempt> {
        let publisher = messages
            .publisher_builder()
            .initial_max_slice_len(capacity.pages)
            .max_loaned_samples(capacity.loans)
            .allocation_strategy(AllocationStrategy::Static)
            .override_sample_preallocation(move |_| capacity.chunks)
            .backpressure_strategy(BackpressureStrategy::RetryUntilDelivered)
            .set_backpressure_handler(|info| {
                let out_of_time = info.elapsed_time >= DEADLINE;
                if out_of_time { BackpressureAction::DiscardDataAndFail } else { BackpressureAction::Retry }
            })
            .create()
            .map_err(|error| match error {
                PublisherCreateError::ExceedsMaxSupportedPublishers => {
                    Attempt::Later(occupied(service, &error))
                }
                _ => Attempt::Never(failed(service, &error)),
            })?;
        prefault::reserve(domain, publisher.id().value())?;
        let outlet = Self { publisher, bell, capacity };
        outlet.populate()?;
        Ok(outlet)
    }

    /// Memory for `n_pages` pages; waits, at most a second, for the peer to release some.
    pub(super) fn loan(&self, n_pages: usize) -> Result<Loan<H>, LinkError> {
        let max_pages = self.capacity.pages;
        if n_pages == 0 || n_pages > max_pages {
            return Err(LinkError::LoanSize { pages: n_pages, max_pages });
        }
        let mut since = None;
        loop {
            match self.publisher.loan_slice_uninit(n_pages) {
                Ok(sample) => return Ok(Loan { sample, bell: self.bell.clone() }),
                Err(LoanError::OutOfMemory) => {
                    let since = *since.get_or_insert_with(Instant::now);
                    if since.elapsed() >= DEADLINE {
                        return Err(LinkError::Backpressure { waited_ms: DEADLINE.as_millis() as u64 });
                    }
                    // Takes back what a peer held that has left or been reaped.
                    let _ = self.publisher.update_connections();
                    std::thread::sleep(PAUSE);
                }
                Err(source) => return Err(LinkError::Loan { pages: n_pages, source }),
            }
        }
    }

    fn populate(&self) -> Result<(), LinkError> {
        let mut held = Vec::with_capacity(self.capacity.loans);
        for _ in 0..self.capacity.loans {
            held.push(self.loan(self.capacity.pages)?);
        }
        held.iter_mut().try_for_each(|loan| prefault::populate_for_writing(loan.sample.payload_mut()))
    }
}

impl<H: ZeroCopySend + core::fmt::Debug> Loan<H> {
    /// The pages, with whatever an earlier message left in them.
    pub(super) fn pages_mut(&mut self) -> &mut [Page] {
        let pages = self.sample.payload_mut();
        // SAFETY: the pages lie in a shared mapping that the kernel zeroed, so that every byte of them has a value, and any
        // value is a valid `Page` (it is Pod). `MaybeUninit<Page>` has the layout of `Page`. The loan is ours alone until it
        // is sent: nobody reads or writes it meanwhile, and the borrow of `self` keeps it so.
        unsafe { &mut *(core::ptr::from_mut(pages) as *mut [Page]) }
    }

    /// Hands the message over and wakes the peer.
    pub(super) fn send(mut self, header: H) -> Result<(), LinkError> {
        *self.sample.user_header_mut() = header;
        // SAFETY: as in `pages_mut`: every byte of shared memory has a value, and any value is a valid `Page`.
        let n_receivers = unsafe { self.sample.assume_init() }.send().map_err(|error| match error {
            SendError::UnableToDeliver => LinkError::Backpressure { waited_ms: DEADLINE.as_millis() as u64 },
            _ => LinkError::Send(error),
        })?;
        if n_receivers == 0 {
            return Err(LinkError::NoPeer);
        }
        self.bell.ring();
        Ok(())
    }
}
