//! The policy host: answers the observations of one lane until its parent closes its standard input.
//!
//! It owns the host end of the lane, the policy and the thread pool. It never starts or stops another
//! process. The parent detects that a sim has exited; the sim that replaces it connects to the same host.

mod guard;
mod pending;
mod protocol;
mod work_counter;

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use ipc_types::link::{HostLane, LinkError, LinkNode, ObservationMessage};
use ipc_types::{ActionBlock, ActionHeader, Morphology, ObservationHeader, ObservationView, SCHEMA_HASH};
use run_config::Lifeline;
use run_config::trace::{self, Activity, CpuTime};
use thiserror::Error;

pub use self::guard::CheckpointChangedError;
use self::guard::CheckpointGuard;
use self::pending::{PendingAnswer, QueryError};
pub use self::protocol::{HostConfig, HostEvent};
use self::work_counter::WorkCounter;
use crate::load::{LoadError, load_on};
use crate::policy::{ActionChunk, Policy, PolicyError, PolicyPipeline};

/// Maximum time for the sim to create the lane.
const OPEN_TIMEOUT: Duration = Duration::from_secs(60);
/// Time to poll for a message before blocking, longer than a fast sim needs for its next message.
const SPIN_TIME: Duration = Duration::from_micros(50);
/// Batches of a device's policy in flight: one is computed, one prepared.
const MAX_DEPTH: u32 = 2;
/// Maximum time to block, after which standard input is checked.
const WAIT_TIMEOUT: Duration = Duration::from_millis(100);
/// Time between two looks at a batch that a device computes and at the messages that wait meanwhile.
const DEVICE_POLL_TIME: Duration = Duration::from_micros(50);

/// Errors that can stop a policy host.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum ServeError {
    #[error(transparent)]
    Load(#[from] LoadError),
    #[error(transparent)]
    Changed(#[from] CheckpointChangedError),
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error("failed to start {threads} threads")]
    Threads { threads: usize, source: rayon::ThreadPoolBuildError },
    #[error("failed to start the thread that reads standard input")]
    Watch(#[source] io::Error),
    #[error("{0}")]
    Device(String),
    #[error("failed to write an event to the parent")]
    Report(#[source] io::Error),
}

/// Serves a lane, with events on standard output, and returns when standard input is closed.
///
/// # Errors
/// If the policy cannot be loaded, the link fails, or the parent no longer reads.
pub fn serve(config: HostConfig) -> Result<(), ServeError> {
    serve_with(config, Lifeline(io::stdin()), io::stdout())
}

/// Like [`serve`], with arbitrary streams.
///
/// # Errors
/// See [`serve`].
pub fn serve_with(
    config: HostConfig,
    input: impl Read + Send + 'static,
    output: impl Write + Send,
) -> Result<(), ServeError> {
    let closed = watch(input)?;
    if config.run.resources.trace.is_some() {
        trace::enable();
    }
    let threads = config.run.resources.n_threads() as usize;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|source| ServeError::Threads { threads, source })?;
    let started = Instant::now();
    let (device, mode) = ((&config.run).into(), config.execution.mode);
    let images = config.run.results.protocol.image_size;
    let guard = CheckpointGuard::new(&config)?;
    let loaded =
        pool.install(|| load_on(&config.spec, device, threads, mode, (&config.morphologies, images)));
    // First, since files that change meanwhile may also be the reason why they cannot be loaded.
    guard.as_ref().map_or(Ok(()), CheckpointGuard::check_loaded)?;
    let mut policy = loaded?;
    if config.run.results.latency_steps() > 0 {
        // The robot goes on with the rows after those to execute until the next chunk takes effect.
        policy.compute_whole_chunks();
    }
    let load_ms = started.elapsed().as_secs_f64() * 1e3;
    // The loop itself runs in the pool, so that a query needs no hand-over between threads.
    pool.install(move || {
        let node = LinkNode::new(&config.domain, "policy-host")?;
        let is_wanted = || !closed.load(Ordering::Relaxed);
        let lane = match HostLane::open_while(&node, &config.lane, OPEN_TIMEOUT, &is_wanted) {
            Err(_) if !is_wanted() => return Ok(()),
            opened => opened?,
        };
        let chunks = vec![ActionChunk::default(); config.lane.max_envs.max(1) as usize];
        let depth = if policy.pipeline().is_some() { config.lane.in_flight.clamp(1, MAX_DEPTH) } else { 1 };
        let mut host = Host {
            config,
            lane,
            policy,
            guard,
            depth: depth as usize,
            pending: VecDeque::new(),
            chunks,
            output,
            ledger: WorkCounter::new(),
        };
        let started = Instant::now();
        let flop_per_s = host.policy.run_benchmark() as f64 / started.elapsed().as_secs_f64();
        if let Some(message) = host.policy.startup_message(host.config.execution.execute, flop_per_s) {
            host.report(&HostEvent::Note { message })?;
        }
        host.report(&HostEvent::Ready { load_ms })?;
        host.run(&closed)
    })
}

/// Spawns a thread that sets the returned flag when `input` reaches its end.
fn watch(mut input: impl Read + Send + 'static) -> Result<Arc<AtomicBool>, ServeError> {
    let closed = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&closed);
    let wait_for_end = move || {
        // The content of the input is irrelevant, and an error is treated like the end.
        let _ = io::copy(&mut input, &mut io::sink());
        flag.store(true, Ordering::Relaxed);
    };
    std::thread::Builder::new().name("stdin".to_owned()).spawn(wait_for_end).map_err(ServeError::Watch)?;
    Ok(closed)
}

struct Host<W> {
    config: HostConfig,
    lane: HostLane,
    policy: Box<dyn Policy>,
    guard: Option<CheckpointGuard>,
    /// Number of observations that are held at a time.
    depth: usize,
    /// Observations without an answer, oldest first.
    pending: VecDeque<PendingAnswer>,
    /// Chunks of the current answer, allocated for the largest batch.
    chunks: Vec<ActionChunk>,
    output: W,
    ledger: WorkCounter,
}

impl<W: Write> Host<W> {
    fn run(&mut self, closed: &AtomicBool) -> Result<(), ServeError> {
        let mut last_message = Instant::now();
        while !closed.load(Ordering::Relaxed) {
            if self.pending.len() < self.depth
                && let Some(message) = self.lane.receive()?
            {
                self.begin(message);
                last_message = Instant::now();
            } else if self.is_answer_due() {
                self.answer()?;
                last_message = Instant::now();
            } else if !self.pending.is_empty() {
                std::thread::sleep(DEVICE_POLL_TIME);
            } else if last_message.elapsed() < SPIN_TIME {
                std::hint::spin_loop();
            } else {
                let waiting = trace::span(Activity::Wait);
                self.lane.wait(WAIT_TIMEOUT)?;
                waiting.finish(0);
                last_message = Instant::now();
            }
            if let Some(event) = self.ledger.due() {
                self.report(&event)?;
                self.report_spans()?;
            }
        }
        self.report_spans()?;
        let event = self.ledger.event();
        self.report(&event)
    }

    /// Starts computing the answer to a message, if the policy has a pipeline.
    fn begin(&mut self, message: ObservationMessage) {
        let mut pending = PendingAnswer { header: *message.header(), message, submitted: Ok(()) };
        if let Some(pipeline) = self.policy.pipeline() {
            let start = (CpuTime::of_process(), Instant::now());
            let inferring = trace::span(Activity::Infer);
            let submit = |view: ObservationView<'_>| pipeline.submit(&view).map_err(QueryError::from);
            pending.submitted = pending.view(&self.config).and_then(submit);
            inferring.finish(0);
            if pending.submitted.is_ok() {
                self.ledger.device_has_batch(start);
            }
        }
        self.pending.push_back(pending);
    }

    /// Returns `true` if nothing waits for the oldest answer.
    fn is_answer_due(&mut self) -> bool {
        self.pending.front().is_some_and(|pending| {
            pending.submitted.is_err() || self.policy.pipeline().is_none_or(PolicyPipeline::is_ready)
        })
    }

    /// Answers the oldest observation.
    fn answer(&mut self) -> Result<(), ServeError> {
        let Some(mut pending) = self.pending.pop_front() else { return Ok(()) };
        let header = pending.header;
        let n_envs = header.n_envs.clamp(1, self.config.lane.max_envs.max(1));
        let mut loan = self.lane.loan(n_envs as usize)?;
        let start = CpuTime::of_process();
        let inferring = trace::span(Activity::Infer);
        let outcome = self.act(&mut pending, loan.blocks_mut());
        // After the policy has read it: then the answer is to what was sent, or there is none.
        let outcome = self.check_frame(header, &pending.message).and(outcome);
        // Likewise: what has not changed by now had not when the policy read it.
        self.guard.as_ref().map_or(Ok(()), CheckpointGuard::check_mapped)?;
        inferring.finish(n_envs.into());
        if self.policy.pipeline().is_none() {
            self.ledger.add_time(start);
        } else if self.pending.iter().all(|pending| pending.submitted.is_err()) {
            self.ledger.device_is_idle();
        }
        self.ledger.add_batch(n_envs);
        if outcome.is_ok() {
            self.ledger.flop += u64::from(n_envs) * self.flop_per_query(header.morphology);
        }
        if let Err(QueryError::Policy(PolicyError::Device { message })) = outcome {
            // The device will not answer the next query either. Without an answer, the episodes run again.
            return Err(ServeError::Device(message));
        }
        let mut status = 0;
        if let Err(error) = outcome {
            status = if error.is_damage() { ActionHeader::DAMAGED } else { 1 };
            loan.blocks_mut().fill(ActionBlock { n_rows: 1, action_dim: 1, ..ActionBlock::zeroed() });
            self.report(&HostEvent::Failed { message: run_config::error_chain(&error) })?;
        }
        drop(pending);
        let ObservationHeader { run, sequence, epoch, .. } = header;
        let schema_hash = SCHEMA_HASH;
        let answer = ActionHeader { schema_hash, run, sequence, epoch, n_envs, status, ..Zeroable::zeroed() };
        let checks = self.config.run.resources.check_frames;
        let answer = if checks { loan.with_checksum(answer) } else { answer };
        match loan.send(answer) {
            // The sim has exited since it sent the observation; its replacement will send a new one.
            Err(LinkError::NoPeer) => Ok(()),
            sent => Ok(sent?),
        }
    }

    fn act(&mut self, pending: &mut PendingAnswer, blocks: &mut [ActionBlock]) -> Result<(), QueryError> {
        std::mem::replace(&mut pending.submitted, Ok(()))?;
        let view = pending.view(&self.config);
        let chunks = &mut self.chunks[..blocks.len()];
        let view = match (self.policy.pipeline(), view) {
            (None, view) => {
                let view = view?;
                self.policy.act(&view, chunks)?;
                view
            }
            (Some(pipeline), Ok(view)) => {
                pipeline.collect(&view, chunks)?;
                view
            }
            (Some(pipeline), Err(error)) => {
                // It was overwritten since.
                pipeline.discard()?;
                return Err(error);
            }
        };
        for (env_idx, (chunk, block)) in chunks.iter().zip(blocks).enumerate() {
            chunk.write(view.env(env_idx).record, block);
        }
        Ok(())
    }

    fn check_frame(&self, header: ObservationHeader, message: &ObservationMessage) -> Result<(), QueryError> {
        if self.config.run.resources.check_frames {
            header.check_checksum(message.pages()).map_err(QueryError::Damaged)?;
        }
        Ok(())
    }

    fn flop_per_query(&self, morphology: u32) -> u64 {
        let execute = self.config.execution.execute;
        Morphology::from_code(morphology)
            .map_or(0, |morphology| self.policy.flop_per_query(morphology, execute))
    }

    fn report_spans(&mut self) -> Result<(), ServeError> {
        let spans = trace::take();
        if spans.is_empty() { Ok(()) } else { self.report(&HostEvent::Spans(spans)) }
    }

    fn report(&mut self, event: &HostEvent) -> Result<(), ServeError> {
        let line = serde_json::to_string(event).map_err(|error| ServeError::Report(error.into()))?;
        writeln!(self.output, "{line}").and_then(|()| self.output.flush()).map_err(ServeError::Report)
    }
}
