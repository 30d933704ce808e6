//! The numbers of a report.

pub(crate) mod computation;
pub(crate) mod external;
pub(crate) mod hardware;
pub(crate) mod headlines;
pub(crate) mod published;
pub(crate) mod tables;
pub(crate) mod warnings;

use ipc_types::Morphology;
use serde::Serialize;
use serde_json::{Map, Value};
use sim::perturb::Modality;

use crate::statistics::Levels;
use crate::study::analysis::{
    CellSummary, Comparison, Effect, EmbodimentDifference, Metric, ModalityEffect, Rate,
};
use crate::study::page::content::external::ExternalData;

/// Everything that the page shows, and `data.json` contains.
#[derive(Debug, Serialize)]
pub(crate) struct ReportContent {
    pub(crate) title: String,
    pub(crate) metric: Metric,
    pub(crate) levels: Levels,
    /// The options that results depend on.
    pub(crate) options: Map<String, Value>,
    /// The machine and the circumstances of the first file's latest run.
    pub(crate) environment: Value,
    pub(crate) files: Vec<FileSummary>,
    pub(crate) policies: Vec<PolicySummary>,
    pub(crate) warnings: Vec<String>,
    pub(crate) cells: Vec<CellSummary>,
    /// Changes under perturbations as in the benchmark's figures, and their means.
    #[serde(serialize_with = "serialize_effects")]
    pub(crate) effects: Vec<Effect>,
    pub(crate) modality_effects: Vec<ModalityEffect>,
    pub(crate) embodiment_differences: Vec<EmbodimentDifference>,
    pub(crate) comparisons: Vec<Comparison>,
    /// Each policy under its perturbations, against its own unperturbed twins.
    pub(crate) perturbations: Vec<Comparison>,
    /// Means that the paper gives, too.
    pub(crate) published: Vec<PublishedRow>,
    /// Measurements from elsewhere, and how far the hardware's agree.
    pub(crate) external: ExternalData,
    pub(crate) hardware: Vec<HardwareFit>,
}

/// A results file of the report.
#[derive(Debug, Serialize)]
pub(crate) struct FileSummary {
    pub(crate) path: String,
    pub(crate) n_episodes: usize,
}

/// A policy of the report.
#[derive(Debug, Serialize)]
pub(crate) struct PolicySummary {
    pub(crate) name: String,
    pub(crate) spec: String,
    pub(crate) checkpoint: Option<String>,
    /// The use of its chunks, the device, and notes on its checkpoint.
    pub(crate) settings: Vec<String>,
    pub(crate) role: PolicyRole,
    /// `true` if its cells ended when a comparison was decided: they differ in size, so nothing is averaged.
    pub(crate) ended_early: bool,
    /// Over all unperturbed episodes; without trials if cells ended early.
    pub(crate) unperturbed: Rate,
    pub(crate) unperturbed_interval: Option<[f64; 2]>,
    /// Over all episodes; without trials if cells ended early.
    pub(crate) all: Rate,
    pub(crate) errors: u32,
}

/// Purpose of a policy in an evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PolicyRole {
    /// The idle policy.
    Floor,
    /// The scripted expert.
    Ceiling,
    /// A policy under test.
    Policy,
}

/// The points of one policy and their agreement.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct HardwareFit {
    /// Name of the policy.
    pub(crate) policy: String,
    /// Name of the task; `None` for all tasks.
    pub(crate) task: Option<&'static str>,
    /// Success in percent on hardware and in simulation, per condition that both have.
    pub(crate) points: Vec<[f64; 2]>,
    /// Least-squares line of simulation over hardware; `None` without two different values on hardware.
    pub(crate) line: Option<FittedLine>,
    /// Rank correlation; `None` if either side is constant.
    pub(crate) spearman: Option<f64>,
    /// Mean absolute difference in percentage points.
    pub(crate) mean_difference: Option<f64>,
    /// The same of the perturbed conditions, each side in percent of its own unperturbed success of the task.
    pub(crate) mean_normalised_difference: Option<f64>,
}

/// Slope, offset and coefficient of determination of a least-squares line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct FittedLine {
    pub(crate) slope: f64,
    pub(crate) offset: f64,
    /// `None` if the values in simulation are constant.
    pub(crate) r_squared: Option<f64>,
}

/// A mean of a report that the paper (arXiv 2605.27759) also gives.
#[derive(Debug, Serialize)]
pub(crate) struct PublishedRow {
    /// Name of the policy.
    pub(crate) policy: String,
    pub(crate) robot: &'static str,
    pub(crate) quantity: String,
    /// Success rate in percent, or change in points, of this report.
    pub(crate) ours: f64,
    /// Interval of a change under perturbations.
    pub(crate) interval: Option<[f64; 2]>,
    /// The same change relative to the unperturbed success rate, in percent.
    pub(crate) relative: Option<f64>,
    /// The paper's number.
    pub(crate) paper: f64,
    pub(crate) unit: PublishedUnit,
}

/// Unit of a number in the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(crate) enum PublishedUnit {
    /// Success in percent.
    #[serde(rename = "%")]
    Success,
    /// Percentage points.
    #[serde(rename = "points")]
    Points,
    /// Percent of the unperturbed success rate.
    #[serde(rename = "relative, %")]
    Relative,
    /// Percentage points or percent: the paper's text uses both and does not say which.
    #[serde(rename = "points or relative, %")]
    Unclear,
}

impl ReportContent {
    /// Returns the cells of a policy.
    pub(crate) fn cells_of<'a>(&'a self, policy: &'a str) -> impl Iterator<Item = &'a CellSummary> {
        self.cells.iter().filter(move |cell| cell.policy == policy)
    }

    /// Returns the policies under test.
    pub(crate) fn under_test(&self) -> impl Iterator<Item = &PolicySummary> {
        self.policies.iter().filter(|policy| policy.role == PolicyRole::Policy)
    }

    /// Returns the mean of a policy with one robot over the perturbations of a modality.
    pub(crate) fn modality_effect(
        &self,
        policy: &str,
        morphology: Morphology,
        modality: Modality,
    ) -> Option<&ModalityEffect> {
        self.modality_effects.iter().find(|effect| {
            effect.policy == policy && effect.morphology == morphology && effect.modality == modality
        })
    }

    /// Returns the position of a policy, which determines its colour.
    pub(crate) fn policy_idx(&self, name: &str) -> usize {
        self.policies.iter().position(|policy| policy.name == name).unwrap_or(0)
    }
}

fn serialize_effects<S: serde::Serializer>(effects: &[Effect], serializer: S) -> Result<S::Ok, S::Error> {
    let effect = |effect: &Effect| {
        serde_json::json!({
            "policy": effect.policy,
            "morphology": effect.morphology,
            "perturbation": effect.perturbation.name(),
            "success": effect.success,
            "n_tasks": effect.n_tasks,
            "change": effect.change,
            "relative_change": effect.relative_change,
            "relative_deviation": effect.relative_deviation,
        })
    };
    serializer.collect_seq(effects.iter().map(effect))
}
