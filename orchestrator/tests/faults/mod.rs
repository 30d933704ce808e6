//! The fleet's loop in a simulated world: its clock and its children are models, and a seed decides which
//! faults strike when. A run takes about a millisecond, and every one repeats bit for bit.
//!
//! [`world`] stands in for the processes, [`sim`] and [`child`] model what runs in them, [`scenario`] draws
//! a run and its faults from a seed, and [`history`], [`reactions`] and [`verdict`] hold the rules that every
//! run must obey: it ends; a recorded outcome is the right one and recorded once; every error has a cause;
//! no child is left; and if nothing forces the run to end, all of its episodes are recorded.

mod behaviour;
mod child;
mod foreign;
mod history;
mod injector;
mod reactions;
mod scenario;
mod sim;
mod verdict;
mod world;

use std::any::Any;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use ipc_types::link::Domain;
use rayon::prelude::*;

use self::history::RunHistory;
use self::scenario::{FAULTS, FaultKind, FaultScenario};
use self::world::FakeWorld;
use super::queue::JobQueue;
use super::supervisor::Supervisor;
use super::{FleetError, FleetEvent, Observer, RunStatus};
use crate::plan::jobs::{Job, JobList};

/// Number of seeds.
const N_SEEDS: u64 = 10_000;

/// A run that has obeyed all rules.
#[derive(PartialEq)]
struct FaultyRun {
    result: &'static str,
    struck: BTreeSet<FaultKind>,
    log: VecDeque<String>,
}

/// Watches a run.
struct Watcher<'a, 's> {
    scenario: &'a FaultScenario,
    history: &'a RefCell<RunHistory<'s>>,
}

impl Observer for Watcher<'_, '_> {
    fn on_event(&mut self, event: &FleetEvent<'_>) -> anyhow::Result<()> {
        self.history.borrow_mut().on_report(event)
    }

    fn is_wanted(&mut self, job: &Job) -> bool {
        self.scenario.is_wanted(job)
    }
}

/// Runs a seed, or fails with the end of its log.
fn run(seed: u64) -> FaultyRun {
    let scenario = FaultScenario::new(seed);
    let history = RefCell::new(RunHistory::new(&scenario));
    let run = catch_unwind(AssertUnwindSafe(|| supervise(&scenario, &history)));
    let history = history.into_inner();
    match run {
        Ok((result, struck)) => FaultyRun { result, struck, log: history.log },
        Err(panic) => panic!("seed {seed}: {}\n{}", message(&*panic), history.tail()),
    }
}

/// Runs the supervisor in a simulated world and checks all rules. Returns the kind of its result, and the
/// faults that have struck.
fn supervise<'s>(
    scenario: &'s FaultScenario,
    history: &RefCell<RunHistory<'s>>,
) -> (&'static str, BTreeSet<FaultKind>) {
    let config = &scenario.config;
    let domain = Domain::new(&config.base, config.run_id);
    let mut world = FakeWorld::new(scenario, history);
    let pending = JobQueue::new(&JobList::of(scenario.jobs.clone()), config.paired);
    let mut observer = Watcher { scenario, history };
    let result = Supervisor::new(config, &domain, &mut world, pending, &mut observer).run();
    assert!(world.children.is_empty(), "nobody has waited for a child");
    let history = history.borrow();
    let (shutdown_start, _) = history.shutdown.expect("the children were asked to exit");
    let n_roles = config.lanes.len() as u32 + 1;
    let limit = config.limits.shutdown * (2 * n_roles + 1) + history.pauses + Duration::from_secs(1);
    assert!(world.time - shutdown_start <= limit, "the shutdown takes too long");
    history.check_result(&result);
    (kind(&result), world.draw.struck)
}

fn kind<T>(result: &Result<(RunStatus, T), FleetError>) -> &'static str {
    match result {
        Ok((RunStatus::Complete, _)) => "complete",
        Ok((RunStatus::Stopped, _)) => "stopped",
        Err(FleetError::Observer(_)) => "disk full",
        Err(FleetError::Spawn { .. }) => "spawn failed",
        Err(FleetError::Intruder { .. }) => "intruder",
        Err(FleetError::Shortage { .. }) => "shortage",
        Err(FleetError::Vanished { .. }) => "vanished",
        Err(FleetError::Stuck { .. }) => "stuck",
        Err(FleetError::OutOfMemory { .. }) => "out of memory",
        Err(FleetError::Ended { .. }) => "ended",
        Err(FleetError::CpuTime { .. }) => "out of time",
        Err(FleetError::Renderer(_)) => "renderer failed",
        Err(FleetError::RendererChanged { .. }) => "renderer changed",
        Err(FleetError::Child { .. }) => "user error",
        Err(FleetError::TooManyFailures { .. }) => "too many failures",
        Err(FleetError::Lane(_)) => "lane failed",
        Err(error) => unreachable!("no fault causes {error}"),
    }
}

fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or_default()
}

#[test]
fn faults_lose_repeat_and_hang_nothing() {
    let runs = (0..N_SEEDS).into_par_iter().map(run);
    let kinds: Vec<_> = runs.map(|run| (run.result, run.struck)).collect();
    let mut results: BTreeMap<&str, u64> = BTreeMap::new();
    let mut struck = BTreeSet::new();
    for (result, faults) in kinds {
        *results.entry(result).or_default() += 1;
        struck.extend(faults);
    }
    // The faults are neither too rare to matter nor so frequent that nothing completes.
    assert!(results["complete"] > N_SEEDS / 2 && results.len() == 16, "{results:?}");
    assert_eq!(struck.len(), FAULTS.len(), "{struck:?}");
}

#[test]
fn same_seed_repeats_the_same_run() {
    for seed in 0..50 {
        assert!(run(seed) == run(seed), "seed {seed}");
    }
}
