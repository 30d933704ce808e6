//! Envs in the memory of a caller, who chooses their episodes, gives their actions, and says when to look.
//!
//! `serve` runs the same episodes for policies in other processes. Here nothing is queued and nothing is
//! waited for: each call works on the envs that it names, in parallel, and returns.

use std::path::Path;

use ipc_types::layout::{PAGE_BYTES, block_pages};
use ipc_types::{ControlMode, ImageSizes, Morphology};
use rayon::prelude::*;
use render::{OpenRendererError, RenderError, RenderScene, Renderer, View};
use run_config::allotment::available_memory;
use run_config::{EpisodeEnd, ImageOptions, ResultOptions};
use scene::{Snapshot, stream};
use thiserror::Error;

use super::spec::EpisodeSpec;
use super::steps::{DivergedError, Episode};
use crate::perturb::{Composition, Language, SentencesError};
use crate::predicate::Predicate;
use crate::tasks::TaskId;
use crate::trajectory::{TrajectoryError, TrajectoryFile};

/// Memory of an env with and without images in bytes, a little more than measured. The caller has two sets of
/// observations besides.
const ENV_BYTES: [u64; 2] = [900 << 10, 160 << 10];

/// Parts and rules of a [`VectorEnv`].
#[derive(Clone, Debug)]
pub struct VectorOptions {
    /// Number of envs.
    pub n_envs: usize,
    /// Morphology of all tasks.
    pub morphology: Morphology,
    /// Options that change an episode. Their latency has no meaning here.
    pub results: ResultOptions,
    /// Options of the renderer; `None` if no image is wanted.
    pub images: Option<ImageOptions>,
    /// Index of the GPU that renders.
    pub gpu: Option<u32>,
    /// Worker threads.
    pub n_threads: usize,
}

/// Errors of a [`VectorEnv`].
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe variants and fields")]
pub enum VectorError {
    #[error("{n_envs} envs need about {needed_mib} MiB of memory, and {available_mib} MiB are available")]
    Memory { n_envs: usize, needed_mib: u64, available_mib: u64 },
    #[error("failed to start {threads} worker threads")]
    Threads { threads: usize, source: rayon::ThreadPoolBuildError },
    #[error("failed to read sentences")]
    Sentences(#[from] SentencesError),
    #[error("failed to open a renderer")]
    OpenRenderer(#[from] OpenRendererError),
    #[error("failed to {0}")]
    Render(#[from] RenderError),
    #[error("{task} needs {needed} tasks, and these envs are of {found} ones: make another vector env")]
    Morphology { task: &'static str, needed: &'static str, found: &'static str },
    #[error("{perturbation} does not apply to {task}: {reason}")]
    NotApplicable { task: &'static str, perturbation: &'static str, reason: String },
    #[error("env {env} has no episode yet: reset it first")]
    NotReset { env: usize },
    #[error("env {env} has no images: it was made without them")]
    NoImages { env: usize },
    #[error(transparent)]
    State(#[from] TrajectoryError),
    #[error("the state is one of {found}, and env {env} has an episode of {expected}")]
    OtherTask { env: usize, expected: &'static str, found: String },
    #[error(
        "the state has bodies of sizes {found:?}, and those of the episode in env {env} are {expected:?}"
    )]
    OtherSizes { env: usize, expected: Vec<f64>, found: Vec<f64> },
}

/// The start of an episode in an env.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EpisodeStart {
    /// Task of the episode.
    pub task: TaskId,
    /// Perturbation, or several that act together.
    pub perturbation: Composition,
    /// Index of the episode, from which its seed follows together with task and suite seed.
    pub episode: u32,
    /// Suite seed.
    pub suite_seed: u64,
}

/// Result of an episode so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EpisodeProgress {
    /// Number of control steps executed.
    pub steps: u32,
    /// First step after which the task was successful, counted from 1.
    pub first_success_step: Option<u32>,
    /// Name of the first predicate that does not hold now; `None` if the task is successful.
    pub unmet: Option<&'static str>,
    /// `true` if the episode has ended: by the protocol's rule for success, at the horizon or by an error.
    pub is_over: bool,
    /// `true` if the episode has ended by its success.
    pub is_won: bool,
    /// The reason why the episode cannot go on.
    pub error: Option<DivergedError>,
    /// Hash of the trajectory, as in a results file.
    pub fingerprint: u64,
    /// Seed of the episode.
    pub seed: u64,
}

/// One env with an episode.
struct EnvState {
    start: EpisodeStart,
    seed: u64,
    episode: Episode,
    error: Option<DivergedError>,
    instruction: String,
    /// Names of all bodies, in the world's order.
    bodies: Vec<&'static str>,
    sizes: Vec<f64>,
    view: Option<RenderScene>,
    snapshot: Snapshot,
}

/// Envs of one morphology that are stepped and rendered in parallel.
pub struct VectorEnv {
    options: VectorOptions,
    pool: rayon::ThreadPool,
    language: Language,
    renderer: Option<Box<dyn Renderer>>,
    envs: Vec<Option<Box<EnvState>>>,
}

impl VectorEnv {
    /// Creates envs without episodes.
    ///
    /// # Errors
    /// If the memory does not suffice, sentences cannot be read, or no renderer can be opened.
    pub fn new(options: VectorOptions) -> Result<Self, VectorError> {
        let VectorOptions { n_envs, n_threads, .. } = options;
        let sizes = options.images.map(|_| options.results.protocol.image_size);
        let observations = 2 * block_pages(options.morphology, sizes) * PAGE_BYTES;
        let env_bytes = observations as u64 + ENV_BYTES[usize::from(sizes.is_none())];
        let needed = (n_envs as u64).saturating_mul(env_bytes);
        let available = available_memory().unwrap_or(u64::MAX);
        if needed > available {
            let [needed_mib, available_mib] = [needed, available].map(|bytes| bytes >> 20);
            return Err(VectorError::Memory { n_envs, needed_mib, available_mib });
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(n_threads)
            .thread_name(|i| format!("hypogeum-{i}"))
            .build()
            .map_err(|source| VectorError::Threads { threads: n_threads, source })?;
        let ResultOptions { protocol, language, .. } = &options.results;
        let language = Language::read(&protocol.instructions, language.as_ref())?;
        let open = |images: ImageOptions| {
            let ImageOptions { renderer, samples } = images;
            pool.install(|| render::open(renderer, options.gpu, samples, protocol.image_size, n_threads))
        };
        let renderer = options.images.map(open).transpose()?;
        let envs = (0..n_envs).map(|_| None).collect();
        Ok(Self { options, pool, language, renderer, envs })
    }

    /// Returns the renderer's name; `None` without images.
    #[must_use]
    pub fn renderer_name(&self) -> Option<String> {
        self.renderer.as_ref().map(|renderer| renderer.name())
    }

    /// Returns the control mode of the actions.
    #[must_use]
    pub fn control_mode(&self) -> ControlMode {
        self.options.morphology.control_mode(self.options.results.control_mode)
    }

    /// Returns the width of an action row.
    #[must_use]
    pub fn action_dim(&self) -> usize {
        self.control_mode().action_dim(self.options.morphology)
    }

    fn image_sizes(&self) -> Option<ImageSizes> {
        self.options.images.map(|_| self.options.results.protocol.image_size)
    }

    /// Starts episodes, each in an env of its own.
    ///
    /// # Errors
    /// If a task has the wrong morphology, or a perturbation or a sentence file does not fit it. No env has
    /// changed then.
    ///
    /// # Panics
    /// If there is no such env.
    pub fn reset(&mut self, starts: &[(usize, EpisodeStart)]) -> Result<(), VectorError> {
        for (_, start) in starts {
            self.check(start)?;
        }
        let (options, language) = (&self.options, &self.language);
        let sizes = self.image_sizes();
        let build = |(env, start): &(usize, EpisodeStart)| {
            (*env, Box::new(EnvState::new(*start, options, language, sizes)))
        };
        let built: Vec<_> = self.pool.install(|| starts.par_iter().with_max_len(1).map(build).collect());
        for (env, state) in built {
            self.envs[env] = Some(state);
        }
        Ok(())
    }

    fn check(&self, start: &EpisodeStart) -> Result<(), VectorError> {
        let (task, options) = (start.task.task(), &self.options.results);
        if task.morphology != self.options.morphology {
            return Err(VectorError::Morphology {
                task: start.task.name(),
                needed: task.morphology.name(),
                found: self.options.morphology.name(),
            });
        }
        start.perturbation.applies_to(&(task.nominal)(options.profile)).map_err(
            |(perturbation, reason)| VectorError::NotApplicable {
                task: start.task.name(),
                perturbation: perturbation.name(),
                reason: reason.to_string(),
            },
        )?;
        Ok(self.language.require(task, options.profile)?)
    }

    /// Executes up to `n_rows` action rows in each env of `envs`, until its episode is over. `actions` are
    /// those of all envs, `[n_envs, n_rows, action_dim]`.
    ///
    /// # Errors
    /// If an env has no episode yet. No env has changed then.
    ///
    /// # Panics
    /// If there is no such env, or `actions` has another size.
    pub fn step(&mut self, envs: &[bool], actions: &[f32], n_rows: usize) -> Result<(), VectorError> {
        let row_len = self.action_dim();
        let chunk_len = n_rows * row_len;
        assert_eq!(actions.len(), self.envs.len() * chunk_len, "actions must be those of all envs");
        self.require(envs.iter().enumerate().filter(|(_, is_named)| **is_named).map(|(env, _)| env))?;
        let end = self.options.results.protocol.end;
        let work = self.envs.par_iter_mut().zip(envs).zip(actions.par_chunks_exact(chunk_len.max(1)));
        self.pool.install(|| {
            work.with_max_len(1).for_each(|((env, is_named), chunk)| {
                if let (Some(env), true) = (env, *is_named) {
                    env.advance(chunk.chunks_exact(row_len), end);
                }
            });
        });
        Ok(())
    }

    /// Writes the observations of some envs at their places among those of all envs. `states` is
    /// `[n_envs, state_dim]`; `images` has, for each camera whose images are wanted, its index and
    /// `[n_envs, height, width, 3]`.
    ///
    /// # Errors
    /// If an env has no episode yet or no images, or the renderer fails.
    ///
    /// # Panics
    /// If there is no such env or camera, an env occurs twice, or a buffer has another size.
    pub fn observe(
        &mut self,
        envs: &[bool],
        states: &mut [f32],
        images: &mut [(usize, &mut [u8])],
    ) -> Result<(), VectorError> {
        self.require(envs.iter().enumerate().filter(|(_, is_named)| **is_named).map(|(env, _)| env))?;
        let n_envs = self.envs.len();
        let named = |env: &usize| envs[*env];
        let state_dim = self.options.morphology.state_dim();
        assert_eq!(states.len(), n_envs * state_dim, "states must be those of all envs");
        for (env, state) in
            self.envs.iter_mut().zip(states.chunks_exact_mut(state_dim)).zip(envs).filter_map(
                |((env, state), is_named)| env.as_mut().filter(|_| *is_named).map(|env| (env, state)),
            )
        {
            env.episode.world.write_state(state);
            if !images.is_empty() {
                env.episode.world.write_snapshot(&mut env.snapshot);
            }
        }
        if images.is_empty() {
            return Ok(());
        }
        let first = (0..n_envs).find(named).unwrap_or(0);
        let renderer = self.renderer.as_mut().ok_or(VectorError::NoImages { env: first })?;
        let mut by_env: Vec<Vec<View<'_>>> = (0..n_envs).map(|_| Vec::with_capacity(images.len())).collect();
        for (camera_idx, buffer) in images {
            let len = buffer.len() / n_envs.max(1);
            for (env, out) in buffer.chunks_exact_mut(len.max(1)).enumerate().filter(|(env, _)| envs[*env]) {
                let state = self.envs[env].as_ref().ok_or(VectorError::NotReset { env })?;
                let scene = state.view.as_ref().ok_or(VectorError::NoImages { env })?;
                by_env[env].push(View { scene, snapshot: &state.snapshot, camera_idx: *camera_idx, out });
            }
        }
        // The renderer prepares an env once for all its views that follow each other.
        let mut views: Vec<View<'_>> = by_env.into_iter().flatten().collect();
        Ok(self.pool.install(|| renderer.render(&mut views))?)
    }

    /// Returns what has come of the episode in an env.
    ///
    /// # Errors
    /// If the env has no episode yet.
    pub fn progress(&self, env: usize) -> Result<EpisodeProgress, VectorError> {
        let end = self.options.results.protocol.end;
        self.env(env).map(|state| state.progress(end))
    }

    /// Returns the start of the episode in an env, and its instruction.
    ///
    /// # Errors
    /// If the env has no episode yet.
    pub fn episode(&self, env: usize) -> Result<(EpisodeStart, &str), VectorError> {
        self.env(env).map(|state| (state.start, state.instruction.as_str()))
    }

    /// Returns the state of an env in the format of `replay --start` (docs/trajectories.md).
    ///
    /// # Errors
    /// If the env has no episode yet.
    pub fn state(&self, env: usize) -> Result<TrajectoryFile, VectorError> {
        let state = self.env(env)?;
        let (arms, bodies) = TrajectoryFile::of_state(&state.episode.world.state(), &state.bodies);
        Ok(TrajectoryFile {
            task: state.start.task.name().to_owned(),
            control_mode: self.control_mode().name().to_owned(),
            profile: self.options.results.profile,
            sizes: state.sizes.clone(),
            arms,
            bodies,
            actions: Vec::new(),
            recorded: None,
        })
    }

    /// Puts an env into a state. Its episode starts anew there: at step 0, not yet successful, and with the
    /// fingerprint of a trajectory from that state.
    ///
    /// # Errors
    /// If the env has no episode yet, or if the state belongs to another task or to bodies of other sizes, or
    /// has impossible values. The env has not changed then.
    pub fn set_state(&mut self, env: usize, file: &TrajectoryFile) -> Result<(), VectorError> {
        let state = self.env(env)?;
        let task = state.start.task;
        if file.task != task.name() && file.task != task.task().env_id {
            return Err(VectorError::OtherTask { env, expected: task.name(), found: file.task.clone() });
        }
        let is_near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-4;
        if file.sizes.len() != state.sizes.len() || !file.sizes.iter().zip(&state.sizes).all(is_near) {
            let (expected, found) = (state.sizes.clone(), file.sizes.clone());
            return Err(VectorError::OtherSizes { env, expected, found });
        }
        let n_arms = task.task().morphology.n_arms();
        let world_state = file.world_state(Path::new("the state"), n_arms, &state.bodies)?;
        let state = self.envs[env].as_mut().ok_or(VectorError::NotReset { env })?;
        state.episode.restart(&world_state);
        state.error = None;
        Ok(())
    }

    fn env(&self, env: usize) -> Result<&EnvState, VectorError> {
        self.envs.get(env).and_then(Option::as_deref).ok_or(VectorError::NotReset { env })
    }

    fn require(&self, mut envs: impl Iterator<Item = usize>) -> Result<(), VectorError> {
        envs.try_for_each(|env| self.env(env).map(|_| ()))
    }
}

impl EnvState {
    fn new(
        start: EpisodeStart,
        options: &VectorOptions,
        language: &Language,
        images: Option<ImageSizes>,
    ) -> Self {
        let EpisodeStart { task, perturbation, episode, suite_seed } = start;
        let ResultOptions { profile, strength, control_mode, .. } = options.results;
        let spec = EpisodeSpec { task, perturbation, strength, profile };
        let seed = stream::episode_seed(suite_seed, task.name(), episode);
        let scene = spec.draw_with(language, seed);
        Self {
            start,
            seed,
            episode: spec.start(&scene, options.morphology.control_mode(control_mode)),
            error: None,
            view: images.map(|sizes| RenderScene::new(&scene, sizes)),
            snapshot: Snapshot::identity(scene.bodies.len(), scene.robots.len()),
            bodies: scene.bodies.iter().map(|body| body.name).collect(),
            instruction: scene.instruction,
            sizes: scene.sizes,
        }
    }

    fn advance<'a>(&mut self, rows: impl Iterator<Item = &'a [f32]>, end: EpisodeEnd) {
        for row in rows {
            if self.is_over(end) {
                break;
            }
            self.error = self.episode.step(row).err();
        }
    }

    fn is_won(&self, end: EpisodeEnd) -> bool {
        end == EpisodeEnd::Success && self.episode.first_success_step().is_some()
    }

    fn is_over(&self, end: EpisodeEnd) -> bool {
        self.is_won(end) || self.episode.steps() >= self.start.task.task().max_steps || self.error.is_some()
    }

    fn progress(&self, end: EpisodeEnd) -> EpisodeProgress {
        let episode = &self.episode;
        EpisodeProgress {
            steps: episode.steps(),
            first_success_step: episode.first_success_step(),
            unmet: episode.unmet().map(Predicate::name),
            is_over: self.is_over(end),
            is_won: self.is_won(end),
            error: self.error,
            fingerprint: episode.fingerprint(),
            seed: self.seed,
        }
    }
}
