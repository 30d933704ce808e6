//! The definition of a task: data and three short functions. A task never steps a world; `tasks/` holds those
//! of the suite.

pub mod predicate;
pub mod profile;

use ipc_types::Morphology;

use crate::expert::Move;
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use scene::{Scene, SceneSpec};

/// The benchmark's task categories (docs/benchmark.md, "Tasks").
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names are the benchmark's")]
pub enum Category {
    Pick,
    PickAndPlace,
    Reorientation,
    Insertion,
    ToolUse,
    Articulated,
    LongHorizon,
    Handover,
    Lift,
}

impl Category {
    /// Returns the name used by the benchmark.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pick => "Pick",
            Self::PickAndPlace => "Pick & Place",
            Self::Reorientation => "Reorientation",
            Self::Insertion => "Insertion",
            Self::ToolUse => "Tool Use",
            Self::Articulated => "Articulated",
            Self::LongHorizon => "Long-Horizon",
            Self::Handover => "Handover",
            Self::Lift => "Lift",
        }
    }
}

/// A task of the suite.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    /// Identifier of the task in the benchmark's released code.
    pub env_id: &'static str,
    /// Category of the task in the benchmark.
    pub category: Category,
    /// Morphology of the robot that performs the task.
    pub morphology: Morphology,
    /// Length of an episode, in control steps.
    pub max_steps: u32,
    /// Mean length of the benchmark's demonstrations, in control steps.
    pub demo_steps: f64,
    /// The instruction that policies are trained with.
    pub instruction: &'static str,
    /// The instruction in the benchmark's evaluation through LeRobot (docs/protocols.md).
    pub lerobot_instruction: &'static str,
    /// Paraphrases of the instruction, one per line.
    pub paraphrases: &'static str,
    /// Returns the unperturbed scene distribution.
    pub nominal: fn(Profile) -> SceneSpec,
    /// Returns the success predicates for a sampled scene; success requires all of them after the same
    /// control step.
    pub success: fn(&Scene, Profile) -> Vec<Predicate>,
    /// Returns the scripted expert's plan for a sampled scene, using privileged state.
    pub expert: fn(&Scene) -> Vec<Move>,
}
