//! Counts of the merged rows by cell, from which follows which episodes are missing.

use std::collections::HashMap;
use std::rc::Rc;

use crate::store::merging::manifest::MergedManifest;
use crate::store::merging::source::CellNames;
use crate::store::results::{Gap, planned_cells};

/// Counts of the cells.
#[derive(Debug, Default)]
pub(crate) struct CellTally {
    cells: HashMap<Rc<CellNames>, FinishedInCell>,
}

/// The finished episodes of one cell.
#[derive(Debug, Default)]
struct FinishedInCell {
    /// Indices of them, as ranges in ascending order.
    ranges: Vec<[u64; 2]>,
}

impl CellTally {
    /// Adds a row. The rows of a cell come in the order of their episodes.
    pub(crate) fn add(&mut self, names: &Rc<CellNames>, episode: u32, is_finished: bool) {
        if !self.cells.contains_key(names) {
            self.cells.insert(Rc::clone(names), FinishedInCell::default());
        }
        let episode = u64::from(episode);
        let Some(cell) = self.cells.get_mut(names).filter(|_| is_finished) else { return };
        match cell.ranges.last_mut() {
            Some([_, end]) if *end == episode => *end += 1,
            _ => cell.ranges.push([episode, episode + 1]),
        }
    }

    /// Returns the planned episodes that are missing; `None` if no plan is known. Of a policy whose cells may
    /// end early, only episodes before the last one of a cell count.
    ///
    /// # Errors
    /// If a plan names an unknown condition.
    pub(crate) fn gaps(&self, manifest: &MergedManifest) -> anyhow::Result<Option<Vec<Gap>>> {
        if manifest.plans.is_empty() {
            return Ok(None);
        }
        let mut gaps = Vec::new();
        for (policy, condition, planned) in planned_cells(&manifest.plans)? {
            let names = [policy.to_owned(), condition.task.name().to_owned(), condition.perturbation.name()];
            let ranges = self.cells.get(&names).map_or(&[][..], |cell| cell.ranges.as_slice());
            let ends_early = manifest
                .stopping
                .as_ref()
                .is_some_and(|rule| rule.policies.iter().any(|name| name == policy));
            let last = ranges.last().map_or(0, |[_, end]| *end);
            let expected = if ends_early { last } else { u64::from(planned) };
            let n_found: u64 =
                ranges.iter().map(|[first, end]| end.min(&expected).saturating_sub(*first)).sum();
            if n_found < expected {
                let first = ranges.first().map_or(0, |[first, end]| if *first == 0 { *end } else { 0 });
                // Both are below the number of episodes that a plan can have.
                let [n, first] = [expected - n_found, first].map(|number| number as u32);
                gaps.push(Gap { policy: policy.to_owned(), condition, n, first });
            }
        }
        Ok(Some(gaps))
    }
}
