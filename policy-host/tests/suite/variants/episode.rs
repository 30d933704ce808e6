//! An episode of a checkpoint, with the queries of the simulator: `execute` rows of each answer are executed
//! before the next query.

use std::cell::RefCell;
use std::collections::BTreeMap;

use ipc_types::{ControlMode, EnvRecord, ImageSizes, Morphology};
use policy_host::{ActionChunk, LoadError, Policy, PolicyError, PolicySpec, check, load};
use run_config::{Execution, QueryOptions, error_chain};

use crate::batch::ObservationBatch;

/// Seed of the policy, instruction, and an entry of the state that never changes, as in
/// `python/variants/loop.py`.
const POLICY_SEED: u64 = 7;
const INSTRUCTION: &str = "Raise the red cube above the table.";
const CONSTANT_ENTRY: usize = 8;
const CONSTANT: f32 = 0.5;

/// Everything that an episode shows of a policy.
pub(crate) struct VariantEpisode {
    /// Executed actions `[n_steps, action_dim]`.
    pub(crate) actions: Vec<f32>,
    /// Sentences that a run shows at its start and keeps.
    pub(crate) notes: Vec<String>,
}

/// Loads the checkpoint in a folder and executes `n_values` entries of its actions, at least one step.
/// Returns the error if it is refused.
pub(crate) fn run(folder: &tempfile::TempDir, kind: &str, n_values: usize) -> Result<VariantEpisode, String> {
    let spec: PolicySpec = format!("{kind}:{}", folder.path().display()).parse().unwrap();
    let error = |error: LoadError| error_chain(&error);
    let robots = [(Morphology::Single, ControlMode::EeDeltaPose)];
    let found = check(&spec, &robots, QueryOptions::default()).map_err(error)?;
    let Execution { mode, execute } = found.execution.expect("a checkpoint decides");
    let mut policy = load(&spec, 1, mode, &[Morphology::Single]).map_err(error)?;
    let actions = execute_steps(&mut *policy, execute, n_values).map_err(|error| error_chain(&error))?;
    let differences =
        found.mappings.iter().filter_map(|mapping| mapping.image_differences(ImageSizes::BENCHMARK));
    Ok(VariantEpisode { actions, notes: found.notes.into_iter().chain(differences).collect() })
}

fn execute_steps(policy: &mut dyn Policy, execute: u32, n_values: usize) -> Result<Vec<f32>, PolicyError> {
    let (mut actions, mut step) = (Vec::new(), 0);
    for query in 0.. {
        let mut chunk = [ActionChunk::default()];
        policy.act(&observation(step, query, execute).view(), &mut chunk)?;
        let [chunk] = chunk;
        let n_rows = (chunk.rows().len() / chunk.action_dim()).min(execute as usize);
        actions.extend_from_slice(&chunk.rows()[..n_rows * chunk.action_dim()]);
        step += n_rows as u32;
        if actions.len() >= n_values {
            break;
        }
    }
    actions.truncate(n_values);
    Ok(actions)
}

/// Returns the observation of a control step.
fn observation(step: u32, query: u32, execute: u32) -> ObservationBatch {
    thread_local! {
        static GENERATED: RefCell<BTreeMap<u32, ObservationBatch>> = const { RefCell::new(BTreeMap::new()) };
    }
    let mut batch = GENERATED.with_borrow_mut(|generated| {
        let batch =
            generated.entry(step).or_insert_with(|| ObservationBatch::of(Morphology::Single, &[step]));
        ObservationBatch { header: batch.header, pages: batch.pages.clone() }
    });
    let record: &mut EnvRecord = bytemuck::cast_mut(&mut batch.pages[0]);
    (record.slot, record.step, record.query, record.execute) = (0, step, query, execute);
    record.policy_seed = POLICY_SEED;
    record.state[CONSTANT_ENTRY] = CONSTANT;
    record.instruction_len = INSTRUCTION.len() as u32;
    record.instruction[..INSTRUCTION.len()].copy_from_slice(INSTRUCTION.as_bytes());
    batch
}
