//! Expected costs of episodes, by which shards are cut. A wrong one makes shards unequal and nothing else.

use std::collections::HashMap;
use std::path::Path;

use policy_host::PolicySpec;

use crate::plan::RunPlan;
use crate::plan::partition::order::{EpisodeOrder, PolicyGroup};
use crate::store::results::ResultsFile;

/// Core-seconds of a control step, by its policy.
const IDLE_STEP_S: f64 = 3e-5;
const RANDOM_STEP_S: f64 = 6e-5;
const MOVING_STEP_S: f64 = 1.5e-4;
/// Core-seconds of the images of a query.
const IMAGES_S: f64 = 3e-3;
/// Core-seconds of a query for each byte of the weights.
const PER_BYTE_S: f64 = 2.5e-10;

/// Expected core-seconds of an episode of each policy under each condition.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct EpisodeCosts {
    seconds: Vec<f64>,
    n_conditions: usize,
}

impl EpisodeCosts {
    /// Returns the costs of the policies of a plan: those measured in an earlier run, by policy and task, and
    /// otherwise estimates from horizons and sizes of weights.
    pub(crate) fn new(plan: &RunPlan, earlier: Option<&ResultsFile>) -> Self {
        let measured = earlier.map(measure).unwrap_or_default();
        let mut seconds = Vec::new();
        for (policy, execution) in plan.policies.iter().zip(&plan.executions) {
            let step_s = estimate(&policy.spec, execution.execute);
            // Of a policy that was measured on some tasks, the others cost as much per step.
            let own = measured.iter().filter(|((name, _), _)| *name == policy.name).map(|(_, sums)| sums);
            let [all_s, all_steps] =
                own.fold([0.0; 2], |sum, own| [sum[0] + own.seconds, sum[1] + own.steps]);
            let step_s = if all_steps > 0.0 { all_s / all_steps } else { step_s };
            for condition in &plan.conditions {
                let own = measured.get(&(policy.name.clone(), condition.task.name()));
                let estimate = step_s * f64::from(condition.task.task().max_steps);
                seconds.push(own.map_or(estimate, |own| own.seconds / own.n).max(f64::MIN_POSITIVE));
            }
        }
        Self::of(seconds, plan.conditions.len())
    }

    /// Makes costs of their values, by policy and then by condition.
    pub(crate) fn of(seconds: Vec<f64>, n_conditions: usize) -> Self {
        Self { seconds, n_conditions }
    }

    /// Returns the cost of an episode.
    pub(crate) fn get(&self, policy_idx: usize, condition_idx: usize) -> f64 {
        self.seconds[policy_idx * self.n_conditions + condition_idx]
    }

    /// Returns the cost of all episodes of a group.
    pub(crate) fn of_group(&self, order: &EpisodeOrder, group: &PolicyGroup) -> f64 {
        let cost = |policy: &usize| {
            (0..order.n_conditions).map(|condition| self.get(*policy, condition)).sum::<f64>()
        };
        group.policies.iter().map(cost).sum::<f64>() * f64::from(order.n_episodes)
    }
}

/// Sums over the episodes of a policy in a task.
#[derive(Default)]
struct MeasuredCost {
    seconds: f64,
    steps: f64,
    n: f64,
}

fn measure(file: &ResultsFile) -> HashMap<(String, &'static str), MeasuredCost> {
    let mut sums: HashMap<_, MeasuredCost> = HashMap::new();
    for row in file.rows.iter().filter(|row| row.error.is_none()) {
        let sum = sums.entry((file.policy(row).to_owned(), row.condition.task.name())).or_default();
        // Waiting is no work.
        sum.seconds += row.times_s[..3].iter().map(|part| f64::from(*part)).sum::<f64>();
        sum.steps += f64::from(row.steps);
        sum.n += 1.0;
    }
    sums
}

/// Returns the expected core-seconds of a control step.
fn estimate(spec: &PolicySpec, execute: u32) -> f64 {
    match spec {
        PolicySpec::Idle => IDLE_STEP_S,
        PolicySpec::Random => RANDOM_STEP_S,
        PolicySpec::Expert => MOVING_STEP_S,
        PolicySpec::Network(..) | PolicySpec::Attach(_) | PolicySpec::Server(_) => {
            let weights = spec.checkpoint().map_or(0, |folder| n_bytes(folder, 2));
            MOVING_STEP_S + (IMAGES_S + PER_BYTE_S * weights as f64) / f64::from(execute.max(1))
        }
    }
}

/// Returns the bytes of the weights in a checkpoint, up to some folders deep.
fn n_bytes(folder: &Path, depth: u32) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let bytes = entries.map(|entry| match std::fs::metadata(entry.path()) {
        Ok(metadata) if metadata.is_dir() && depth > 0 => n_bytes(&entry.path(), depth - 1),
        Ok(metadata) if entry.path().extension().is_some_and(|it| it == "safetensors") => metadata.len(),
        _ => 0,
    });
    bytes.sum()
}
