//! `hypogeum run`: from wishes to a table.

use std::hash::BuildHasher;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context;
use ipc_types::layout::block_pages;
use ipc_types::link::LaneSpec;
use policy_host::PolicySpec;
use serde_json::{Value, json};
use sim::serve::protocol::{Driver, Lane};

use crate::cli::RunArgs;
use crate::failure::{Ending, Failure, OrUser};
use crate::fleet::{self, Conclusion, Fleet, Happening, LanePolicy, Settings, Totals};
use crate::interrupt;
use crate::machine::Machine;
use crate::plan::RunPlan;
use crate::policy::Identity;
use crate::progress::{Progress, print};
use crate::report::{self, Fps};
use crate::results::{Key, Manifest, Results};
use crate::work::{Job, drivers, jobs};

/// Batches of observations that may be unanswered on a lane, so that stepping and inference overlap.
const IN_FLIGHT: u32 = 2;
/// Where shared memory lives.
const SHM: &str = "/dev/shm";

/// Evaluates, stores and reports.
pub(crate) fn run(args: &RunArgs, started: Instant) -> Result<Ending, Failure> {
    let machine = Machine::here();
    let plan = RunPlan::new(&args.sweep).or_user()?;
    let manifest = Manifest::new(&plan, identities(&plan)?);
    let mut results = Results::open(&plan.db, &manifest).or_user()?;
    let finished = results.finished()?;
    let key = |job: &Job| Key {
        policy: &plan.policies[job.policy_idx].name,
        condition: job.condition,
        episode: job.episode,
    };
    let todo: Vec<Job> = jobs(&plan).filter(|job| !finished.contains(key(job))).collect();
    let n_done = plan.n_episodes() - todo.len() as u64;
    print(&format!("results: {} ({n_done} of {} episodes done)", plan.db.display(), plan.n_episodes()));

    let mut progress = Progress::new(plan.n_episodes(), n_done, args.quiet, args.json);
    let drawn_with = if plan.needs_images() { results.drawn_with()? } else { None };
    let ran = run_fleet(&plan, todo, drawn_with, |happening| {
        match happening {
            Happening::Finished(job, outcome) => {
                results.record(key(job), job.seed, outcome)?;
                progress.tick();
            }
            Happening::Counters(counters) => progress.counters(counters),
            Happening::Log(line) => progress.log(line),
            // What no policy looks at makes no difference.
            Happening::Drawing(identity) if plan.needs_images() => results.draw_with(identity)?,
            Happening::Drawing(_) => {}
        }
        Ok(())
    });
    progress.finish();
    let kept =
        || format!("{}: finished episodes are kept; the same command again continues", plan.db.display());
    let (conclusion, totals) = ran.inspect_err(|_| print(&kept()))?;
    let environment = environment(&plan, &machine, &totals);
    if n_done < plan.n_episodes() {
        results.note("environment", &environment)?;
    }
    if conclusion == Conclusion::Stopped {
        print(&format!("interrupted; {}", kept()));
        return Ok(Ending::Interrupted);
    }
    let cells = report::cells(&plan, &results)?;
    let fps = Fps::new(&totals, started.elapsed(), machine.n_cores);
    if args.json {
        let mut run = json!(manifest);
        run["environment"] = environment;
        report::print_out(&format!("{:#}\n", report::json(&run, &cells, &fps)))?;
    } else {
        let (table, lines) = (report::table(&plan, &cells), fps.lines());
        let gap = if lines.is_empty() { "" } else { "\n" };
        report::print_out(&format!("{table}{gap}{lines}"))?;
    }
    let errored = cells.iter().any(|cell| cell.sums.errors > 0);
    Ok(if errored { Ending::WithErrors } else { Ending::Done })
}

/// What each policy is; also checks that it can be loaded at all, so that nothing is started in vain.
fn identities(plan: &RunPlan) -> Result<Vec<Identity>, Failure> {
    let robots: Vec<_> =
        plan.morphologies().into_iter().map(|robot| (robot, plan.control_mode_of(robot))).collect();
    let identity = |policy: &crate::policy::NamedPolicy| {
        policy_host::check(&policy.spec, &robots)
            .map_err(anyhow::Error::new)
            .and_then(|()| policy.identity().map_err(Into::into))
            .with_context(|| format!("policy `{}`", policy.name))
            .or_user()
    };
    plan.policies.iter().map(identity).collect()
}

/// Runs what is to be done, if anything.
fn run_fleet(
    plan: &RunPlan,
    todo: Vec<Job>,
    drawn_with: Option<String>,
    mut sink: impl FnMut(Happening<'_>) -> anyhow::Result<()>,
) -> Result<(Conclusion, Totals), Failure> {
    if todo.is_empty() {
        return Ok((Conclusion::Complete, Totals::default()));
    }
    let program = std::env::current_exe().context("failed to find this program's own file")?;
    let fleet = Fleet::new(settings(plan, program, drawn_with));
    let stopper = fleet.stopper();
    let _watch = interrupt::watch(move || stopper.stop()).context("failed to watch for signals")?;
    fleet.run(todo, &mut sink).map_err(|error| {
        let is_users = error.is_users();
        let error = anyhow::Error::from(error);
        if is_users { Failure::User(error) } else { Failure::Bug(error) }
    })
}

fn settings(plan: &RunPlan, program: PathBuf, drawn_with: Option<String>) -> Settings {
    // Random: the keys of a hasher come from the system.
    let run_id = std::hash::RandomState::new().hash_one(std::process::id());
    Settings {
        program,
        base: fleet::base(),
        shm: PathBuf::from(SHM),
        run_id,
        config: plan.config,
        drawn_with,
        lanes: lanes(plan),
        morphologies: plan.morphologies(),
        limits: fleet::Limits::default(),
    }
}

/// The policies outside the sim. Half of the envs fit into one batch, so that the others step meanwhile.
fn lanes(plan: &RunPlan) -> Vec<LanePolicy> {
    let policy = |(policy, driver): (&crate::policy::NamedPolicy, Driver)| {
        let Driver::Lane(lane) = driver else { return None };
        let images = policy.spec.needs_images();
        let widest = plan.morphologies().into_iter().map(|morphology| block_pages(morphology, images)).max();
        let spec = LaneSpec {
            lane,
            policy: policy.name.clone(),
            max_envs: plan.config.resources.envs.div_ceil(2),
            block_pages: widest.unwrap_or(1) as u32,
            in_flight: IN_FLIGHT,
        };
        let foreign = matches!(policy.spec, PolicySpec::Attach(_));
        let lane = Lane { spec, images, foreign };
        Some(LanePolicy { spec: policy.spec.clone(), lane })
    };
    plan.policies.iter().zip(drivers(plan)).filter_map(policy).collect()
}

/// What times depend on and results do not.
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
