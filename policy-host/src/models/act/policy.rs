//! The [`Policy`] that runs ACT networks.
//!
//! Each sample is computed by one thread with sequential kernels; samples run in parallel on the current
//! rayon pool. The samples left over when they do not divide evenly among the threads are computed one after
//! another by all threads together. Either way every value results from the same operations in the same
//! order.

use std::sync::{Mutex, MutexGuard, PoisonError};

use ipc_types::{ControlMode, ImageSizes, Morphology, ObservationView};
use rayon::prelude::*;
use run_config::QueryOptions;
use run_config::trace::{self, Activity};

use super::checkpoint::{StoredNetwork, load_networks, open_all};
use super::image::Image;
use super::leading::TokenCache;
use super::model::{ActInput, ActModel, ActScratch};
use crate::formats::folder::{NetworkCheck, check_networks};
use crate::formats::{CheckpointFolderError, ObservationMapping, PolicyCheck};
use crate::models::family::NetworkSource;
use crate::policy::{ActionChunk, ChunkRows, DEFAULT_ENSEMBLE_DECAY, Policy, PolicyError};
use crate::text::TextEncoder;

/// Maximum number of samples whose images one thread takes through the backbone together. Each kernel is then
/// read once for all of them.
const MAX_SAMPLES_PER_JOB: usize = 4;

/// ACT with one network per morphology in its checkpoint folder.
#[derive(Debug)]
pub struct ActPolicy {
    networks: Vec<Network>,
    rows: ChunkRows,
}

/// The network for one morphology, with the working memory of its threads.
#[derive(Debug)]
struct Network {
    model: ActModel,
    mapping: ObservationMapping,
    /// Decay of the temporal ensemble's weights, if the checkpoint specifies one.
    ensemble_decay: Option<f64>,
    tokens: Mutex<TokenCache>,
    /// One worker per thread, each computing its own samples.
    workers: Vec<Worker>,
    /// Working memory for a single sample computed by all threads together.
    team: Worker,
}

#[derive(Debug)]
struct Worker {
    scratch: ActScratch,
    /// Instruction token `[d]` of the current sample.
    token: Vec<f32>,
    /// Network state input `[state_dim]` of the current sample.
    state: Vec<f32>,
}

/// Checks the configuration and the weights header of a checkpoint against the robots of a run and their
/// control modes, without building the networks, and resolves how its chunks are executed.
///
/// # Errors
/// The first mismatch found.
pub(crate) fn check(
    source: &NetworkSource,
    robots: &[(Morphology, ControlMode)],
    requested: QueryOptions,
) -> Result<PolicyCheck, CheckpointFolderError> {
    let mut networks = Vec::new();
    for mut checkpoint in open_all(&source.folder)? {
        checkpoint.check_values()?;
        let mapping = checkpoint.mapping()?.clone();
        checkpoint.check_text_encoder()?;
        let (chunk, notes) = (checkpoint.chunk_settings(), checkpoint.notes().to_vec());
        networks.push(NetworkCheck { mapping, chunk, notes });
    }
    check_networks(&source.folder, networks, robots, requested)
}

impl ActPolicy {
    /// Loads the networks for `robots`, for up to `n_threads` threads and images of these sizes.
    ///
    /// # Errors
    /// The first file or tensor that is missing, unexpected or damaged.
    pub fn load(
        source: &NetworkSource,
        n_threads: usize,
        robots: &[Morphology],
        images: ImageSizes,
    ) -> Result<Self, CheckpointFolderError> {
        let precision = source.precision;
        let networks = load_networks(&source.folder, robots, |stored| {
            let StoredNetwork { architecture, normalisation, state_dict, .. } = stored;
            let model = ActModel::new(architecture, normalisation, &state_dict, precision, &images.all());
            let network = Network::new(model, stored.mapping, stored.encoder, n_threads);
            Ok::<_, CheckpointFolderError>(Network { ensemble_decay: stored.ensemble_decay, ..network })
        })?;
        Ok(Self { networks, rows: ChunkRows::Executed })
    }

    /// Creates a policy with a single network, which computes whole chunks.
    #[must_use]
    pub fn new(
        model: ActModel,
        mapping: ObservationMapping,
        encoder: Option<TextEncoder>,
        n_threads: usize,
    ) -> Self {
        Self { networks: vec![Network::new(model, mapping, encoder, n_threads)], rows: ChunkRows::All }
    }

    fn network(&self, morphology: Morphology) -> Option<&Network> {
        self.networks.iter().find(|network| network.mapping.morphology == morphology)
    }
}

impl Policy for ActPolicy {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        assert_eq!(answer.len(), observation.n_envs(), "one chunk per env");
        let morphology = observation.morphology();
        let network = self.networks.iter_mut().find(|network| network.mapping.morphology == morphology);
        let network = network.ok_or(PolicyError::Morphology { found: morphology.name() })?;
        network.mapping.check(observation)?;
        network.run(observation, self.rows, answer);
        Ok(())
    }

    fn compute_whole_chunks(&mut self) {
        self.rows = ChunkRows::All;
    }

    fn flop_per_query(&self, morphology: Morphology, execute: u32) -> u64 {
        self.network(morphology).map_or(0, |network| {
            let architecture = network.model.architecture();
            architecture.flop_per_query(self.rows.count(execute, architecture.horizon))
        })
    }

    fn ensemble_decay(&self, morphology: Morphology) -> f64 {
        self.network(morphology).and_then(|network| network.ensemble_decay).unwrap_or(DEFAULT_ENSEMBLE_DECAY)
    }
}

impl Network {
    fn new(
        model: ActModel,
        mapping: ObservationMapping,
        encoder: Option<TextEncoder>,
        n_threads: usize,
    ) -> Self {
        let n_threads = n_threads.max(1);
        let worker = |n_samples, n_members| Worker {
            scratch: model.scratch(n_samples, n_members),
            token: vec![0.0; model.architecture().hidden_dim],
            state: vec![0.0; model.architecture().state_dim.unwrap_or(0)],
        };
        let workers = std::iter::repeat_with(|| worker(MAX_SAMPLES_PER_JOB, 1)).take(n_threads).collect();
        Self {
            workers,
            team: worker(1, n_threads),
            mapping,
            ensemble_decay: None,
            tokens: Mutex::new(TokenCache::new(encoder)),
            model,
        }
    }

    /// Runs all samples. As many as divide evenly among the threads run one thread per sample, in jobs of up
    /// to [`MAX_SAMPLES_PER_JOB`] that keep every thread busy; all threads together then compute each of the
    /// rest.
    fn run(&mut self, observation: &ObservationView<'_>, rows: ChunkRows, answer: &mut [ActionChunk]) {
        let Self { model, mapping, tokens, workers, team, .. } = self;
        let n_threads = workers.len();
        let n_apart = answer.len() - answer.len() % n_threads;
        let (apart, together) = answer.split_at_mut(n_apart);
        let n_last = n_apart / n_threads % MAX_SAMPLES_PER_JOB;
        let (whole, last) = apart.split_at_mut(n_apart - n_last * n_threads);
        let mut first_env = 0;
        let jobs =
            whole.chunks_mut(MAX_SAMPLES_PER_JOB).chain(last.chunks_mut(n_last.max(1))).map(|chunks| {
                first_env += chunks.len();
                (first_env - chunks.len(), chunks)
            });
        let jobs = Mutex::new(jobs);
        workers.par_iter_mut().with_max_len(1).for_each(|worker| {
            while let Some((first_env, chunks)) = next_job(&jobs) {
                let sharing = trace::span(Activity::Share);
                let n = chunks.len() as u64;
                worker.run((model, mapping, tokens), (observation, first_env), rows, chunks);
                sharing.finish(n);
            }
        });
        for (first_env, chunks) in (n_apart..).zip(together.chunks_mut(1)) {
            team.run((model, mapping, tokens), (observation, first_env), rows, chunks);
        }
    }
}

impl Worker {
    /// Computes the chunks of the envs starting at `first_env`, one per element of `chunks`.
    fn run(
        &mut self,
        (model, mapping, tokens): (&ActModel, &ObservationMapping, &Mutex<TokenCache>),
        (observation, first_env): (&ObservationView<'_>, usize),
        rows: ChunkRows,
        chunks: &mut [ActionChunk],
    ) {
        let image = |sample: usize, camera: usize| {
            let (pixels, size) = observation.env(first_env + sample).image(mapping.cameras[camera]);
            Image { pixels, size }
        };
        model.encode_images(chunks.len(), image, &mut self.scratch);
        for (sample, chunk) in chunks.iter_mut().enumerate() {
            let env = observation.env(first_env + sample);
            let has_token = match lock(tokens).get(env.instruction, model.leading()) {
                Some(token) => {
                    self.token.copy_from_slice(token);
                    true
                }
                None => false,
            };
            mapping.gather_state(env.state, &mut self.state);
            let input = ActInput { state: &self.state, instruction_token: has_token.then_some(&self.token) };
            let architecture = model.architecture();
            let n_rows = rows.count(env.record.execute, architecture.horizon);
            let rows = chunk.reset(n_rows, architecture.action_dim);
            model.forward(sample, input, &mut self.scratch, rows);
        }
    }
}

/// Takes the next job from a queue shared between threads.
fn next_job<J>(jobs: &Mutex<impl Iterator<Item = J>>) -> Option<J> {
    lock(jobs).next()
}

/// Locks `mutex`, ignoring poison: a panicking worker aborts the query, and the guarded data stays
/// consistent.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
