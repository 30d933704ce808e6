//! A task: what the words of `tasks/` mean. A task is data and three short functions; it never steps a world.

use ipc_types::Morphology;

use crate::expert::Move;
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::scene::{Scene, SceneSpec};

/// The benchmark's categories (spec/tasks.md §1).
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
    /// Name as the benchmark prints it.
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

/// One task of the suite.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    /// Id in the released code, for readers of its results.
    pub env_id: &'static str,
    /// Category.
    pub category: Category,
    /// Morphology.
    pub morphology: Morphology,
    /// Control steps after which an episode ends.
    pub max_steps: u32,
    /// Mean length of the benchmark's demonstrations, in control steps.
    pub demo_steps: f64,
    /// The sentence policies are trained with.
    pub instruction: &'static str,
    /// The same said in other words, a sentence on each line.
    pub paraphrases: &'static str,
    /// The distribution without perturbation.
    pub nominal: fn() -> SceneSpec,
    /// Predicates that must all hold after the same control step.
    pub success: fn(&Scene, Profile) -> Vec<Predicate>,
    /// The scripted expert's plan: privileged, a function of the drawn scene.
    pub expert: fn(&Scene) -> Vec<Move>,
}
