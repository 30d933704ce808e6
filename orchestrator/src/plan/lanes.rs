//! The lanes of a run: one for each policy outside the sim.

use ipc_types::layout::block_pages;
use ipc_types::link::LaneSpec;
use policy_host::PolicySpec;
use run_config::Execution;
use sim::serve::protocol::{Driver, Lane};

use crate::plan::RunPlan;
use crate::plan::jobs::drivers;
use crate::selection::policy::NamedPolicy;

/// Observation batches that may be unanswered on a lane, so that stepping and inference overlap.
const IN_FLIGHT: u32 = 2;

/// A policy outside the sim and its lane.
#[derive(Clone, Debug)]
pub(crate) struct PolicyLane {
    pub(crate) spec: PolicySpec,
    pub(crate) execution: Execution,
    /// Hash of its checkpoint at the start of the run.
    pub(crate) checkpoint: Option<String>,
    pub(crate) lane: Lane,
}

/// Returns the policies that run outside the sim, with up to `batch` envs in a message. Their checkpoints are
/// not read.
pub(crate) fn lanes(plan: &RunPlan, batch: u32) -> Vec<PolicyLane> {
    let policy = |((policy, driver), &execution): ((&NamedPolicy, Driver), &Execution)| {
        let Driver::Lane(lane) = driver else { return None };
        let images = policy.spec.needs_images().then_some(plan.config.results.protocol.image_size);
        let max_pages =
            plan.morphologies().into_iter().map(|morphology| block_pages(morphology, images)).max();
        let spec = LaneSpec {
            lane,
            policy: policy.name.clone(),
            max_envs: batch,
            block_pages: max_pages.unwrap_or(1) as u32,
            in_flight: IN_FLIGHT,
        };
        let foreign = matches!(policy.spec, PolicySpec::Attach(_));
        let answer_timeout_s = policy.spec.answer_timeout_s().unwrap_or(Lane::ANSWER_TIMEOUT_S);
        let lane = Lane { spec, images, foreign, answer_timeout_s, execute: execution.execute };
        Some(PolicyLane { spec: policy.spec.clone(), execution, checkpoint: None, lane })
    };
    plan.policies.iter().zip(drivers(plan)).zip(&plan.executions).filter_map(policy).collect()
}
