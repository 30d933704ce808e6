//! Success rates of cells: one policy under one condition.

use serde::Serialize;

use crate::selection::condition::Condition;
use crate::statistics::{ConfidenceSequence, quantile, wilson_interval};
use crate::study::analysis::evaluation::{EvaluatedPolicy, Evaluation, RowIdx};
use crate::study::analysis::matching::Metric;

/// Successes among trials.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub(crate) struct Rate {
    pub(crate) successes: u32,
    pub(crate) n: u32,
}

/// The results of one policy under one condition.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct CellSummary {
    pub(crate) policy: String,
    #[serde(flatten)]
    pub(crate) condition: Condition,
    /// Successes by the metric of the analysis.
    #[serde(flatten)]
    pub(crate) rate: Rate,
    /// Interval of the rate: Wilson's, or the confidence sequence where cells ended when they were decided.
    pub(crate) interval: Option<[f64; 2]>,
    /// Successes after any step and after the last step.
    pub(crate) success_once: u32,
    pub(crate) success_at_end: u32,
    /// Control steps of all episodes.
    pub(crate) steps: u64,
    /// Episodes that could not be run; not in `n`.
    pub(crate) errors: u32,
    /// Control steps until the first success, of the episodes that succeed, ascending.
    pub(crate) first_success_steps: Vec<u32>,
    /// Failed episodes by the first predicate that did not hold at the end.
    pub(crate) failed_predicates: std::collections::BTreeMap<String, u32>,
    /// Seconds of physics, rendering, policy and waiting over all episodes.
    pub(crate) times_s: [f64; 4],
}

impl Rate {
    /// Returns the fraction of successes; `None` without trials.
    pub(crate) fn fraction(self) -> Option<f64> {
        (self.n > 0).then(|| f64::from(self.successes) / f64::from(self.n))
    }

    /// Returns Wilson's interval for the normal quantile `z`; `None` without trials.
    pub(crate) fn interval(self, z: f64) -> Option<[f64; 2]> {
        wilson_interval(self.successes, self.n, z)
    }
}

impl CellSummary {
    /// Returns the cells of a policy in the order of the suite, with intervals at `1 − alpha`.
    pub(crate) fn of_policy(
        evaluation: &Evaluation,
        policy: &EvaluatedPolicy,
        metric: Metric,
        alpha: f64,
    ) -> Vec<Self> {
        let z = quantile(1.0 - 0.5 * alpha);
        let cell = |(condition, rows): (Condition, &[RowIdx])| {
            let mut cell = Self {
                policy: policy.name.clone(),
                condition,
                rate: Rate::default(),
                interval: None,
                success_once: 0,
                success_at_end: 0,
                steps: 0,
                errors: 0,
                first_success_steps: Vec::new(),
                failed_predicates: std::collections::BTreeMap::new(),
                times_s: [0.0; 4],
            };
            for &idx in rows {
                cell.add(evaluation, idx, metric);
            }
            cell.first_success_steps.sort_unstable();
            cell.interval = if policy.ended_early {
                Some(confidence_sequence(evaluation, rows, metric, alpha))
            } else {
                cell.rate.interval(z)
            };
            cell
        };
        evaluation.conditions(policy).into_iter().map(cell).collect()
    }

    fn add(&mut self, evaluation: &Evaluation, idx: RowIdx, metric: Metric) {
        let row = evaluation.row(idx);
        if row.error.is_some() {
            self.errors += 1;
            return;
        }
        let success = metric.of(row);
        self.rate.n += 1;
        self.rate.successes += u32::from(success);
        self.success_once += u32::from(row.success_once);
        self.success_at_end += u32::from(row.success_at_end);
        self.steps += u64::from(row.steps);
        self.first_success_steps.extend(row.first_success_step);
        if !success {
            let file = &evaluation.files[idx.file_idx as usize];
            let name = row.failed_predicate.map_or("none at the end", |text| file.text(text));
            *self.failed_predicates.entry(name.to_owned()).or_default() += 1;
        }
        for (sum, seconds) in self.times_s.iter_mut().zip(row.times_s) {
            *sum += f64::from(seconds);
        }
    }
}

/// Returns the confidence sequence of a success rate over the episodes up to the first missing one. Early
/// stopping leaves later ones by chance of timing.
fn confidence_sequence(evaluation: &Evaluation, rows: &[RowIdx], metric: Metric, alpha: f64) -> [f64; 2] {
    let mut sequence = ConfidenceSequence::new(alpha);
    let rows = rows.iter().map(|idx| evaluation.row(*idx)).zip(0..);
    for (row, _) in rows.take_while(|(row, idx)| row.episode == *idx).filter(|(row, _)| row.error.is_none()) {
        sequence.push(f64::from(metric.of(row)));
    }
    sequence.interval()
}
