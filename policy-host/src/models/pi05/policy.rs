//! The [`Policy`] that runs π0.5 networks on the CPU.

use std::path::Path;

use ipc_types::{ControlMode, Morphology, ObservationView};
use run_config::QueryOptions;

use super::checkpoint::{Pi05Checkpoint, Pi05Description, is_pi05_folder};
use super::model::Pi05Model;
use super::processor::{Pi05Processor, prompt};
use crate::formats::folder::{NetworkCheck, build_networks, check_networks, checkpoint_folders};
use crate::formats::{CheckpointError, CheckpointFolderError, PolicyCheck};
use crate::models::family::NetworkSource;
use crate::nn::Precision;
use crate::policy::{ActionChunk, Policy, PolicyError};

/// Samples that are computed together, and read the weights once. It bounds the memory of a batch.
const SAMPLES_PER_BATCH: usize = 8;
/// Operations of a query from which on the time that it takes is announced.
const MIN_ANNOUNCED_FLOP: u64 = 100_000_000_000;

/// π0.5 on the CPU, with one network per morphology in its checkpoint folder.
#[derive(Debug)]
pub(crate) struct Pi05Policy {
    networks: Vec<Pi05Network<Pi05Model>>,
    precision: Precision,
}

/// The network for one morphology, which `model` computes.
#[derive(Debug)]
pub(crate) struct Pi05Network<M> {
    pub(crate) model: M,
    pub(crate) processor: Pi05Processor,
}

/// Checks the configuration, the weights headers and the vocabulary of a checkpoint against the robots of a
/// run and their control modes, and the size of the weights against the memory that is available. Loads no
/// weights. Also resolves how chunks are executed.
///
/// # Errors
/// The first mismatch found.
pub(crate) fn check(
    source: &NetworkSource,
    robots: &[(Morphology, ControlMode)],
    requested: QueryOptions,
) -> Result<PolicyCheck, CheckpointFolderError> {
    let mut networks = Vec::new();
    for checkpoint in open(&source.folder)? {
        let Pi05Description { mapping, chunk, notes, .. } = checkpoint.description();
        networks.push(NetworkCheck { mapping: mapping.clone(), chunk: *chunk, notes: notes.clone() });
        checkpoint.tokenizer()?;
        checkpoint.check_memory(source.precision)?;
    }
    check_networks(&source.folder, networks, robots, requested)
}

/// Returns a sentence if some of these instructions, each with its robot, give prompts that are longer than a
/// network reads.
///
/// # Errors
/// If the checkpoint or its vocabulary cannot be read.
pub(crate) fn long_prompts(
    folder: &Path,
    instructions: &[(Morphology, String)],
) -> Result<Vec<String>, CheckpointFolderError> {
    let mut notes = Vec::new();
    for checkpoint in open(folder)? {
        let description = checkpoint.description();
        let tokenizer = checkpoint.tokenizer()?;
        // Every number of the state has as many digits as any.
        let state = vec![0.0; description.n_prompt_numbers()];
        let own = instructions.iter().filter(|(robot, _)| *robot == description.mapping.morphology);
        let lengths =
            own.map(|(_, text)| Ok(tokenizer.n_tokens(&prompt(text, &state)).map(|n| (n, text))?));
        let lengths = lengths.collect::<Result<Vec<_>, CheckpointError>>()?;
        let max = description.max_tokens;
        let n_long = lengths.iter().filter(|(n, _)| *n > max).count();
        if let Some((n, text)) = lengths.iter().max().filter(|_| n_long > 0) {
            notes.push(format!(
                "{n_long} of {} instructions give prompts of up to {n} tokens, of which the network reads {max}: the end, with \
                 the state and `Action:`, is cut off, as in LeRobot. The longest is `{text}`",
                lengths.len()
            ));
        }
    }
    Ok(notes)
}

fn open(folder: &Path) -> Result<Vec<Pi05Checkpoint>, CheckpointFolderError> {
    let folders = checkpoint_folders(folder, "a configuration or weights", is_pi05_folder)?;
    Ok(folders.iter().map(|folder| Pi05Checkpoint::open(folder)).collect::<Result<_, _>>()?)
}

/// Opens the checkpoints for these robots and loads each with `load(checkpoint, n_steps)`.
pub(crate) fn load_networks<M, E: From<CheckpointFolderError>>(
    source: &NetworkSource,
    robots: &[Morphology],
    load: impl Fn(&Pi05Checkpoint, usize) -> Result<M, E>,
) -> Result<Vec<Pi05Network<M>>, E> {
    let robot_of = |checkpoint: &Pi05Checkpoint| Ok(checkpoint.description().mapping.morphology);
    build_networks(&source.folder, open(&source.folder)?, robots, robot_of, |checkpoint| {
        let description = checkpoint.description().clone();
        let tokenizer = checkpoint.tokenizer().map_err(CheckpointFolderError::from)?;
        let n_steps = source.n_steps.map_or(description.n_steps, |n_steps| n_steps.get() as usize);
        let model = load(&checkpoint, n_steps)?;
        Ok(Pi05Network { model, processor: Pi05Processor { tokenizer, description, n_steps } })
    })
}

impl Pi05Policy {
    /// Loads the networks for `robots`.
    ///
    /// # Errors
    /// The first file or tensor that is missing, unexpected or damaged.
    pub(crate) fn load(source: &NetworkSource, robots: &[Morphology]) -> Result<Self, CheckpointFolderError> {
        let precision = source.precision;
        let networks = load_networks(source, robots, |checkpoint, n_steps| {
            checkpoint.check_memory(precision)?;
            Ok::<_, CheckpointFolderError>(checkpoint.load(precision, n_steps)?)
        })?;
        Ok(Self { networks, precision })
    }

    fn network(&self, morphology: Morphology) -> Option<&Pi05Network<Pi05Model>> {
        self.networks.iter().find(|network| network.processor.description.mapping.morphology == morphology)
    }
}

impl Policy for Pi05Policy {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        assert_eq!(answer.len(), observation.n_envs(), "one chunk per env");
        let morphology = observation.morphology();
        let Pi05Network { model, processor } =
            self.network(morphology).ok_or(PolicyError::Morphology { found: morphology.name() })?;
        processor.description.mapping.check(observation)?;
        let prompts = processor.prompts(observation)?;
        let parts = prompts.chunks(SAMPLES_PER_BATCH).zip(answer.chunks_mut(SAMPLES_PER_BATCH));
        for (first_env, (prompts, answer)) in (0..).step_by(SAMPLES_PER_BATCH).zip(parts) {
            let mut batch = processor.batch(observation, first_env, prompts);
            let mut actions = std::mem::take(&mut batch.noise);
            model.sample(batch.input(), &mut actions, None);
            processor.write_chunks(&actions, |idx| observation.env(first_env + idx).state, answer);
        }
        Ok(())
    }

    fn flop_per_query(&self, morphology: Morphology, _execute: u32) -> u64 {
        self.network(morphology).map_or(0, |network| network.processor.flop_per_query())
    }

    fn run_benchmark(&self) -> u64 {
        let is_slow = |network: &&Pi05Network<_>| network.processor.flop_per_query() >= MIN_ANNOUNCED_FLOP;
        self.networks.iter().find(is_slow).map_or(0, |network| network.model.run_benchmark())
    }

    fn startup_message(&self, execute: u32, flop_per_s: f64) -> Option<String> {
        let notes =
            self.networks.iter().map(|network| network.startup_message(self.precision, execute, flop_per_s));
        Some(notes.collect::<Vec<_>>().join("; "))
    }
}

impl Pi05Network<Pi05Model> {
    /// Returns what the network is and, if a query takes long, how long.
    fn startup_message(&self, precision: Precision, execute: u32, flop_per_s: f64) -> String {
        let mut text = self.processor.startup_message(precision);
        let flop = self.processor.flop_per_query();
        if flop >= MIN_ANNOUNCED_FLOP {
            let horizon = self.processor.description.architecture.horizon as u32;
            let per_query = flop as f64 / flop_per_s;
            let per_hundred = per_query * 100.0 / f64::from(execute.clamp(1, horizon));
            text += &format!(
                "; a query takes about {per_query:.0} s on this machine, 100 control steps about {per_hundred:.0} s"
            );
        }
        text
    }
}
