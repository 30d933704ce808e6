//! One episode in progress: its world, the source of its actions, and its results so far.

use std::time::Instant;

use ipc_types::layout::MAX_ACTION_DIM;
use ipc_types::{ActionBlock, ControlMode, EnvRecord, FrameError, Morphology};
use run_config::{EpisodeEnd, ResultOptions, RunConfig, error_chain};
use thiserror::Error;

use super::chunk::ChunkBuffer;
use super::lane::InvalidAnswerError;
use super::protocol::{Assignment, Driver, EpisodeLedger, Lane, Outcome};
use crate::episode::{DivergedError, Episode, EpisodeSpec};
use crate::expert::{self, Expert, write_hold_action};
use crate::perturb::Language;
use crate::task::Task;
use render::RenderScene;
use scene::stream;
use scene::{Scene, Snapshot};

/// Returns the control mode in which `driver` controls this morphology. The expert always uses absolute joint
/// positions.
pub(crate) fn control_mode(options: &ResultOptions, morphology: Morphology, driver: Driver) -> ControlMode {
    match driver {
        Driver::Lane(_) => morphology.control_mode(options.control_mode),
        Driver::Expert => expert::CONTROL_MODE,
    }
}

/// The source of an episode's action rows.
enum ActionSource {
    /// The action chunks of a policy.
    Chunk(ChunkBuffer),
    /// The scripted expert; `None` if it found no plan, in which case the robot holds its pose.
    Expert(Option<Box<Expert>>),
}

/// The state of an episode between two control steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Status {
    /// The next query is due.
    Ready,
    /// A query is in flight.
    Queried,
    /// There are action rows to execute.
    Acting,
    /// The episode has finished or failed.
    Done,
}

/// Errors that end an episode before its last step. They are reported apart from task failures.
#[derive(Debug, Error)]
pub(crate) enum EpisodeError {
    #[error(transparent)]
    Diverged(#[from] DivergedError),
    #[error("the policy host could not answer; see its log")]
    HostFailed,
    #[error("the policy sent an invalid action")]
    NonFiniteAction(#[source] FrameError),
}

/// An episode in progress.
pub(crate) struct RunningEpisode {
    pub(crate) assignment: Assignment,
    task: &'static Task,
    end: EpisodeEnd,
    action_dim: usize,
    instruction: String,
    episode: Episode,
    action_source: ActionSource,
    /// The scene prepared for rendering; `None` if the policy uses no images.
    pub(crate) view: Option<RenderScene>,
    pub(crate) snapshot: Snapshot,
    queries: u32,
    queried_at: Option<Instant>,
    /// Bit patterns of the executed rows, if they are recorded.
    actions: Option<Vec<u32>>,
    ledger: EpisodeLedger,
    created: Instant,
    error: Option<EpisodeError>,
}

impl RunningEpisode {
    /// Samples the episode's scene and builds its world. If the policy's lane has images, the scene is also
    /// prepared for rendering.
    pub(crate) fn new(assignment: Assignment, lanes: &[Lane], run: &RunConfig, language: &Language) -> Self {
        let created = Instant::now();
        let task = assignment.task.task();
        let options = &run.results;
        let Assignment { task: id, perturbation, .. } = assignment;
        let (strength, profile) = (options.strength, options.profile);
        let spec = EpisodeSpec { task: id, perturbation, strength, profile };
        let scene = spec.draw_with(language, assignment.seed);
        let mode = control_mode(options, task.morphology, assignment.driver);
        let action_dim = mode.action_dim(task.morphology);
        let (action_source, images) = match assignment.driver {
            Driver::Lane(lane) => {
                let Lane { execute, images, .. } = lanes[lane as usize];
                let chunk = ChunkBuffer::new(mode, action_dim, execute, options.latency_steps());
                (ActionSource::Chunk(chunk), images)
            }
            Driver::Expert => (ActionSource::Expert(plan(&assignment, &scene)), None),
        };
        Self {
            assignment,
            task,
            end: options.protocol.end,
            action_dim,
            action_source,
            episode: spec.start(&scene, mode),
            view: images.map(|sizes| RenderScene::new(&scene, sizes)),
            snapshot: Snapshot::identity(scene.bodies.len(), scene.robots.len()),
            instruction: scene.instruction,
            queries: 0,
            queried_at: None,
            actions: run
                .resources
                .keep_actions
                .then(|| Vec::with_capacity(task.max_steps as usize * action_dim)),
            ledger: EpisodeLedger::default(),
            created,
            error: None,
        }
    }

    pub(crate) fn morphology(&self) -> Morphology {
        self.task.morphology
    }

    pub(crate) fn status(&self) -> Status {
        let is_over = self.episode.is_over(self.end, self.task.max_steps) || self.error.is_some();
        match &self.action_source {
            // The env is free once the answer in flight has been received.
            _ if is_over => {
                if self.queried_at.is_some() {
                    Status::Queried
                } else {
                    Status::Done
                }
            }
            ActionSource::Expert(_) => Status::Acting,
            ActionSource::Chunk(chunk) if chunk.has_row() => Status::Acting,
            ActionSource::Chunk(_) if self.queried_at.is_some() => Status::Queried,
            ActionSource::Chunk(_) => Status::Ready,
        }
    }

    /// Executes up to `max_rows` of the available action rows. Returns the number of control steps executed.
    pub(crate) fn advance(&mut self, max_rows: u32) -> u32 {
        let start = Instant::now();
        let before = self.episode.steps();
        let mut row = [0.0_f32; MAX_ACTION_DIM];
        let row = &mut row[..self.action_dim];
        while self.episode.steps() - before < max_rows && self.status() == Status::Acting {
            self.next_row(row);
            self.step(row);
            self.skip_useless_query();
        }
        self.ledger.physics_s += start.elapsed().as_secs_f64();
        self.episode.steps() - before
    }

    /// Goes on to the end without a query whose answer would come too late.
    fn skip_useless_query(&mut self) {
        let steps_left = self.task.max_steps.saturating_sub(self.episode.steps());
        if self.status() == Status::Ready
            && let ActionSource::Chunk(chunk) = &mut self.action_source
            && !chunk.is_query_useful(steps_left)
        {
            chunk.coast(steps_left);
        }
    }

    fn next_row(&mut self, row: &mut [f32]) {
        match &mut self.action_source {
            ActionSource::Chunk(chunk) => chunk.next_row(&self.episode.world, row),
            ActionSource::Expert(Some(expert)) => expert.act(&self.episode.world, row),
            ActionSource::Expert(None) => write_hold_action(&self.episode.world, row),
        }
    }

    fn step(&mut self, row: &[f32]) {
        if let Some(actions) = &mut self.actions {
            actions.extend(row.iter().map(|number| number.to_bits()));
        }
        if let Err(error) = self.episode.step(row) {
            self.error = Some(error.into());
        }
    }

    /// Copies the current poses into the snapshot for the renderer.
    pub(crate) fn take_snapshot(&mut self) {
        self.episode.world.write_snapshot(&mut self.snapshot);
    }

    /// Writes the record of the next query in place. Every byte of its page is written.
    pub(crate) fn write_record(&self, slot: u32, record: &mut EnvRecord) {
        let (state_dim, text) = (self.task.morphology.state_dim(), self.instruction.as_bytes());
        record.slot = slot;
        record.query = self.queries;
        record.step = self.episode.steps();
        record.state_dim = state_dim as u32;
        record.instruction_len = text.len() as u32;
        record.execute = match &self.action_source {
            ActionSource::Chunk(chunk) => chunk.execute(),
            ActionSource::Expert(_) => 1,
        };
        record.policy_seed = stream::policy_seed(self.assignment.seed);
        record.reserved = [0; 4];
        self.episode.world.write_state(&mut record.state[..state_dim]);
        record.state[state_dim..].fill(0.0);
        record.instruction[..text.len()].copy_from_slice(text);
        record.instruction[text.len()..].fill(0);
        record.padding.fill(0);
    }

    /// Records that the episode's observation was sent.
    pub(crate) fn mark_queried(&mut self, now: Instant) {
        self.queried_at = Some(now);
        self.queries += 1;
        if let ActionSource::Chunk(chunk) = &mut self.action_source {
            chunk.on_query();
        }
    }

    /// Takes the rows of an answer that [`Self::check_answer`] has accepted.
    pub(crate) fn accept(&mut self, answer: &ActionBlock, now: Instant) {
        self.ledger.policy_s += self.queried_at.take().map_or(0.0, |sent| (now - sent).as_secs_f64());
        if let ActionSource::Chunk(chunk) = &mut self.action_source {
            chunk.receive(&answer.rows, answer.n_rows as usize);
        }
    }

    /// Ends the episode with an error in the answer that has just been received.
    pub(crate) fn fail(&mut self, error: EpisodeError) {
        self.queried_at = None;
        self.error = Some(error);
    }

    /// Checks that this answer belongs to the episode's latest query and has the right action size.
    pub(crate) fn check_answer(&self, slot: u32, answer: &ActionBlock) -> Result<(), InvalidAnswerError> {
        let check = |field, found: u32, expected: u32| {
            if found == expected {
                Ok(())
            } else {
                Err(InvalidAnswerError::Field { slot, field, found, expected })
            }
        };
        check("slot", answer.slot, slot)?;
        check("query", answer.query, self.queries - 1)?;
        check("action_dim", answer.action_dim, self.action_dim as u32)
    }

    pub(crate) fn add_render_time(&mut self, seconds: f64) {
        self.ledger.render_s += seconds;
    }

    /// Returns the result of an episode whose status is [`Status::Done`].
    pub(crate) fn outcome(&mut self) -> Outcome {
        let EpisodeLedger { physics_s, render_s, policy_s, .. } = self.ledger;
        self.ledger.wait_s =
            (self.created.elapsed().as_secs_f64() - physics_s - render_s - policy_s).max(0.0);
        Outcome {
            id: self.assignment.id,
            steps: self.episode.steps(),
            success_once: self.episode.first_success_step().is_some(),
            success_at_end: self.episode.unmet().is_none() && self.error.is_none(),
            first_success_step: self.episode.first_success_step(),
            failed_predicate: self.episode.unmet().map(|predicate| predicate.name().to_owned()),
            fingerprint: self.episode.fingerprint(),
            actions: self.actions.take(),
            ledger: self.ledger,
            error: self.error.take().map(|error| error_chain(&error)),
        }
    }
}

/// Plans the expert's motion. A plan that fails is logged.
fn plan(assignment: &Assignment, scene: &Scene) -> Option<Box<Expert>> {
    let moves = (assignment.task.task().expert)(scene);
    match Expert::new(scene, &moves) {
        Ok(expert) => Some(Box::new(expert)),
        Err(error) => {
            let Assignment { task, perturbation, seed, .. } = assignment;
            super::pipes::log(format_args!(
                "the expert found no plan for {} {} seed {seed}: {}",
                task.name(),
                perturbation.name(),
                error_chain(&error)
            ));
            None
        }
    }
}
