//! The episodes of a plan, in the order in which they run.

use sim::serve::protocol::{Assignment, Driver};
use sim::stream::episode_seed;

use crate::plan::{Condition, RunPlan};

/// One episode of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Job {
    /// Index into [`RunPlan::policies`].
    pub(crate) policy_idx: usize,
    pub(crate) condition: Condition,
    /// Index of the episode under the suite seed.
    pub(crate) episode: u32,
    /// Episode seed, the same for all policies and perturbations.
    pub(crate) seed: u64,
    /// The lane or expert that acts.
    pub(crate) driver: Driver,
}

impl Job {
    /// Returns the message that starts this episode in a sim. The outcome has the same `id`.
    pub(crate) fn assignment(&self, id: u64) -> Assignment {
        let Condition { task, perturbation } = self.condition;
        Assignment { id, driver: self.driver, task, perturbation, seed: self.seed }
    }
}

/// Returns the driver of each policy. Lanes are numbered in the order of the policies that have one.
pub(crate) fn drivers(plan: &RunPlan) -> Vec<Driver> {
    let mut lanes = 0..;
    let mut driver =
        |in_sim: bool| if in_sim { Some(Driver::Expert) } else { lanes.next().map(Driver::Lane) };
    plan.policies.iter().filter_map(|policy| driver(policy.runs_in_sim())).collect()
}

/// Returns all episodes. Policies vary fastest and conditions next, so that all lanes have work at all times
/// and an interrupted run has some episodes of each condition.
pub(crate) fn jobs(plan: &RunPlan) -> impl Iterator<Item = Job> {
    let drivers = drivers(plan);
    let conditions = plan.conditions.iter();
    (0..plan.episodes).flat_map(move |episode| {
        let drivers = drivers.clone();
        conditions.clone().flat_map(move |&condition| {
            let seed = episode_seed(plan.config.results.seed, condition.task.name(), episode);
            let job = move |(policy_idx, driver)| Job { policy_idx, condition, episode, seed, driver };
            drivers.clone().into_iter().enumerate().map(job)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::SweepArgs;

    #[test]
    fn policies_alternate_and_twins_share_seeds() {
        let arguments = "--policy idle --policy expert --policy random --tasks RaiseCube,StackCube \
            --perturbations None,MO-Color --episodes 2";
        let plan = RunPlan::new(&SweepArgs::parse(arguments).unwrap()).unwrap();
        let jobs: Vec<Job> = jobs(&plan).collect();
        assert_eq!(jobs.len() as u64, plan.n_episodes());
        let drivers: Vec<Driver> = jobs.iter().take(4).map(|job| job.driver).collect();
        assert_eq!(drivers, [Driver::Lane(0), Driver::Expert, Driver::Lane(1), Driver::Lane(0)]);
        for job in &jobs {
            assert_eq!(job.seed, episode_seed(0, job.condition.task.name(), job.episode));
        }
    }
}
