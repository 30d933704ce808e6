//! The computation of a report's numbers from an evaluation.

use run_config::QueryMode;
use serde_json::Value;
use sim::Perturbation;

use crate::selection::policy::Identity;
use crate::statistics::Levels;
use crate::store::results::{ENVIRONMENT, PLANS, SHARD};
use crate::study::analysis::{
    CellRate, CellSummary, Comparison, ComparisonOptions, Effect, EvaluatedPolicy, Evaluation, Metric, Rate,
    effects, embodiment_differences, modality_effects,
};
use crate::study::page::content::external::ExternalData;
use crate::study::page::content::hardware;
use crate::study::page::content::published::published_rows;
use crate::study::page::content::warnings::warnings;
use crate::study::page::content::{FileSummary, PolicyRole, PolicySummary, ReportContent};

/// Choices of the user.
#[derive(Clone, Debug)]
pub(crate) struct PageOptions {
    pub(crate) title: String,
    pub(crate) metric: Metric,
    pub(crate) levels: Levels,
    /// Pairs of policies to compare; empty for all pairs of at most [`MAX_COMPARED`] policies.
    pub(crate) pairs: Vec<[String; 2]>,
}

impl PageOptions {
    fn comparison(&self) -> ComparisonOptions {
        ComparisonOptions { metric: self.metric, levels: self.levels, max_flips: MAX_FLIPS }
    }
}

/// Number of flips per comparison that the page and the data have.
const MAX_FLIPS: usize = 200;

/// Number of policies up to which all pairs are compared without being asked for.
const MAX_COMPARED: usize = 4;

impl ReportContent {
    /// Computes the report.
    ///
    /// # Errors
    /// If two policies of a requested pair cannot be compared.
    pub(crate) fn new(
        evaluation: &Evaluation,
        options: &PageOptions,
        external: ExternalData,
    ) -> anyhow::Result<Self> {
        let (metric, levels) = (options.metric, options.levels);
        let of_policy = |policy| CellSummary::of_policy(evaluation, policy, metric, levels.alpha);
        let cells: Vec<CellSummary> = evaluation.policies.iter().flat_map(of_policy).collect();
        let ended_early =
            |cell: &&CellSummary| evaluation.policy(&cell.policy).is_ok_and(|policy| policy.ended_early);
        let effects = effects_of(cells.iter().filter(|cell| !ended_early(cell)));
        let policies = summaries(evaluation, &cells, levels);
        let comparisons = comparisons(evaluation, &policies, options)?;
        let perturbations = policies
            .iter()
            .filter(|policy| policy.role == PolicyRole::Policy)
            .filter_map(|policy| {
                let options = options.comparison();
                // A policy without both kinds of cells has nothing to show.
                Comparison::of_perturbations(evaluation, &policy.name, Perturbation::None.into(), options)
                    .ok()
            })
            .collect();
        let manifest = &evaluation.files[0].manifest;
        let mut report = Self {
            title: options.title.clone(),
            metric,
            levels,
            options: manifest
                .iter()
                .filter(|(key, _)| ![ENVIRONMENT, PLANS, SHARD].contains(&key.as_str()))
                .map(owned)
                .collect(),
            environment: manifest.get(ENVIRONMENT).cloned().unwrap_or(Value::Null),
            files: evaluation
                .files
                .iter()
                .map(|file| FileSummary {
                    path: file.path.display().to_string(),
                    n_episodes: file.rows.len(),
                })
                .collect(),
            warnings: Vec::new(),
            policies,
            cells,
            modality_effects: modality_effects(&effects),
            embodiment_differences: embodiment_differences(&effects),
            effects,
            comparisons,
            perturbations,
            published: Vec::new(),
            external,
            hardware: Vec::new(),
        };
        report.published = published_rows(&report);
        report.hardware =
            report.external.hardware.as_ref().map_or_else(Vec::new, |table| hardware::fits(&report, table));
        report.warnings = warnings(&report, evaluation);
        Ok(report)
    }
}

fn owned((key, value): (&String, &Value)) -> (String, Value) {
    (key.clone(), value.clone())
}

fn effects_of<'a>(cells: impl Iterator<Item = &'a CellSummary>) -> Vec<Effect> {
    fn rate(cell: &CellSummary) -> CellRate<'_> {
        CellRate { policy: &cell.policy, condition: cell.condition, success: cell.rate.fraction() }
    }
    effects(&cells.map(rate).collect::<Vec<_>>())
}

fn summaries(evaluation: &Evaluation, cells: &[CellSummary], levels: Levels) -> Vec<PolicySummary> {
    let sum = |cells: &[&CellSummary]| {
        let total = cells.iter().fold([0, 0], |[s, n], cell| [s + cell.rate.successes, n + cell.rate.n]);
        Rate { successes: total[0], n: total[1] }
    };
    let summary = |policy: &EvaluatedPolicy| {
        let own: Vec<&CellSummary> = cells.iter().filter(|cell| cell.policy == policy.name).collect();
        let is_unperturbed = |cell: &&CellSummary| cell.condition.perturbation == Perturbation::None.into();
        let averaged = if policy.ended_early { &[][..] } else { &own[..] };
        let unperturbed = sum(&averaged.iter().copied().filter(is_unperturbed).collect::<Vec<_>>());
        PolicySummary {
            name: policy.name.clone(),
            spec: policy.identity.spec.clone(),
            checkpoint: policy.identity.checkpoint.clone(),
            settings: settings(&policy.identity),
            role: match policy.identity.spec.as_str() {
                "idle" => PolicyRole::Floor,
                "expert" => PolicyRole::Ceiling,
                _ => PolicyRole::Policy,
            },
            ended_early: policy.ended_early,
            unperturbed_interval: unperturbed.interval(levels.z()),
            unperturbed,
            all: sum(averaged),
            errors: own.iter().map(|cell| cell.errors).sum(),
        }
    };
    let mut summaries: Vec<PolicySummary> = evaluation.policies.iter().map(summary).collect();
    // Policies under test first, then the ceiling and the floor.
    summaries.sort_by_key(|policy| (policy.role != PolicyRole::Policy, policy.role == PolicyRole::Floor));
    summaries
}

/// Describes how a policy was run.
fn settings(identity: &Identity) -> Vec<String> {
    let execution = identity.execution.map(|execution| match execution.mode {
        QueryMode::Ensemble => "temporal ensembling".to_owned(),
        QueryMode::Chunk => format!("{} rows per query", execution.execute),
    });
    execution.into_iter().chain(identity.device.clone()).chain(identity.notes.iter().cloned()).collect()
}

fn comparisons(
    evaluation: &Evaluation,
    policies: &[PolicySummary],
    options: &PageOptions,
) -> anyhow::Result<Vec<Comparison>> {
    let compare = |[a, b]: [&str; 2]| Comparison::of_policies(evaluation, [a, b], options.comparison());
    if !options.pairs.is_empty() {
        let pairs = options.pairs.iter();
        return Ok(pairs.map(|[a, b]| compare([a, b])).collect::<Result<_, _>>()?);
    }
    let names: Vec<&str> = policies
        .iter()
        .filter(|policy| policy.role == PolicyRole::Policy)
        .map(|policy| policy.name.as_str())
        .take(MAX_COMPARED)
        .collect();
    let pairs = names.iter().enumerate().flat_map(|(idx, a)| names[idx + 1..].iter().map(move |b| [*a, *b]));
    // Policies that share no episode are not compared unless they were named.
    Ok(pairs.filter_map(|pair| compare(pair).ok()).collect())
}
