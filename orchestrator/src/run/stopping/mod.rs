//! Early stopping: ends the cells of a run in which the comparison of two policies is decided.
//!
//! Decisions use tests that hold at every moment (`statistics::PairedSequence`), on the episodes of a cell in
//! index order, so that neither the order in which episodes finish nor the stopping itself biases them. Early
//! stopping only omits episodes; it never changes one.

mod rule;

use std::collections::{BTreeMap, HashMap};

pub(crate) use self::rule::StoppingRule;
use crate::plan::RunPlan;
use crate::plan::jobs::Job;
use crate::selection::condition::Condition;
use crate::statistics::{
    ConfidenceSequence, Decision, Judgement, Levels, PairedSequence, TestedDifference, Verdict, judge,
};
use crate::store::results::{Results, StoreError};

/// The state of a comparison during a run.
#[derive(Debug)]
pub(crate) struct Stopping {
    rule: StoppingRule,
    /// Indices of the two policies in the plan.
    policies: [usize; 2],
    cells: Vec<CellState>,
    positions: HashMap<Condition, usize>,
}

/// One cell: its pairs so far, and results that wait for their twin or for an earlier pair.
#[derive(Debug)]
struct CellState {
    condition: Condition,
    sequence: PairedSequence,
    /// Confidence sequences of both success rates.
    rates: [ConfidenceSequence; 2],
    /// By episode: the outcomes of A and B.
    waiting: BTreeMap<u32, [SideOutcome; 2]>,
    /// Index of the next pair.
    next: u32,
    decision: Option<Decision>,
}

/// One side of a pair.
#[derive(Clone, Copy, Debug, Default)]
enum SideOutcome {
    #[default]
    Unfinished,
    /// The episode could not be run.
    Failed,
    Finished {
        success: bool,
    },
}

/// The conclusion of one cell.
#[derive(Clone, Debug)]
pub(crate) struct SequentialCell {
    pub(crate) condition: Condition,
    pub(crate) sequence: PairedSequence,
    /// Confidence sequences of the success rates of A and B.
    pub(crate) rates: [[f64; 2]; 2],
    /// Level at which equal rates are rejected at any time, adjusted for all cells.
    pub(crate) adjusted_p: f64,
    pub(crate) verdict: Verdict,
}

impl Stopping {
    /// Starts with the episodes that the results file already has.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(crate) fn new(rule: &StoppingRule, plan: &RunPlan, results: &Results) -> Result<Self, StoreError> {
        let mut stopping = Self::of_conditions(rule, plan.conditions.iter().copied(), positions(rule, plan));
        for (side, name) in rule.policies.iter().enumerate() {
            for (condition, episode, success) in results.successes(name)? {
                // Episodes with an error are run again.
                if episode < plan.episodes && success.is_some() {
                    stopping.add(side, condition, episode, success);
                }
            }
        }
        stopping.decide();
        Ok(stopping)
    }

    /// Starts without episodes.
    pub(crate) fn of_conditions(
        rule: &StoppingRule,
        conditions: impl Iterator<Item = Condition>,
        policies: [usize; 2],
    ) -> Self {
        let alpha = rule.levels.alpha;
        let cell = |condition| CellState {
            condition,
            sequence: PairedSequence::new(rule.levels),
            rates: [ConfidenceSequence::new(alpha), ConfidenceSequence::new(alpha)],
            waiting: BTreeMap::new(),
            next: 0,
            decision: None,
        };
        let cells: Vec<CellState> = conditions.map(cell).collect();
        let positions = cells.iter().enumerate().map(|(idx, cell)| (cell.condition, idx)).collect();
        Self { rule: rule.clone(), policies, cells, positions }
    }

    /// Returns `true` unless the job belongs to the comparison and its cell is decided.
    pub(crate) fn is_wanted(&self, job: &Job) -> bool {
        !self.policies.contains(&job.policy_idx)
            || self.positions.get(&job.condition).is_none_or(|&idx| self.cells[idx].decision.is_none())
    }

    /// Records a finished episode; `success` is `None` if it could not be run.
    pub(crate) fn on_finished(&mut self, job: &Job, success: Option<bool>) {
        let Some(side) = self.policies.iter().position(|idx| *idx == job.policy_idx) else { return };
        self.add(side, job.condition, job.episode, success);
        self.decide();
    }

    /// Adds an outcome without deciding. Episodes of other conditions are ignored.
    pub(crate) fn add(&mut self, side: usize, condition: Condition, episode: u32, success: Option<bool>) {
        if let Some(&idx) = self.positions.get(&condition) {
            self.cells[idx].add(side, episode, success);
        }
    }

    /// Returns the number of cells that are decided, and of all cells.
    pub(crate) fn n_decided(&self) -> (usize, usize) {
        (self.cells.iter().filter(|cell| cell.decision.is_some()).count(), self.cells.len())
    }

    /// Returns the conclusions, by cell.
    pub(crate) fn conclusions(&self) -> Vec<SequentialCell> {
        let (levels, n_cells) = (self.rule.levels, self.cells.len());
        let conclude = |(cell, judged): (&CellState, Judgement)| SequentialCell {
            condition: cell.condition,
            rates: [cell.rates[0].interval(), cell.rates[1].interval()],
            adjusted_p: judged.adjusted_p,
            verdict: cell.decision.map_or_else(
                || Verdict { decision: Decision::Undecided, more_episodes: cell.forecast(n_cells, levels) },
                |decision| Verdict { decision, more_episodes: None },
            ),
            sequence: cell.sequence.clone(),
        };
        self.cells.iter().zip(self.judged()).map(conclude).collect()
    }

    /// Decides every cell that can be. A decision is final.
    pub(crate) fn decide(&mut self) {
        let judged = self.judged();
        for (cell, judged) in self.cells.iter_mut().zip(judged) {
            if cell.decision.is_none() && judged.decision != Decision::Undecided {
                cell.decision = Some(judged.decision);
            }
        }
    }

    /// Judges all cells together. Holm's method applies because the levels at which a test martingale and a
    /// confidence sequence reject are p-values that hold at every moment.
    fn judged(&self) -> Vec<Judgement> {
        let tested: Vec<TestedDifference> = self.cells.iter().map(|cell| cell.sequence.tested()).collect();
        judge(&tested, self.rule.levels.alpha)
    }
}

impl CellState {
    fn add(&mut self, side: usize, episode: u32, success: Option<bool>) {
        let outcome = success.map_or(SideOutcome::Failed, |success| SideOutcome::Finished { success });
        self.waiting.entry(episode).or_default()[side] = outcome;
        while let Some([a, b]) = self.waiting.get(&self.next) {
            match (*a, *b) {
                (SideOutcome::Unfinished, _) | (_, SideOutcome::Unfinished) => return,
                (SideOutcome::Finished { success: a }, SideOutcome::Finished { success: b }) => {
                    self.sequence.push(a, b);
                    for (rate, success) in self.rates.iter_mut().zip([a, b]) {
                        rate.push(f64::from(success));
                    }
                }
                // A pair with an error on either side is left out.
                (SideOutcome::Failed, _) | (_, SideOutcome::Failed) => {}
            }
            self.waiting.remove(&self.next);
            self.next += 1;
        }
    }

    /// Estimates the number of further pairs until a decision, with the strictest correction for many cells.
    fn forecast(&self, n_cells: usize, levels: Levels) -> Option<u64> {
        let strictest = levels.alpha / n_cells as f64;
        self.sequence.forecast(|future| future.p.min(future.equivalence_p) <= strictest)
    }
}

/// Finds the policies of the rule in a plan. [`RunPlan::new`] has checked that they are there.
fn positions(rule: &StoppingRule, plan: &RunPlan) -> [usize; 2] {
    let position = |name: &String| plan.policies.iter().position(|policy| policy.name == *name);
    [&rule.policies[0], &rule.policies[1]].map(|name| position(name).expect("the plan has checked the names"))
}

#[cfg(test)]
mod tests {
    use sim::perturb::Composition;
    use sim::serve::protocol::Driver;
    use sim::{Perturbation, TaskId};

    use super::*;

    const CONDITION: Condition =
        Condition { task: TaskId::RaiseCube, perturbation: Composition::single(Perturbation::None) };

    fn stopping() -> Stopping {
        let rule = StoppingRule {
            policies: ["a".to_owned(), "b".to_owned()],
            levels: Levels { alpha: 0.05, margin: 0.1 },
        };
        Stopping::of_conditions(&rule, std::iter::once(CONDITION), [0, 1])
    }

    fn job(policy_idx: usize, episode: u32) -> Job {
        Job { policy_idx, condition: CONDITION, episode, seed: 0, driver: Driver::Expert }
    }

    #[test]
    fn clear_difference_ends_the_cell() {
        let mut stopping = stopping();
        for episode in 0..20 {
            stopping.on_finished(&job(0, episode), Some(true));
            stopping.on_finished(&job(1, episode), Some(false));
        }
        assert_eq!(stopping.n_decided(), (1, 1));
        assert!(!stopping.is_wanted(&job(0, 20)) && !stopping.is_wanted(&job(1, 20)));
        assert!(stopping.is_wanted(&job(2, 20)), "another policy goes on");
        assert_eq!(stopping.conclusions()[0].verdict.decision, Decision::ABetter);
    }

    #[test]
    fn conclusion_does_not_depend_on_finishing_order() {
        let outcome = |side: usize, episode: u32| (episode * 7 + side as u32 * 3) % 5 < 2 + side as u32;
        let mut orders = vec![(0..60).flat_map(|e| [(0, e), (1, e)]).collect::<Vec<_>>()];
        orders.push(orders[0].iter().rev().copied().collect());
        let conclude = |order: &Vec<(usize, u32)>| {
            let mut stopping = stopping();
            order.iter().for_each(|&(side, e)| stopping.add(side, CONDITION, e, Some(outcome(side, e))));
            stopping.decide();
            let cell = stopping.conclusions().remove(0);
            (*cell.sequence.pairs(), cell.sequence.interval(), cell.adjusted_p)
        };
        assert_eq!(conclude(&orders[0]), conclude(&orders[1]));
    }

    #[test]
    fn errored_pair_is_left_out() {
        let mut stopping = stopping();
        for episode in 0..3 {
            stopping.on_finished(&job(0, episode), (episode != 1).then_some(true));
            stopping.on_finished(&job(1, episode), Some(true));
        }
        assert_eq!(stopping.conclusions()[0].sequence.pairs().n(), 2);
    }
}
