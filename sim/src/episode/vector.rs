//! Vectorised environments for a caller in the same process, who assigns episodes to envs, supplies actions
//! and requests observations.
//!
//! `serve` runs the same episodes for policies in other processes. Here there are no queues and no waiting:
//! each call works on the selected envs in parallel and returns.

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
use super::steps::{DivergedError, Episode, env_bytes};
use crate::perturb::{Composition, Language, SentencesError};
use crate::physics::WorldState;
use crate::predicate::Predicate;
use crate::tasks::TaskId;
use crate::trajectory::{ArmFile, BodyFile, SIZE_TOLERANCE, TrajectoryError, TrajectoryFile};

/// Sets of observations that the caller keeps for each env.
const N_BUFFERS: usize = 2;

/// Options of a [`VectorEnv`].
#[derive(Clone, Debug)]
pub struct VectorOptions {
    /// Number of envs.
    pub n_envs: usize,
    /// Morphology of all tasks.
    pub morphology: Morphology,
    /// Options that change an episode. The latency is not used: the caller decides when a chunk takes effect.
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
    #[error("{task} is a {needed} task, but these envs are {found}; make another vector env")]
    Morphology { task: &'static str, needed: &'static str, found: &'static str },
    #[error("{perturbation} does not apply to {task}: {reason}")]
    NotApplicable { task: &'static str, perturbation: &'static str, reason: String },
    #[error("env {env} has no episode yet: reset it first")]
    NotReset { env: usize },
    #[error("the envs have no images: they were made without them")]
    NoImages,
    #[error(transparent)]
    State(#[from] TrajectoryError),
    #[error("the state belongs to {found}, but env {env} runs an episode of {expected}")]
    OtherTask { env: usize, expected: &'static str, found: String },
    #[error("the state has bodies of sizes {found:?}, but the episode in env {env} has {expected:?}")]
    OtherSizes { env: usize, expected: Vec<f64>, found: Vec<f64> },
}

/// Identity of an episode, apart from the options of its [`VectorEnv`].
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

impl EpisodeStart {
    /// Returns the seed of the episode.
    #[must_use]
    pub fn seed(&self) -> u64 {
        stream::episode_seed(self.suite_seed, self.task.name(), self.episode)
    }
}

impl VectorOptions {
    /// Returns the sizes of the images; `None` without images.
    fn image_sizes(&self) -> Option<ImageSizes> {
        self.images.map(|_| self.results.protocol.image_size)
    }
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
}

/// One env with an episode.
struct EnvState {
    start: EpisodeStart,
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
        let sizes = options.image_sizes();
        let observation_bytes = block_pages(options.morphology, sizes) * PAGE_BYTES;
        let bytes_per_env = env_bytes(sizes.is_some()) + (N_BUFFERS * observation_bytes) as u64;
        let needed = (n_envs as u64).saturating_mul(bytes_per_env);
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
        let build =
            |(env, start): &(usize, EpisodeStart)| (*env, Box::new(EnvState::new(*start, options, language)));
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

    /// Executes up to `n_rows` action rows in each env selected by `envs`, `[n_envs]`, until its episode is
    /// over. `actions` are those of all envs, `[n_envs, n_rows, action_dim]`.
    ///
    /// # Errors
    /// If an env has no episode yet. No env has changed then.
    ///
    /// # Panics
    /// If `envs` or `actions` has another size.
    pub fn step(&mut self, envs: &[bool], actions: &[f32], n_rows: usize) -> Result<(), VectorError> {
        let row_len = self.action_dim();
        let chunk_len = n_rows * row_len;
        assert_eq!(actions.len(), self.envs.len() * chunk_len, "actions must be those of all envs");
        self.require(envs)?;
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

    /// Writes the observations of the selected envs at their places among those of all envs. `states` is
    /// `[n_envs, state_dim]`; `images` has, for each camera whose images are wanted, its index and
    /// `[n_envs, height, width, 3]`.
    ///
    /// # Errors
    /// If an env has no episode yet or no images, or the renderer fails.
    ///
    /// # Panics
    /// If there is no such camera, or a buffer has another size.
    pub fn observe(
        &mut self,
        envs: &[bool],
        states: &mut [f32],
        images: &mut [(usize, &mut [u8])],
    ) -> Result<(), VectorError> {
        self.require(envs)?;
        let n_envs = self.envs.len();
        let state_dim = self.options.morphology.state_dim();
        assert_eq!(states.len(), n_envs * state_dim, "states must be those of all envs");
        let selected =
            self.envs.iter_mut().zip(envs).map(|(env, is_selected)| env.as_mut().filter(|_| *is_selected));
        for (env, state) in selected.zip(states.chunks_exact_mut(state_dim)) {
            let Some(env) = env else { continue };
            env.episode.world.write_state(state);
            if !images.is_empty() {
                env.episode.world.write_snapshot(&mut env.snapshot);
            }
        }
        if images.is_empty() {
            return Ok(());
        }
        let renderer = self.renderer.as_mut().ok_or(VectorError::NoImages)?;
        let mut views = Vec::with_capacity(n_envs * images.len());
        let outs =
            images.iter_mut().map(|(idx, buffer)| (*idx, buffer.chunks_exact_mut(buffer.len() / n_envs)));
        let mut outs: Vec<_> = outs.collect();
        // The views of an env stand together: the renderer prepares it once for all of them.
        for (env, is_selected) in self.envs.iter().zip(envs) {
            for (camera_idx, outs) in &mut outs {
                let out = outs.next().expect("a buffer holds an image of every env");
                if let (Some(env), true) = (env, *is_selected) {
                    let scene = env.view.as_ref().ok_or(VectorError::NoImages)?;
                    views.push(View { scene, snapshot: &env.snapshot, camera_idx: *camera_idx, out });
                }
            }
        }
        Ok(self.pool.install(|| renderer.render(&mut views))?)
    }

    /// Returns the progress of the episode in an env.
    ///
    /// # Errors
    /// If the env has no episode yet.
    pub fn progress(&self, env: usize) -> Result<EpisodeProgress, VectorError> {
        let end = self.options.results.protocol.end;
        self.env(env).map(|state| state.progress(end))
    }

    /// Returns the hash of the trajectory in an env so far, as in a results file.
    ///
    /// # Errors
    /// If the env has no episode yet.
    pub fn fingerprint(&self, env: usize) -> Result<u64, VectorError> {
        self.env(env).map(|state| state.episode.fingerprint())
    }

    /// Returns the identity of the episode in an env, and its instruction.
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
        let WorldState { arms, bodies } = state.episode.world.state();
        let names = state.bodies.iter().map(|name| (*name).to_owned());
        Ok(TrajectoryFile {
            task: state.start.task.name().to_owned(),
            control_mode: self.control_mode().name().to_owned(),
            profile: self.options.results.profile,
            sizes: state.sizes.clone(),
            arms: arms.iter().map(ArmFile::of).collect(),
            bodies: names.zip(bodies.iter().map(BodyFile::of)).collect(),
            actions: Vec::new(),
            recorded: None,
        })
    }

    /// Sets the arms and bodies of an env. Its episode restarts from there: at step 0, not yet successful,
    /// and with the fingerprint of a trajectory from that state.
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
        let is_near = |(a, b): (&f64, &f64)| (a - b).abs() <= SIZE_TOLERANCE;
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

    /// Checks that every selected env has an episode.
    fn require(&self, envs: &[bool]) -> Result<(), VectorError> {
        let mut selected = (0..envs.len()).filter(|env| envs[*env]);
        selected.try_for_each(|env| self.env(env).map(drop))
    }
}

impl EnvState {
    fn new(start: EpisodeStart, options: &VectorOptions, language: &Language) -> Self {
        let EpisodeStart { task, perturbation, .. } = start;
        let ResultOptions { profile, strength, control_mode, .. } = options.results;
        let spec = EpisodeSpec { task, perturbation, strength, profile };
        let scene = spec.draw_with(language, start.seed());
        Self {
            start,
            episode: spec.start(&scene, options.morphology.control_mode(control_mode)),
            error: None,
            view: options.image_sizes().map(|sizes| RenderScene::new(&scene, sizes)),
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

    fn is_over(&self, end: EpisodeEnd) -> bool {
        self.error.is_some() || self.episode.is_over(end, self.start.task.task().max_steps)
    }

    fn progress(&self, end: EpisodeEnd) -> EpisodeProgress {
        let episode = &self.episode;
        EpisodeProgress {
            steps: episode.steps(),
            first_success_step: episode.first_success_step(),
            unmet: episode.unmet().map(Predicate::name),
            is_over: self.is_over(end),
            is_won: episode.is_won(end),
            error: self.error,
        }
    }
}
