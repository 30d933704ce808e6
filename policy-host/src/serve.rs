//! A policy host: answers the observations of one lane until its parent closes its standard input.
//!
//! It owns the lane's host end, the policy and the thread pool. It never starts or ends another process; that a sim has
//! died is its parent's to notice, and a sim that takes the place of a dead one finds the same host.

use std::io::{self, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use cpu_time::ProcessTime;
use ipc_types::link::{Domain, HostLane, LaneSpec, LinkError, LinkNode, ObservationMessage};
use ipc_types::{
    ActionBlock, ActionHeader, FrameError, ObservationHeader, ObservationView, RunConfig, SCHEMA_HASH,
};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::PolicySpec;
use crate::load::{LoadError, load};
use crate::policy::{ActionChunk, Policy, PolicyError};

/// How long a sim may take to create the lane.
const OPEN_PATIENCE: Duration = Duration::from_secs(60);
/// How long to look for a message before sleeping: longer than a fast sim needs for its next one.
const SPIN: Duration = Duration::from_micros(50);
/// Longest sleep, after which standard input is checked.
const NAP: Duration = Duration::from_millis(100);
/// Shortest time between two ledgers.
const LEDGER_PERIOD: Duration = Duration::from_secs(1);

/// What a host is told when it starts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HostConfig {
    /// Where the run's shared memory lives.
    pub domain: Domain,
    /// Random number of the run; observations of another run are refused.
    pub run_id: u64,
    /// The lane to serve.
    pub lane: LaneSpec,
    /// The policy to load.
    pub spec: PolicySpec,
    /// Options of the run.
    pub run: RunConfig,
}

/// What a host tells its parent: one JSON object a line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum HostEvent {
    /// The policy is loaded and the lane is open.
    Ready {
        /// Time taken to load the policy.
        load_ms: f64,
    },
    /// Work done so far; at most one a second, and one at the end.
    Ledger {
        /// Envs answered.
        queries: u64,
        /// Observation messages answered.
        batches: u64,
        /// Core-seconds spent in the policy.
        busy_s: f64,
    },
    /// A message could not be answered; the host goes on.
    Failed {
        /// Why.
        message: String,
    },
}

/// A host that cannot start or go on.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum ServeError {
    #[error(transparent)]
    Load(#[from] LoadError),
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error("start {threads} threads: {source}")]
    Threads { threads: usize, source: rayon::ThreadPoolBuildError },
    #[error("watch standard input: {0}")]
    Watch(io::Error),
    #[error("report to the parent: {0}")]
    Report(io::Error),
}

/// An observation that was not answered with actions.
#[derive(Debug, Error)]
enum Refusal {
    #[error(transparent)]
    Frame(#[from] FrameError),
    #[error("read an observation of run {found:#x}: this host serves run {expected:#x}")]
    Run { expected: u64, found: u64 },
    #[error("answer {found} envs: the lane has {limit}")]
    Envs { found: u32, limit: u32 },
    #[error(transparent)]
    Policy(#[from] PolicyError),
}

/// Serves the lane of this process: events go to standard output; returns once standard input is closed.
///
/// # Errors
/// If the policy cannot be loaded, the link fails, or the parent no longer reads.
pub fn serve(config: HostConfig) -> Result<(), ServeError> {
    serve_with(config, io::stdin(), io::stdout())
}

/// As [`serve`], between any two streams.
///
/// # Errors
/// As [`serve`].
pub fn serve_with(
    config: HostConfig,
    input: impl Read + Send + 'static,
    output: impl Write + Send,
) -> Result<(), ServeError> {
    let closed = watch(input)?;
    let threads = config.run.resources.threads as usize;
    let started = Instant::now();
    let policy = load(&config.spec, threads, config.run.results.mode)?;
    let load_ms = started.elapsed().as_secs_f64() * 1e3;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|source| ServeError::Threads { threads, source })?;
    // The loop itself runs in the pool, so that a query starts without a hand-over between threads.
    pool.install(move || {
        let node = LinkNode::new(&config.domain, "policy-host")?;
        let lane = HostLane::open(&node, &config.lane, OPEN_PATIENCE)?;
        let chunks = vec![ActionChunk::default(); config.lane.max_envs.max(1) as usize];
        let mut host = Host { config, lane, policy, chunks, output, ledger: Ledger::new() };
        host.report(&HostEvent::Ready { load_ms })?;
        host.run(&closed)
    })
}

/// Sets the returned flag once `input` has ended.
fn watch(mut input: impl Read + Send + 'static) -> Result<Arc<AtomicBool>, ServeError> {
    let closed = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&closed);
    let wait_for_end = move || {
        // What a parent writes means nothing; an error is as good as the end.
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
    /// The answer at hand, as long as the longest.
    chunks: Vec<ActionChunk>,
    output: W,
    ledger: Ledger,
}

impl<W: Write> Host<W> {
    fn run(&mut self, closed: &AtomicBool) -> Result<(), ServeError> {
        let mut last_message = Instant::now();
        while !closed.load(Ordering::Relaxed) {
            if let Some(message) = self.lane.receive()? {
                self.answer(message)?;
                last_message = Instant::now();
            } else if last_message.elapsed() < SPIN {
                std::hint::spin_loop();
            } else {
                self.lane.wait(NAP)?;
                last_message = Instant::now();
            }
            if let Some(event) = self.ledger.due() {
                self.report(&event)?;
            }
        }
        let event = self.ledger.event();
        self.report(&event)
    }

    fn answer(&mut self, message: ObservationMessage) -> Result<(), ServeError> {
        let header = *message.header();
        let max_envs = self.config.lane.max_envs.max(1);
        let n_envs = header.n_envs.clamp(1, max_envs);
        let mut loan = self.lane.loan(n_envs as usize)?;
        let start = ProcessTime::now();
        let outcome = self.act(header, &message, loan.blocks_mut());
        self.ledger.add(n_envs, start.elapsed().as_secs_f64());
        let mut status = 0;
        if let Err(refusal) = outcome {
            status = 1;
            loan.blocks_mut().fill(ActionBlock { n_rows: 1, action_dim: 1, ..ActionBlock::zeroed() });
            self.report(&HostEvent::Failed { message: refusal.to_string() })?;
        }
        drop(message);
        let ObservationHeader { run, sequence, epoch, .. } = header;
        let answer =
            ActionHeader { schema_hash: SCHEMA_HASH, run, sequence, epoch, n_envs, status, reserved: [0; 7] };
        match loan.send(answer) {
            // The sim has died since it asked; its successor asks anew.
            Err(LinkError::NoPeer) => Ok(()),
            sent => Ok(sent?),
        }
    }

    fn act(
        &mut self,
        header: ObservationHeader,
        message: &ObservationMessage,
        blocks: &mut [ActionBlock],
    ) -> Result<(), Refusal> {
        let view = ObservationView::new(header, message.pages())?;
        let (expected, found) = (self.config.run_id, header.run);
        if expected != found {
            return Err(Refusal::Run { expected, found });
        }
        if blocks.len() != view.n_envs() {
            return Err(Refusal::Envs { found: header.n_envs, limit: self.config.lane.max_envs });
        }
        let chunks = &mut self.chunks[..blocks.len()];
        self.policy.act(&view, chunks)?;
        for (env_idx, (chunk, block)) in chunks.iter().zip(blocks).enumerate() {
            chunk.write(view.env(env_idx).record, block);
        }
        Ok(())
    }

    fn report(&mut self, event: &HostEvent) -> Result<(), ServeError> {
        let line = serde_json::to_string(event).map_err(|error| ServeError::Report(error.into()))?;
        writeln!(self.output, "{line}").and_then(|()| self.output.flush()).map_err(ServeError::Report)
    }
}

/// What has been done, and when that was last said.
struct Ledger {
    queries: u64,
    batches: u64,
    busy_s: f64,
    reported: Instant,
    reported_batches: u64,
}

impl Ledger {
    fn new() -> Self {
        Self { queries: 0, batches: 0, busy_s: 0.0, reported: Instant::now(), reported_batches: 0 }
    }

    fn add(&mut self, queries: u32, busy_s: f64) {
        self.queries += u64::from(queries);
        self.batches += 1;
        self.busy_s += busy_s;
    }

    /// The event to send, if there is news and the last one is a while ago.
    fn due(&mut self) -> Option<HostEvent> {
        let news = self.batches > self.reported_batches && self.reported.elapsed() >= LEDGER_PERIOD;
        news.then(|| {
            self.reported = Instant::now();
            self.reported_batches = self.batches;
            self.event()
        })
    }

    fn event(&self) -> HostEvent {
        HostEvent::Ledger { queries: self.queries, batches: self.batches, busy_s: self.busy_s }
    }
}
