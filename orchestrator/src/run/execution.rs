//! Execution of episodes: checks that every policy can be loaded, and runs a fleet for the episodes of a
//! plan.

use std::collections::HashSet;
use std::hash::{BuildHasher, RandomState};
use std::path::PathBuf;

use anyhow::Context;
use ipc_types::link::{Domain, SHM};
use policy_host::{PolicyCheck, PolicySpec, device};
use run_config::{Execution, RunConfig};

use crate::console::exit::{Failure, OrUser};
use crate::console::interrupt;
use crate::fleet::{self, Fleet, FleetConfig, FleetError, FleetEvent, Observer, RunStatus, Totals, python};
use crate::plan::capacity::Capacity;
use crate::plan::jobs::{Job, JobKey, JobList};
use crate::plan::lanes::lanes;
use crate::plan::{RunPlan, check_latency};
use crate::selection::policy::{Identity, NamedPolicy};

/// Number of times that a run goes on under other names.
const MAX_MOVES: usize = 3;
/// The file that this process executes, even if another has taken its path since, as after a rebuild.
const THIS_PROGRAM: &str = "/proc/self/exe";

/// Finds the device on which the policies of a run compute, and puts it into the configuration in place of
/// `auto`. Returns its identity, unless it is the CPU.
pub(crate) fn find_device(
    policies: &[NamedPolicy],
    config: &mut RunConfig,
) -> Result<Option<String>, Failure> {
    let specs: Vec<_> = policies.iter().map(|policy| &policy.spec).collect();
    let found = device::find(&specs, (&*config).into()).or_user()?;
    config.inference.policy_device = found.choice;
    Ok(found.identity)
}

/// Resolves what the policies' checkpoints decide, and returns the identity of each policy on a device. Also
/// checks that each can be loaded, before anything is started.
pub(crate) fn resolve(plan: &mut RunPlan, device: Option<&str>) -> Result<Vec<Identity>, Failure> {
    let robots: Vec<_> =
        plan.morphologies().into_iter().map(|robot| (robot, plan.control_mode_of(robot))).collect();
    let (query, latency) = (plan.config.query, plan.config.results.latency);
    let interpreter = plan.config.resources.python.clone();
    let check = |policy: &NamedPolicy| -> anyhow::Result<(NamedPolicy, PolicyCheck)> {
        let located = policy.located()?;
        let check = policy_host::check(&located.spec, &robots, query)?;
        Ok((located, check))
    };
    let of_policy = |name: &str| format!("policy `{name}`");
    let checks =
        plan.policies.iter().map(|policy| check(policy).with_context(|| of_policy(&policy.name)).or_user());
    let checks = checks.collect::<Result<Vec<_>, _>>()?;
    plan.choose_protocol(checks.iter().map(|(policy, check)| (policy.name.as_str(), check))).or_user()?;
    let images = plan.config.results.protocol.image_size;
    let instructions = plan.instructions().or_user()?;
    let resolve = |policy: &mut NamedPolicy,
                   execution: &mut Execution,
                   (located, check): (NamedPolicy, PolicyCheck)|
     -> anyhow::Result<Identity> {
        let PolicyCheck { execution: own, mappings, mut notes } = check;
        notes.extend(mappings.iter().filter_map(|mapping| mapping.image_differences(images)));
        *execution = own.unwrap_or(*execution);
        check_latency(latency, *execution)?;
        notes.extend(policy_host::long_prompts(&located.spec, &instructions)?);
        let folders = [policy, &located].map(|policy| policy.spec.checkpoint());
        if let [Some(typed), Some(folder)] = folders
            && std::fs::canonicalize(typed).ok().as_deref() != Some(folder)
        {
            notes.insert(0, format!("reads {}", folder.display()));
        }
        if let PolicySpec::Server(server) = &located.spec {
            let says = python::describe(&interpreter, server)?;
            notes.push(format!("the server says of itself: {says}"));
        }
        let identity = located.identity(device, *execution)?;
        let identity = Identity { spec: policy.spec.to_string(), notes, ..identity };
        *policy = located;
        Ok(identity)
    };
    let policies = plan.policies.iter_mut().zip(&mut plan.executions).zip(checks);
    let identities = policies.map(|((policy, execution), check)| {
        let name = policy.name.clone();
        resolve(policy, execution, check).with_context(|| of_policy(&name)).or_user()
    });
    identities.collect()
}

/// Runs `todo` in a fleet of child processes. Starts none if there is nothing to do.
///
/// If a child crashes while another user's files stall the cleanup, or the shared memory is gone or seems
/// damaged, the unfinished episodes continue in a new fleet with other names.
pub(crate) fn execute(
    plan: &RunPlan,
    identities: &[Identity],
    mut todo: JobList,
    earlier_renderer: Option<&str>,
    observer: &mut dyn Observer,
) -> Result<(RunStatus, Totals), Failure> {
    if todo.len() == 0 {
        // No fleet starts, which would remove what crashed runs have left.
        Domain::remove_stale(&fleet::runtime_folder());
    }
    let (mut n_moves, mut can_move) = (0, true);
    while todo.len() > 0 {
        let fleet = fleet(plan, identities, todo.len(), earlier_renderer.map(str::to_owned), can_move)?;
        let stopper = fleet.stopper();
        let _watch = interrupt::watch(move || stopper.stop()).context("failed to install signal handlers")?;
        let mut tracker = FinishedJobs { observer, finished: HashSet::new() };
        let result = fleet.run(&todo, &mut tracker);
        let finished = tracker.finished;
        match result {
            Err(error) if error.may_go_on_elsewhere() && n_moves < MAX_MOVES => {
                n_moves += 1;
                // A child that fails wherever it is started is not the fault of shared memory.
                can_move = n_moves < MAX_MOVES && !finished.is_empty();
                observer.on_event(&FleetEvent::Log(&format!("{error}; continuing under other names")))?;
                todo = todo.without(finished);
            }
            result => return result.map_err(as_failure),
        }
    }
    Ok((RunStatus::Complete, Totals::default()))
}

/// Remembers which jobs are finished, on the way to another observer.
struct FinishedJobs<'a> {
    observer: &'a mut dyn Observer,
    finished: HashSet<JobKey>,
}

impl Observer for FinishedJobs<'_> {
    fn on_event(&mut self, event: &FleetEvent<'_>) -> anyhow::Result<()> {
        if let FleetEvent::EpisodeFinished(job, _) = event {
            self.finished.insert(job.key());
        }
        self.observer.on_event(event)
    }

    fn is_wanted(&mut self, job: &Job) -> bool {
        self.observer.is_wanted(job)
    }
}

/// Makes the fleet for `n_jobs` episodes of a plan, whose policies have these identities. Starts nothing.
pub(crate) fn fleet(
    plan: &RunPlan,
    identities: &[Identity],
    n_jobs: u64,
    earlier_renderer: Option<String>,
    can_move: bool,
) -> Result<Fleet, Failure> {
    let mut config = fleet_config(plan, Capacity::new(plan, n_jobs as usize), earlier_renderer);
    config.can_move = can_move;
    for policy in &mut config.lanes {
        let position = plan.policies.iter().position(|named| named.name == policy.lane.spec.policy);
        policy.checkpoint = position.and_then(|idx| identities[idx].checkpoint.clone());
    }
    Ok(Fleet::new(config))
}

/// Classifies an error of a fleet by who can fix it.
pub(crate) fn as_failure(error: FleetError) -> Failure {
    let is_user_error = error.is_user_error();
    let error = anyhow::Error::from(error);
    if is_user_error { Failure::User(error) } else { Failure::Bug(error) }
}

fn fleet_config(plan: &RunPlan, capacity: Capacity, earlier_renderer: Option<String>) -> FleetConfig {
    FleetConfig {
        program: PathBuf::from(THIS_PROGRAM),
        base: fleet::runtime_folder(),
        shm: PathBuf::from(SHM),
        // The keys of a `RandomState` are random numbers from the operating system.
        run_id: RandomState::new().hash_one(std::process::id()),
        run: plan.config.clone(),
        earlier_renderer,
        can_move: false,
        paired: plan.stopping.is_some(),
        lanes: lanes(plan, capacity.batch),
        capacity,
        morphologies: plan.morphologies(),
        limits: fleet::Limits::default(),
    }
}
