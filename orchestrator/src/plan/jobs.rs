//! The episodes of a plan, in the order in which they run.

use std::collections::HashSet;
use std::rc::Rc;

use sim::scene::stream::episode_seed;
use sim::serve::protocol::{Assignment, Driver};

use crate::plan::RunPlan;
use crate::plan::partition::ShardPart;
use crate::selection::condition::Condition;
use crate::store::results::FinishedEpisodes;

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
    /// Returns the identity of the job within its plan.
    pub(crate) fn key(&self) -> JobKey {
        (self.policy_idx, self.condition, self.episode)
    }

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

/// Jobs that are made when their turn comes: a plan may have more of them than fit into memory.
#[derive(Clone)]
pub(crate) struct JobList {
    drivers: Vec<Driver>,
    len: u64,
    make: Rc<MakeJobs>,
}

/// Returns the jobs of a driver with their positions in the plan, in ascending order.
type MakeJobs = dyn Fn(Driver) -> DriverJobs;

/// The jobs of one driver with their positions in the plan.
pub(crate) type DriverJobs = Box<dyn Iterator<Item = (u64, Job)>>;

/// The identity of a job within its plan.
pub(crate) type JobKey = (usize, Condition, u32);

impl JobList {
    /// Lists jobs in this order.
    pub(crate) fn of(jobs: Vec<Job>) -> Self {
        let mut drivers = Vec::new();
        for job in &jobs {
            if !drivers.contains(&job.driver) {
                drivers.push(job.driver);
            }
        }
        let (len, jobs) = (jobs.len() as u64, Rc::<[Job]>::from(jobs));
        let make = move |driver| -> DriverJobs {
            let jobs = Rc::clone(&jobs);
            let all = (0..jobs.len()).map(move |idx| (idx as u64, jobs[idx]));
            Box::new(all.filter(move |(_, job)| job.driver == driver))
        };
        Self { drivers, len, make: Rc::new(make) }
    }

    /// Lists the episodes of a plan, or of a part of it, that have not finished. Policies vary fastest and
    /// conditions next, so that all lanes have work at all times and an interrupted run has some episodes of
    /// each condition.
    pub(crate) fn unfinished(plan: &RunPlan, finished: FinishedEpisodes, part: Option<&ShardPart>) -> Self {
        let drivers = drivers(plan);
        let len = part.map_or(plan.n_episodes(), ShardPart::len) - finished.len();
        let part: Option<Rc<ShardPart>> = part.cloned().map(Rc::new);
        let conditions: Rc<[Condition]> = plan.conditions.as_slice().into();
        let (n_episodes, seed, finished) = (plan.episodes, plan.config.results.seed, Rc::new(finished));
        let (n_policies, n_conditions) = (drivers.len(), conditions.len());
        let of_policies = drivers.clone();
        let make = move |driver| -> DriverJobs {
            let own = of_policies.iter().enumerate().filter(|(_, other)| **other == driver);
            let own: Rc<[usize]> = own.map(|(idx, _)| idx).collect();
            let (conditions, finished, part) = (Rc::clone(&conditions), Rc::clone(&finished), part.clone());
            let indices = (0..n_episodes).flat_map(move |episode| {
                let own = Rc::clone(&own);
                (0..n_conditions).flat_map(move |condition_idx| {
                    let own = Rc::clone(&own);
                    (0..own.len()).map(move |idx| (episode, condition_idx, own[idx]))
                })
            });
            let left = indices.filter(move |&(episode, condition_idx, policy_idx)| {
                !finished.contains(policy_idx, condition_idx, episode)
                    && part.as_ref().is_none_or(|part| part.contains((policy_idx, condition_idx, episode)))
            });
            Box::new(left.map(move |(episode, condition_idx, policy_idx)| {
                let cell = u64::from(episode) * n_conditions as u64 + condition_idx as u64;
                let condition = conditions[condition_idx];
                let seed = episode_seed(seed, condition.task.name(), episode);
                (
                    cell * n_policies as u64 + policy_idx as u64,
                    Job { policy_idx, condition, episode, seed, driver },
                )
            }))
        };
        Self { drivers, len, make: Rc::new(make) }
    }

    /// Leaves jobs of the list out.
    pub(crate) fn without(self, keys: HashSet<JobKey>) -> Self {
        let len = self.len - keys.len() as u64;
        let (make, keys) = (self.make, Rc::new(keys));
        let make = move |driver| -> DriverJobs {
            let keys = Rc::clone(&keys);
            Box::new(make(driver).filter(move |(_, job)| !keys.contains(&job.key())))
        };
        Self { drivers: self.drivers, len, make: Rc::new(make) }
    }

    /// Returns the number of jobs.
    pub(crate) fn len(&self) -> u64 {
        self.len
    }

    /// Returns the drivers, each once.
    pub(crate) fn drivers(&self) -> impl Iterator<Item = Driver> {
        let first = |(idx, driver): (usize, &Driver)| !self.drivers[..idx].contains(driver);
        self.drivers
            .iter()
            .enumerate()
            .filter(move |(idx, driver)| first((*idx, *driver)))
            .map(|(_, driver)| *driver)
    }

    /// Returns the jobs of a driver.
    pub(crate) fn of_driver(&self, driver: Driver) -> DriverJobs {
        (self.make)(driver)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::sweep::SweepArgs;

    fn plan(arguments: &str) -> RunPlan {
        RunPlan::new(&SweepArgs::parse(arguments).unwrap()).unwrap()
    }

    /// Returns all jobs in the order of the plan.
    fn in_order(list: &JobList) -> Vec<Job> {
        let mut jobs: Vec<(u64, Job)> = list.drivers().flat_map(|driver| list.of_driver(driver)).collect();
        jobs.sort_by_key(|(position, _)| *position);
        jobs.into_iter().map(|(_, job)| job).collect()
    }

    #[test]
    fn policies_alternate_and_twins_share_seeds() {
        let plan = plan(
            "--policy idle --policy expert --policy random --policy e=expert --tasks RaiseCube,StackCube \
             --perturbations None,MO-Color --episodes 2",
        );
        let list = JobList::unfinished(&plan, FinishedEpisodes::default(), None);
        let jobs = in_order(&list);
        assert_eq!((jobs.len() as u64, list.len()), (plan.n_episodes(), plan.n_episodes()));
        let drivers: Vec<Driver> = jobs.iter().take(5).map(|job| job.driver).collect();
        assert_eq!(
            drivers,
            [Driver::Lane(0), Driver::Expert, Driver::Lane(1), Driver::Expert, Driver::Lane(0)]
        );
        for job in &jobs {
            assert_eq!(job.seed, episode_seed(0, job.condition.task.name(), job.episode));
        }
        let finished: HashSet<JobKey> = jobs.iter().step_by(3).map(Job::key).collect();
        let left = list.without(finished.clone());
        let expected: Vec<Job> = jobs.into_iter().filter(|job| !finished.contains(&job.key())).collect();
        assert_eq!((in_order(&left), left.len()), (expected.clone(), expected.len() as u64));
        assert_eq!(in_order(&JobList::of(expected.clone())), expected);
    }

    #[test]
    fn largest_plan_begins_at_once() {
        let policies: String = (0..20).map(|idx| format!("--policy p{idx}=random ")).collect();
        let plan = plan(&format!("{policies}--tasks all --perturbations all --episodes 1000000"));
        let list = JobList::unfinished(&plan, FinishedEpisodes::default(), None);
        assert_eq!(list.len(), plan.n_episodes());
        let last = list.drivers().last().unwrap();
        assert_eq!(list.of_driver(last).next().unwrap().0, 19);
    }
}
