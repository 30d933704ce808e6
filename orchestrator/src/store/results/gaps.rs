//! Episodes that were planned and are not in a results file.

use std::collections::HashMap;
use std::rc::Rc;

use anyhow::{Context, ensure};
use serde::Serialize;

use crate::plan::partition::{Partition, ShardPart, StoredShard, SweepShard};
use crate::selection::condition::{Condition, parse_condition};
use crate::store::results::file::ResultsFile;
use crate::store::results::manifest::{PLANS, SHARD, StoredPlan};

/// Most episodes of a cell, as of `run`.
const MAX_EPISODES: u32 = 1_000_000;

/// Planned episodes of one cell that are missing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Gap {
    pub(crate) policy: String,
    pub(crate) condition: Condition,
    /// Number of missing episodes.
    pub(crate) n: u32,
    /// Index of the first one.
    pub(crate) first: u32,
}

/// Returns the gaps of a file; `None` if it was written before plans were stored.
///
/// Of a policy whose cells may end early, only episodes before the last one of a cell count.
///
/// # Errors
/// If the stored plans are invalid.
pub(crate) fn gaps(file: &ResultsFile) -> anyhow::Result<Option<Vec<Gap>>> {
    let Some(plans) = file.manifest.get(PLANS) else { return Ok(None) };
    let invalid = || format!("{}: its manifest has no valid {PLANS}", file.path.display());
    let plans: Vec<StoredPlan> = serde_json::from_value(plans.clone()).with_context(invalid)?;
    let mut found: HashMap<(&str, Condition), Vec<u32>> = HashMap::new();
    for row in &file.rows {
        found.entry((file.policy(row), row.condition)).or_default().push(row.episode);
    }
    let cells = planned_cells(&plans).with_context(invalid)?;
    let shard = shard(file, plans.first())
        .with_context(|| format!("{}: its manifest has no valid {SHARD}", file.path.display()))?;
    let gap = |(policy, condition, planned): (&str, Condition, u32)| {
        let found = found.get(&(policy, condition)).map_or(&[][..], Vec::as_slice);
        let expected = if file.may_end_early(policy) {
            found.last().map_or(0, |last| last.saturating_add(1))
        } else {
            planned
        };
        // Rows are sorted by episode.
        let (n, first) = match &shard {
            None => {
                let n_found = found.iter().filter(|episode| **episode < expected).count() as u32;
                (expected - n_found, (0..expected).find(|idx| found.get(*idx as usize) != Some(idx))?)
            }
            Some(shard) => {
                let is_missing = |episode: &u32| found.binary_search(episode).is_err();
                let mut missing = shard.episodes(policy, condition, expected).filter(is_missing);
                let first = missing.next()?;
                (1 + missing.count() as u32, first)
            }
        };
        (n > 0).then(|| Gap { policy: policy.to_owned(), condition, n, first })
    };
    Ok(Some(cells.into_iter().filter_map(gap).collect()))
}

/// Returns the cells of plans in the order of the first one, each with its policy, its condition and the
/// largest number of episodes that a plan wants.
///
/// # Errors
/// If a condition is unknown.
pub(crate) fn planned_cells(plans: &[StoredPlan]) -> anyhow::Result<Vec<(&str, Condition, u32)>> {
    let mut cells: Vec<(&str, Condition, u32)> = Vec::new();
    let mut positions: HashMap<(&str, Condition), usize> = HashMap::new();
    for plan in plans {
        for (task, perturbation) in &plan.conditions {
            let condition = parse_condition(task, perturbation)?;
            for policy in &plan.policies {
                let idx = *positions.entry((policy, condition)).or_insert_with(|| {
                    cells.push((policy, condition, 0));
                    cells.len() - 1
                });
                cells[idx].2 = plan.episodes.max(cells[idx].2);
            }
        }
    }
    Ok(cells)
}

/// Formats the episodes that were planned and are not in the file.
pub(crate) fn gap_lines(gaps: Option<&[Gap]>) -> String {
    let Some(gaps) = gaps else {
        return "the file does not say which episodes were planned, so missing ones cannot be detected\n"
            .to_owned();
    };
    let line = |Gap { policy, condition, n, first }: &Gap| {
        let (task, perturbation) = (condition.task.name(), condition.perturbation.name());
        format!("missing: {n} planned episodes of {policy}, {task} {perturbation}, from index {first} on\n")
    };
    gaps.iter().map(line).collect()
}

/// The episodes of the shard that a file has.
struct ShardPlan<'a> {
    part: ShardPart,
    plan: &'a StoredPlan,
    conditions: Vec<Condition>,
}

impl ShardPlan<'_> {
    /// Returns those of a cell that are below `end`.
    fn episodes(&self, policy: &str, condition: Condition, end: u32) -> impl Iterator<Item = u32> {
        let policy = self.plan.policies.iter().position(|name| name == policy);
        let condition = self.conditions.iter().position(|own| *own == condition);
        let cell = policy.zip(condition);
        let is_own = move |episode: &u32| {
            cell.is_some_and(|(policy, condition)| self.part.contains((policy, condition, *episode)))
        };
        (0..end.min(self.plan.episodes)).filter(is_own)
    }
}

/// Returns the shard of a file; `None` if it is not one of a sweep.
fn shard<'a>(file: &ResultsFile, plan: Option<&'a StoredPlan>) -> anyhow::Result<Option<ShardPlan<'a>>> {
    let (Some(entry), Some(plan)) = (file.manifest.get(SHARD), plan) else { return Ok(None) };
    let StoredShard { shard, cuts, .. } = serde_json::from_value(entry.clone())?;
    let shard = SweepShard::new(u64::from(shard), cuts.first.len() as u64)?;
    let pair = file.stopping.as_ref().map(|rule| &rule.policies);
    let conditions = plan.conditions.iter().map(|(task, perturbation)| parse_condition(task, perturbation));
    let conditions = conditions.collect::<Result<_, _>>()?;
    ensure!(plan.episodes <= MAX_EPISODES, "{} episodes, expected up to {MAX_EPISODES}", plan.episodes);
    let partition = Partition::restore(plan, pair, cuts).context("the shards are not those of the plan")?;
    let part = ShardPart::new(Rc::new(partition), shard);
    Ok(Some(ShardPlan { part, plan, conditions }))
}
