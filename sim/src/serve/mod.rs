//! The sim process: it receives commands, runs episodes in envs, and queries policy hosts.
//!
//! The clock is read only for the ledger and for bounded waits; no episode depends on it.

mod batch;
mod chunk;
mod envs;
mod episode;
mod lane;
mod latencies;
mod pipes;
pub mod protocol;
#[cfg(test)]
mod tests;

use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError};
use std::time::{Duration, Instant};

use ipc_types::layout::block_pages;
use ipc_types::link::{LinkError, LinkNode, SimLink};
use ipc_types::{ActionView, FrameError};
use run_config::trace::{self, Activity, CpuTime};
use run_config::{RunConfig, error_chain};
use thiserror::Error;

use self::batch::{BatchWriter, batch_size};
use self::envs::Envs;
use self::episode::{EpisodeError, control_mode};
use self::lane::{InvalidAnswerError, LaneError, LaneState};
use self::pipes::{emit, read_commands};
use self::protocol::{Counters, SimCommand, SimConfig, SimEvent};
use crate::perturb::{Language, SentencesError};
use render::{self, OpenRendererError, RenderError};

/// Duration of busy waiting before the first timed wait for an answer.
const SPIN_TIME: Duration = Duration::from_micros(50);
/// Longest single wait. After it, commands, lanes and envs are checked again.
const MAX_WAIT: Duration = Duration::from_millis(50);
/// Interval between two progress events, from which the orchestrator also chooses the number of envs.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);
/// Time without a control step after which, and interval at which, the sim reports what it waits for.
const WAITING_INTERVAL: Duration = Duration::from_secs(1);

/// Errors that can occur while starting or running a sim.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe variants and fields")]
pub enum SimError {
    #[error("failed to start {threads} worker threads")]
    Threads { threads: u32, source: rayon::ThreadPoolBuildError },
    #[error("failed to start the thread that reads standard input")]
    Stdin(#[source] io::Error),
    #[error("failed to set up shared memory")]
    Link(#[from] LinkError),
    #[error("failed to write an event to stdout")]
    Output(#[from] io::Error),
    #[error("failed to read --language")]
    Sentences(#[from] SentencesError),
    #[error("failed to open a renderer")]
    OpenRenderer(#[from] OpenRendererError),
    #[error("failed to {0}")]
    Render(RenderError),
}

/// Errors that can occur while serving one lane.
#[derive(Debug, Error)]
enum ServeLaneError {
    /// Only this lane fails; the others continue.
    #[error(transparent)]
    Lane(#[from] LaneError),
    /// No lane can be served any more.
    #[error(transparent)]
    Renderer(#[from] RenderError),
    /// The same.
    #[error(transparent)]
    Output(#[from] io::Error),
}

/// Runs a sim until its stdin closes. It reads [`SimCommand`]s from stdin and writes [`SimEvent`]s to stdout.
///
/// # Errors
/// If the sim cannot be set up, its renderer fails, or its stdout is closed.
pub fn serve(config: &SimConfig) -> Result<(), SimError> {
    if config.run.resources.trace.is_some() {
        trace::enable();
    }
    let threads = config.run.resources.n_threads();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads as usize)
        .build()
        .map_err(|source| SimError::Threads { threads, source })?;
    let commands = read_commands().map_err(SimError::Stdin)?;
    let served = pool.install(|| Server::new(config, commands)?.run());
    if let Err(error @ (SimError::OpenRenderer(_) | SimError::Render(_))) = &served {
        emit(&SimEvent::RendererFailed { message: error_chain(error) })?;
    }
    served
}

/// The state of the sim's main loop.
struct Server {
    commands: Receiver<SimCommand>,
    link: SimLink,
    lanes: Vec<LaneState>,
    envs: Envs,
    writer: BatchWriter,
    run: RunConfig,
    /// Worker threads of the sim and of each host.
    n_threads: usize,
    counters: Counters,
    /// Start of the measured window (see [`Counters::wall_s`]).
    first_work: Option<(Instant, CpuTime)>,
    /// Idle seconds since the last control step. They count once another control step extends the window over
    /// them.
    pending_idle_s: f64,
    /// Time at which the loop last ran out of work.
    idle_since: Option<Instant>,
    last_progress: Instant,
    /// Time of the last step, or of the last [`SimEvent::Waiting`].
    last_work: Instant,
    /// Envs of the batch that is being assembled.
    batch: Vec<u32>,
    // Declared last so that the ports above are dropped before their node.
    _node: LinkNode,
}

impl Server {
    fn new(config: &SimConfig, commands: Receiver<SimCommand>) -> Result<Self, SimError> {
        let node = LinkNode::new(&config.domain, "sim")?;
        let link = SimLink::create(&node, config.lanes.len() as u32)?;
        let lanes = config
            .lanes
            .iter()
            .map(|lane| {
                let check_frames = config.run.resources.check_frames;
                LaneState::create(&node, config.run_id, check_frames, lane.clone())
            })
            .collect::<Result<Vec<_>, _>>()?;
        let language =
            Language::read(&config.run.results.protocol.instructions, config.run.results.language.as_ref())?;
        let (rendering, image_size) = (&config.run.rendering, config.run.results.protocol.image_size);
        let n_threads = config.run.resources.n_threads() as usize;
        let gpu = config.run.resources.gpu;
        let renderer = render::open(rendering.renderer, gpu, rendering.samples, image_size, n_threads)?;
        let max_envs = config.lanes.iter().map(|lane| lane.spec.max_envs as usize).max().unwrap_or(0);
        let shm_bytes = config.lanes.iter().map(|lane| lane.spec.shm_bytes()).sum();
        emit(&SimEvent::Ready { shm_bytes, renderer: renderer.name(), identity: renderer.identity() })?;
        Ok(Self {
            commands,
            link,
            lanes,
            envs: Envs::new(config, language),
            writer: BatchWriter::new(renderer, max_envs),
            run: config.run.clone(),
            n_threads,
            counters: Counters { foreign_s: vec![0.0; config.lanes.len()], ..Counters::default() },
            first_work: None,
            pending_idle_s: 0.0,
            idle_since: None,
            last_progress: Instant::now(),
            last_work: Instant::now(),
            batch: Vec::with_capacity(max_envs),
            _node: node,
        })
    }

    fn run(mut self) -> Result<(), SimError> {
        loop {
            loop {
                match self.commands.try_recv() {
                    Ok(command) => self.handle_command(&command),
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => return self.send_progress(),
                }
            }
            let lanes = &self.lanes;
            self.envs.refill(|lane| lanes[lane].is_connected());
            for lane in 0..self.lanes.len() as u32 {
                match self.serve_lane(lane as usize) {
                    Ok(()) => {}
                    Err(ServeLaneError::Renderer(error)) => return Err(SimError::Render(error)),
                    Err(ServeLaneError::Output(error)) => return Err(SimError::Output(error)),
                    Err(ServeLaneError::Lane(error)) => {
                        self.drop_host(lane);
                        let (message, is_final) = (error_chain(&error), error.is_final());
                        emit(&SimEvent::LaneFailed { lane, message, is_final })?;
                    }
                }
            }
            if self.envs.has_work() {
                self.idle_since = None;
                self.last_work = Instant::now();
                self.step()?;
            } else if !self.idle()? {
                return self.send_progress();
            }
            if self.last_progress.elapsed() >= PROGRESS_INTERVAL {
                self.last_progress = Instant::now();
                self.send_progress()?;
            }
            if self.last_work.elapsed() >= WAITING_INTERVAL {
                self.last_work = Instant::now();
                let hosts = self.lanes.iter().map(LaneState::is_connected).collect();
                emit(&SimEvent::Waiting { held: self.envs.held(), hosts })?;
            }
        }
    }

    fn send_progress(&self) -> Result<(), SimError> {
        let spans = trace::take();
        if !spans.is_empty() {
            emit(&SimEvent::Spans(spans))?;
        }
        emit(&SimEvent::Progress(self.counters.clone()))?;
        Ok(())
    }

    fn handle_command(&mut self, command: &SimCommand) {
        match command {
            SimCommand::Run(assignment) => self.envs.push(*assignment),
            SimCommand::Envs { count } => self.envs.set_limit(*count),
            SimCommand::HostUp { lane } => {
                // The command that announced the loss of the previous host may itself be lost.
                if self.lanes[*lane as usize].is_connected() {
                    self.drop_host(*lane);
                }
                self.lanes[*lane as usize].host_up();
            }
            SimCommand::HostDown { lane } => self.drop_host(*lane),
            SimCommand::GiveUp { lane } => {
                self.lanes[*lane as usize].give_up();
                self.envs.give_up(*lane);
            }
        }
    }

    /// Drops what is in flight to a lane's host and restarts its episodes. Answers that it has sent before
    /// still count.
    fn drop_host(&mut self, lane: u32) {
        let now = Instant::now();
        // An invalid answer of a host that is gone is not worth an error: its episodes restart anyway.
        while self.receive(lane as usize, now).is_ok_and(|received| received) {}
        self.lanes[lane as usize].host_down();
        self.envs.restart(lane);
    }

    /// Reports that a foreign host has left, and restarts its episodes.
    fn lose_foreign_host(&mut self, lane: u32) -> io::Result<()> {
        self.drop_host(lane);
        emit(&SimEvent::HostLost { lane })
    }

    /// Receives the next answer of a lane. Returns `false` if there is none.
    fn receive(&mut self, lane_idx: usize, now: Instant) -> Result<bool, LaneError> {
        let envs = &mut self.envs;
        self.lanes[lane_idx].receive(&mut self.counters.latencies, now, |slot, view, env_idx| {
            accept(envs, slot, view, env_idx, now)
        })
    }

    /// Builds and steps episodes, and reports the finished ones.
    fn step(&mut self) -> Result<(), SimError> {
        let (start, cpu_start) = (Instant::now(), CpuTime::of_process());
        let env_steps = self.envs.advance();
        self.counters.physics_s += cpu_start.elapsed().as_secs_f64();
        let (first_work, first_cpu) = *self.first_work.get_or_insert((start, cpu_start));
        if env_steps > 0 {
            self.counters.env_steps += env_steps;
            self.counters.wall_s = first_work.elapsed().as_secs_f64();
            self.counters.cpu_s = first_cpu.elapsed().as_secs_f64();
            self.counters.idle_s += std::mem::take(&mut self.pending_idle_s);
            for (seconds, lane) in self.counters.foreign_s.iter_mut().zip(&self.lanes) {
                *seconds = lane.queried_s();
            }
        }
        let mut written = Ok(());
        self.envs.take_finished(|outcome| {
            if written.is_ok() {
                written = emit(&SimEvent::Finished(Box::new(outcome)));
            }
        });
        Ok(written?)
    }

    /// Receives the answers of a lane, then sends all batches that are due.
    fn serve_lane(&mut self, lane_idx: usize) -> Result<(), ServeLaneError> {
        if self.lanes[lane_idx].is_given_up() {
            return Ok(());
        }
        let now = Instant::now();
        if self.idle_since.is_some() {
            // An answer has just ended the wait. Otherwise it may have come at any time since the last look.
            self.lanes[lane_idx].count_queried(now);
        }
        while self.receive(lane_idx, now)? {}
        self.lanes[lane_idx].count_queried(now);
        if self.lanes[lane_idx].check_host(now)? {
            self.lose_foreign_host(lane_idx as u32)?;
        }
        while self.send(lane_idx)? {}
        Ok(())
    }

    /// Sends one batch of ready envs that share a morphology. Returns `false` if there is none to send now
    /// ([`batch_size`]), or the lane cannot send.
    fn send(&mut self, lane_idx: usize) -> Result<bool, ServeLaneError> {
        let lane = &mut self.lanes[lane_idx];
        if !lane.can_send() {
            return Ok(false);
        }
        let (tally, max_envs) = (self.envs.tally(lane_idx as u32), lane.config.spec.max_envs as usize);
        let Some(n_envs) = batch_size(tally, max_envs, self.n_threads) else { return Ok(false) };
        let Some(morphology) =
            self.envs.ready(lane_idx as u32).next().map(|(_, episode)| episode.morphology())
        else {
            return Ok(false);
        };
        self.batch.clear();
        let ready =
            self.envs.ready(lane_idx as u32).filter(|(_, episode)| episode.morphology() == morphology);
        self.batch.extend(ready.map(|(slot, _)| slot).take(n_envs));
        let as_lane_error = |policy: &str, source| LaneError::Link { policy: policy.to_owned(), source };
        let images = lane.config.images;
        let n_pages = self.batch.len() * block_pages(morphology, images);
        let mut loan = lane.link.loan(n_pages).map_err(|e| as_lane_error(&lane.config.spec.policy, e))?;
        let observing = trace::span(Activity::Observe);
        let cost = self.writer.write(&mut self.envs, &self.batch, (morphology, images), loan.pages_mut())?;
        observing.finish(self.batch.len() as u64);
        self.counters.images += cost.images;
        self.counters.render_s += cost.core_s;
        self.counters.device_s += cost.device_s;
        self.counters.queries += self.batch.len() as u64;
        let now = Instant::now();
        let mode = control_mode(&self.run.results, morphology, protocol::Driver::Lane(lane_idx as u32));
        for slot in &self.batch {
            self.envs.episode_mut(*slot).expect("a ready env runs an episode").mark_queried(now);
        }
        let header = lane.dispatch(&self.batch, morphology, mode, loan.pages_mut(), now);
        match loan.send(header) {
            // The host disconnected since the last check. The episodes restart with the next host.
            Err(LinkError::NoPeer) if lane.config.foreign => {
                self.lose_foreign_host(lane_idx as u32)?;
                Ok(false)
            }
            Err(source) => Err(as_lane_error(&lane.config.spec.policy, source).into()),
            Ok(()) => Ok(true),
        }
    }

    /// Waits for an answer or a command when there is nothing to step. Returns `false` once stdin has closed.
    fn idle(&mut self) -> Result<bool, SimError> {
        let start = Instant::now();
        let waiting = trace::now();
        let alive = if self.lanes.iter().any(LaneState::awaits_answer) {
            if self.idle_since.get_or_insert(start).elapsed() < SPIN_TIME {
                std::hint::spin_loop();
            } else {
                self.link.wait(MAX_WAIT)?;
            }
            true
        } else {
            match self.commands.recv_timeout(MAX_WAIT) {
                Ok(command) => {
                    self.handle_command(&command);
                    true
                }
                Err(RecvTimeoutError::Timeout) => true,
                Err(RecvTimeoutError::Disconnected) => false,
            }
        };
        trace::record(Activity::Wait, waiting, 0);
        if self.first_work.is_some() {
            self.pending_idle_s += start.elapsed().as_secs_f64();
        }
        Ok(alive)
    }
}

/// Passes an env's answer to the episode in that env. If the host could not answer, or an action is not
/// finite, only that episode ends with an error; an answer that does not match the query is an error of the
/// lane.
fn accept(
    envs: &mut Envs,
    slot: u32,
    view: &ActionView<'_>,
    env_idx: usize,
    now: Instant,
) -> Result<(), InvalidAnswerError> {
    let episode = envs.episode_mut(slot).ok_or(InvalidAnswerError::EmptySlot { slot })?;
    if view.header().status != 0 {
        episode.fail(EpisodeError::HostFailed);
        return Ok(());
    }
    let answer = &view.blocks()[env_idx];
    episode.check_answer(slot, answer)?;
    match view.check_finite(env_idx) {
        Ok(()) => episode.accept(answer, now),
        Err(error @ FrameError::NotFinite { .. }) => episode.fail(EpisodeError::NonFiniteAction(error)),
        Err(error) => return Err(error.into()),
    }
    Ok(())
}
