//! Episodes that were planned and are not in a results file.

use std::collections::HashMap;

use anyhow::Context;

use crate::selection::condition::{Condition, parse_condition};
use crate::store::results::file::ResultsFile;
use crate::store::results::manifest::{PLANS, StoredPlan};

/// Planned episodes of one cell that are missing.
#[derive(Clone, Debug, PartialEq, Eq)]
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
    // In the order of the first plan.
    let mut cells: Vec<(&str, Condition)> = Vec::new();
    let mut planned: HashMap<(&str, Condition), u32> = HashMap::new();
    for plan in &plans {
        for (task, perturbation) in &plan.conditions {
            let condition = parse_condition(task, perturbation).with_context(invalid)?;
            for policy in &plan.policies {
                let episodes = planned.entry((policy, condition)).or_insert_with(|| {
                    cells.push((policy, condition));
                    0
                });
                *episodes = plan.episodes.max(*episodes);
            }
        }
    }
    let gap = |(policy, condition): (&str, Condition)| {
        let found = found.get(&(policy, condition)).map_or(&[][..], Vec::as_slice);
        let expected = if file.may_end_early(policy) {
            found.last().map_or(0, |last| last + 1)
        } else {
            planned[&(policy, condition)]
        };
        let n = expected - found.iter().filter(|episode| **episode < expected).count() as u32;
        // Rows are sorted by episode, so the first index that is not at its place is missing.
        let first = (0..expected).find(|idx| found.get(*idx as usize) != Some(idx))?;
        (n > 0).then(|| Gap { policy: policy.to_owned(), condition, n, first })
    };
    Ok(Some(cells.into_iter().filter_map(gap).collect()))
}
