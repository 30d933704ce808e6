//! Serving episodes: the control plane's messages, the slots, and the loop that steps, renders and queries.
//!
//! The clock is read here for the ledger and for bounded waits; no episode depends on it.

mod batch;
mod episode;
mod lane;
pub mod protocol;
mod slots;
#[cfg(test)]
mod tests;

use std::io::{BufRead, Write};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, sync_channel};
use std::time::{Duration, Instant};

use cpu_time::ProcessTime;
use ipc_types::link::{LinkError, LinkNode, SimLink};
use ipc_types::{ActionView, FrameError, RunConfig};
use thiserror::Error;

use self::batch::BatchWriter;
use self::episode::control_mode;
use self::lane::{LaneError, LaneState};
use self::protocol::{Counters, SimCommand, SimConfig, SimEvent};
use self::slots::Slots;
use crate::render::{self, OpenError, RenderError};

/// Spinning before the first timed wait for an answer.
const SPIN: Duration = Duration::from_micros(50);
/// Longest single wait; after it everything is looked at again.
const WAIT: Duration = Duration::from_millis(50);
/// Time between two progress events.
const PROGRESS_INTERVAL: Duration = Duration::from_secs(1);
/// Commands read ahead.
const COMMAND_QUEUE: usize = 1024;

/// Why a sim could not start or go on.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum ServeError {
    #[error("failed to start {threads} worker threads: {source}")]
    Threads { threads: u32, source: rayon::ThreadPoolBuildError },
    #[error("failed to set up shared memory: {0}")]
    Link(#[from] LinkError),
    #[error("failed to write to the orchestrator: {0}")]
    Output(#[from] std::io::Error),
    #[error("failed to open a renderer: {0}")]
    OpenRenderer(#[from] OpenError),
    #[error("failed to {0}")]
    Render(#[from] RenderError),
}

/// Why a lane could not be served.
#[derive(Debug, Error)]
enum Fault {
    /// Its own fault: the others go on.
    #[error(transparent)]
    Lane(#[from] LaneError),
    /// Nobody can be served any more.
    #[error(transparent)]
    Renderer(#[from] RenderError),
}

/// Runs a sim until its stdin closes: commands come in on stdin, events go out on stdout.
///
/// # Errors
/// When the sim cannot be set up, or its stdout is gone.
pub fn serve(config: &SimConfig) -> Result<(), ServeError> {
    let threads = config.run.resources.threads;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads as usize)
        .build()
        .map_err(|source| ServeError::Threads { threads, source })?;
    let commands = read_commands();
    let served = pool.install(|| Server::new(config, commands)?.run());
    if let Err(error @ (ServeError::OpenRenderer(_) | ServeError::Render(_))) = &served {
        emit(&SimEvent::RendererFailed { message: error.to_string() })?;
    }
    served
}

/// One line on stderr, which the orchestrator passes on.
#[expect(clippy::print_stderr, reason = "stderr is the child's log")]
fn log(message: core::fmt::Arguments<'_>) {
    eprintln!("{message}");
}

/// Parses stdin line by line on a thread of its own; the channel closes with stdin.
fn read_commands() -> Receiver<SimCommand> {
    let (sender, receiver) = sync_channel(COMMAND_QUEUE);
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines() {
            let Ok(line) = line else { return };
            match serde_json::from_str(&line) {
                Ok(command) => {
                    if sender.send(command).is_err() {
                        return;
                    }
                }
                Err(error) => log(format_args!("ignored a command that does not parse: {error}")),
            }
        }
    });
    receiver
}

struct Server {
    commands: Receiver<SimCommand>,
    link: SimLink,
    lanes: Vec<LaneState>,
    slots: Slots,
    writer: BatchWriter,
    run: RunConfig,
    counters: Counters,
    /// Start of the measured window (see [`Counters::wall_s`]).
    first_work: Option<Instant>,
    /// Idle seconds since the last control step. They count once another control step extends the window over them.
    pending_idle_s: f64,
    /// When the loop last ran out of work.
    idle_since: Option<Instant>,
    reported: Instant,
    /// Slots of the batch being put together.
    batch: Vec<u32>,
    // Last, so that the ports above are dropped before their node.
    _node: LinkNode,
}

impl Server {
    fn new(config: &SimConfig, commands: Receiver<SimCommand>) -> Result<Self, ServeError> {
        let node = LinkNode::new(&config.domain, "sim")?;
        let link = SimLink::create(&node, config.lanes.len() as u32)?;
        let lanes = config
            .lanes
            .iter()
            .map(|lane| LaneState::create(&node, config.run_id, lane.clone()))
            .collect::<Result<Vec<_>, _>>()?;
        let rendering = &config.run.rendering;
        let n_threads = config.run.resources.threads as usize;
        let renderer = render::open(rendering.renderer, rendering.samples, n_threads)?;
        let max_envs = config.lanes.iter().map(|lane| lane.spec.max_envs as usize).max().unwrap_or(0);
        let shm_bytes = config.lanes.iter().map(|lane| lane.spec.shm_bytes()).sum();
        emit(&SimEvent::Ready { shm_bytes, renderer: renderer.name(), identity: renderer.identity() })?;
        Ok(Self {
            commands,
            link,
            lanes,
            slots: Slots::new(config.run, &config.lanes),
            writer: BatchWriter::new(renderer, max_envs),
            run: config.run,
            counters: Counters::default(),
            first_work: None,
            pending_idle_s: 0.0,
            idle_since: None,
            reported: Instant::now(),
            batch: Vec::with_capacity(max_envs),
            _node: node,
        })
    }

    fn run(mut self) -> Result<(), ServeError> {
        loop {
            loop {
                match self.commands.try_recv() {
                    Ok(command) => self.obey(&command),
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => return self.leave(),
                }
            }
            self.slots.refill();
            for lane_idx in 0..self.lanes.len() {
                match self.serve_lane(lane_idx) {
                    Ok(()) => {}
                    Err(Fault::Renderer(error)) => return Err(error.into()),
                    Err(Fault::Lane(error)) => {
                        self.lanes[lane_idx].host_down();
                        emit(&SimEvent::LaneFailed { lane: lane_idx as u32, message: error.to_string() })?;
                    }
                }
            }
            if self.slots.has_work() {
                self.idle_since = None;
                self.step()?;
            } else if !self.idle()? {
                return self.leave();
            }
            if self.reported.elapsed() >= PROGRESS_INTERVAL {
                self.reported = Instant::now();
                emit(&SimEvent::Progress(self.counters))?;
            }
        }
    }

    fn leave(&self) -> Result<(), ServeError> {
        emit(&SimEvent::Progress(self.counters))?;
        Ok(())
    }

    fn obey(&mut self, command: &SimCommand) {
        match command {
            SimCommand::Run(assignment) => self.slots.push(*assignment),
            SimCommand::HostUp { lane } => self.lanes[*lane as usize].host_up(),
            SimCommand::HostDown { lane } => self.lose_host(*lane),
        }
    }

    fn lose_host(&mut self, lane: u32) {
        self.lanes[lane as usize].host_down();
        self.slots.restart(lane);
    }

    fn step(&mut self) -> Result<(), ServeError> {
        let (start, cpu_start) = (Instant::now(), ProcessTime::now());
        let env_steps = self.slots.pass();
        self.counters.physics_s += cpu_start.elapsed().as_secs_f64();
        let first_work = *self.first_work.get_or_insert(start);
        if env_steps > 0 {
            self.counters.env_steps += env_steps;
            self.counters.wall_s = first_work.elapsed().as_secs_f64();
            self.counters.idle_s += std::mem::take(&mut self.pending_idle_s);
        }
        let mut written = Ok(());
        self.slots.take_finished(|outcome| {
            if written.is_ok() {
                written = emit(&SimEvent::Finished(Box::new(outcome)));
            }
        });
        Ok(written?)
    }

    /// Takes what came back on a lane, then sends what is due.
    fn serve_lane(&mut self, lane_idx: usize) -> Result<(), Fault> {
        let now = Instant::now();
        let lane = &mut self.lanes[lane_idx];
        let execute = self.run.results.execute;
        let slots = &mut self.slots;
        while lane.receive(|slot, view, env_idx| accept(slots, slot, view, env_idx, execute, now))? {}
        if lane.look_after(now)? {
            self.lose_host(lane_idx as u32);
        }
        while self.send(lane_idx)? {}
        Ok(())
    }

    /// Sends one batch of ready slots of one morphology, if the lane is open and there are any.
    fn send(&mut self, lane_idx: usize) -> Result<bool, Fault> {
        let lane = &mut self.lanes[lane_idx];
        if !lane.is_open() {
            return Ok(false);
        }
        let Some(morphology) =
            self.slots.ready(lane_idx as u32).next().map(|(_, episode)| episode.morphology())
        else {
            return Ok(false);
        };
        self.batch.clear();
        let ready =
            self.slots.ready(lane_idx as u32).filter(|(_, episode)| episode.morphology() == morphology);
        self.batch.extend(ready.map(|(slot, _)| slot).take(lane.config.spec.max_envs as usize));
        let as_lane_error = |policy: &str, source| LaneError::Link { policy: policy.to_owned(), source };
        let n_pages = self.batch.len() * lane.block_pages(morphology);
        let mut loan = lane.link.loan(n_pages).map_err(|e| as_lane_error(&lane.config.spec.policy, e))?;
        let execute = self.run.results.execute;
        let drawn = self.writer.write(&mut self.slots, &self.batch, execute, morphology, loan.pages_mut())?;
        self.counters.images += drawn.images;
        self.counters.render_s += drawn.core_s;
        self.counters.queries += self.batch.len() as u64;
        let now = Instant::now();
        let mode = control_mode(&self.run.results, morphology, protocol::Driver::Lane(lane_idx as u32));
        for slot in &self.batch {
            self.slots.episode_mut(*slot).expect("a ready slot runs an episode").mark_queried(now);
        }
        let header = lane.dispatch(&self.batch, morphology, mode, now);
        match loan.send(header) {
            // It has left since it was last looked at; the next one is asked anew.
            Err(LinkError::NoPeer) if lane.config.foreign => {
                self.lose_host(lane_idx as u32);
                Ok(false)
            }
            Err(source) => Err(as_lane_error(&lane.config.spec.policy, source).into()),
            Ok(()) => Ok(true),
        }
    }

    /// Nothing to step: waits for an answer or a command. Returns false when stdin has closed.
    fn idle(&mut self) -> Result<bool, ServeError> {
        let start = Instant::now();
        let alive = if self.lanes.iter().any(LaneState::awaits_answer) {
            if self.idle_since.get_or_insert(start).elapsed() < SPIN {
                std::hint::spin_loop();
            } else {
                self.link.wait(WAIT)?;
            }
            true
        } else {
            match self.commands.recv_timeout(WAIT) {
                Ok(command) => {
                    self.obey(&command);
                    true
                }
                Err(RecvTimeoutError::Timeout) => true,
                Err(RecvTimeoutError::Disconnected) => false,
            }
        };
        if self.first_work.is_some() {
            self.pending_idle_s += start.elapsed().as_secs_f64();
        }
        Ok(alive)
    }
}

/// Hands an env's answer to the episode in its slot. A host that could not answer, or a number that is not finite, ends
/// that episode with an error; an answer to another question is the lane's fault.
fn accept(
    slots: &mut Slots,
    slot: u32,
    view: &ActionView<'_>,
    env_idx: usize,
    execute: u32,
    now: Instant,
) -> Result<(), String> {
    let Some(episode) = slots.episode_mut(slot) else { return Err(format!("slot {slot} runs no episode")) };
    if view.header().status != 0 {
        episode.fail("the policy host could not answer; its log says why".to_owned());
        return Ok(());
    }
    let answer = &view.blocks()[env_idx];
    episode.expects(slot, answer)?;
    match view.check_finite(env_idx) {
        Ok(()) => episode.accept(answer, execute, now),
        Err(error @ FrameError::NotFinite { .. }) => episode.fail(error.to_string()),
        Err(error) => return Err(error.to_string()),
    }
    Ok(())
}

fn emit(event: &SimEvent) -> Result<(), std::io::Error> {
    let mut out = std::io::stdout().lock();
    serde_json::to_writer(&mut out, event)?;
    out.write_all(b"\n")?;
    out.flush()
}
