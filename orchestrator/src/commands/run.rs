//! `hypogeum run`: evaluates policies, stores the results and reports them.

use std::hash::{BuildHasher, RandomState};
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context;
use clap::Args;
use ipc_types::layout::block_pages;
use ipc_types::link::LaneSpec;
use policy_host::PolicySpec;
use serde_json::{Value, json};
use sim::serve::protocol::{Driver, Lane};

use crate::exit::{ExitStatus, Failure, OrUser};
use crate::fleet::{self, Fleet, FleetConfig, FleetEvent, PolicyLane, RunStatus, Totals};
use crate::interrupt;
use crate::jobs::{Job, drivers, jobs};
use crate::machine::Machine;
use crate::output::{print_message, print_out};
use crate::plan::RunPlan;
use crate::policy::{Identity, NamedPolicy};
use crate::progress::Progress;
use crate::report::{self, Cell, Fps};
use crate::results::{EpisodeKey, Manifest, Results};
use crate::sweep::SweepArgs;

/// Observation batches that may be unanswered on a lane, so that stepping and inference overlap.
const IN_FLIGHT: u32 = 2;
/// Mount point of shared memory.
const SHM: &str = "/dev/shm";

/// Arguments of `run`.
#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// Sweep file: the options below as TOML keys, for example `control_mode` for --control-mode and the list
    /// `policies` for --policy. Options on the command line override those of the file
    #[arg(value_name = "SWEEP.toml")]
    pub(crate) file: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) sweep: SweepArgs,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub(crate) json: bool,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Runs the episodes that the results file does not have yet, and reports the results of the whole plan.
pub(crate) fn run(args: &RunArgs, started: Instant) -> Result<ExitStatus, Failure> {
    let machine = Machine::detect();
    let plan = RunPlan::new(&args.sweep).or_user()?;
    let manifest = Manifest::new(&plan, identities(&plan)?);
    let mut results = Results::open(&plan.db, &manifest).or_user()?;
    let finished = results.finished()?;
    let key = |job: &Job| EpisodeKey {
        policy: &plan.policies[job.policy_idx].name,
        condition: job.condition,
        episode: job.episode,
    };
    let todo: Vec<Job> = jobs(&plan).filter(|job| !finished.contains(key(job))).collect();
    let n_done = plan.n_episodes() - todo.len() as u64;
    print_message(&format!(
        "results: {} ({n_done} of {} episodes done)",
        plan.db.display(),
        plan.n_episodes()
    ));

    let mut progress = Progress::of_run(plan.n_episodes(), n_done, args.quiet, args.json);
    let earlier_renderer = if plan.needs_images() { results.renderer()? } else { None };
    let outcome = run_fleet(&plan, todo, earlier_renderer, |event| {
        match event {
            FleetEvent::EpisodeFinished(job, outcome) => {
                results.record(key(job), job.seed, outcome)?;
                progress.tick();
            }
            FleetEvent::Counters(counters) => progress.counters(counters),
            FleetEvent::Log(line) => progress.log(line),
            // Results do not depend on the renderer if no policy reads images.
            FleetEvent::RendererReady(identity) if plan.needs_images() => results.set_renderer(identity)?,
            FleetEvent::RendererReady(_) => {}
        }
        Ok(())
    });
    progress.finish();
    let resume_hint =
        || format!("{}: finished episodes are stored; run the same command to resume", plan.db.display());
    let (status, totals) = outcome.inspect_err(|_| print_message(&resume_hint()))?;
    let environment = environment(&plan, &machine, &totals);
    if n_done < plan.n_episodes() {
        results.note("environment", &environment)?;
    }
    if status == RunStatus::Stopped {
        print_message(&format!("interrupted; {}", resume_hint()));
        return Ok(ExitStatus::Interrupted);
    }
    let cells = report::cells(&plan, &results)?;
    let fps = Fps::new(&totals, started.elapsed(), machine.n_cores);
    if args.json {
        let mut run = json!(manifest);
        run["environment"] = environment;
        print_out(&format!("{:#}\n", report::json(&run, &cells, &fps)))?;
    } else {
        print_report(&plan, &cells, &fps)?;
    }
    let errored = cells.iter().any(|cell| cell.sums.errors > 0);
    Ok(if errored { ExitStatus::EpisodeErrors } else { ExitStatus::Success })
}

fn print_report(plan: &RunPlan, cells: &[Cell], fps: &Fps) -> std::io::Result<()> {
    let (table, lines) = (report::table(plan, cells), fps.lines());
    let gap = if lines.is_empty() { "" } else { "\n" };
    print_out(&format!("{table}{gap}{lines}"))
}

/// Returns the identity of each policy. Also checks that each can be loaded, before anything is started.
fn identities(plan: &RunPlan) -> Result<Vec<Identity>, Failure> {
    let robots: Vec<_> =
        plan.morphologies().into_iter().map(|robot| (robot, plan.control_mode_of(robot))).collect();
    let identity = |policy: &NamedPolicy| {
        policy_host::check(&policy.spec, &robots)
            .map_err(anyhow::Error::new)
            .and_then(|()| policy.identity().map_err(Into::into))
            .with_context(|| format!("policy `{}`", policy.name))
            .or_user()
    };
    plan.policies.iter().map(identity).collect()
}

/// Runs `todo` in a fleet of child processes. Starts none if there is nothing to do.
fn run_fleet(
    plan: &RunPlan,
    todo: Vec<Job>,
    earlier_renderer: Option<String>,
    mut sink: impl FnMut(FleetEvent<'_>) -> anyhow::Result<()>,
) -> Result<(RunStatus, Totals), Failure> {
    if todo.is_empty() {
        return Ok((RunStatus::Complete, Totals::default()));
    }
    let program = std::env::current_exe().context("failed to find the executable of this process")?;
    let fleet = Fleet::new(fleet_config(plan, program, earlier_renderer));
    let stopper = fleet.stopper();
    let _watch = interrupt::watch(move || stopper.stop()).context("failed to install signal handlers")?;
    fleet.run(todo, &mut sink).map_err(|error| {
        let is_user_error = error.is_user_error();
        let error = anyhow::Error::from(error);
        if is_user_error { Failure::User(error) } else { Failure::Bug(error) }
    })
}

fn fleet_config(plan: &RunPlan, program: PathBuf, earlier_renderer: Option<String>) -> FleetConfig {
    FleetConfig {
        program,
        base: fleet::base(),
        shm: PathBuf::from(SHM),
        // The keys of a `RandomState` are random numbers from the operating system.
        run_id: RandomState::new().hash_one(std::process::id()),
        run: plan.config.clone(),
        earlier_renderer,
        lanes: lanes(plan),
        morphologies: plan.morphologies(),
        limits: fleet::Limits::default(),
    }
}

/// Returns the policies that run outside the sim. A batch holds half of the envs, so that the others step
/// meanwhile.
fn lanes(plan: &RunPlan) -> Vec<PolicyLane> {
    let policy = |(policy, driver): (&NamedPolicy, Driver)| {
        let Driver::Lane(lane) = driver else { return None };
        let images = policy.spec.needs_images();
        let max_pages =
            plan.morphologies().into_iter().map(|morphology| block_pages(morphology, images)).max();
        let spec = LaneSpec {
            lane,
            policy: policy.name.clone(),
            max_envs: plan.config.resources.envs.div_ceil(2),
            block_pages: max_pages.unwrap_or(1) as u32,
            in_flight: IN_FLIGHT,
        };
        let foreign = matches!(policy.spec, PolicySpec::Attach(_));
        Some(PolicyLane { spec: policy.spec.clone(), lane: Lane { spec, images, foreign } })
    };
    plan.policies.iter().zip(drivers(plan)).filter_map(policy).collect()
}

/// Returns the facts that timings depend on and results do not.
fn environment(plan: &RunPlan, machine: &Machine, totals: &Totals) -> Value {
    json!({
        "envs": plan.config.resources.envs,
        "threads": plan.config.resources.threads,
        "renderer": plan.config.rendering.renderer,
        "adapter": totals.renderer,
        "shm_bytes": totals.shm_bytes,
        "restarts": totals.restarts,
        "machine": machine,
    })
}
