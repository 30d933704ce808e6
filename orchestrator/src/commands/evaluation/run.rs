//! `hypogeum run`: evaluates policies, stores the results and reports them.

use std::cell::{Cell, RefCell};
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use run_config::trace::{self, Activity, TraceSpan};
use serde_json::{Value, json};
use sim::serve::protocol::Outcome;

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::{OutputError, print_message, print_out};
use crate::console::progress::Progress;
use crate::fleet::{FleetEvent, RunStatus, Totals};
use crate::plan::RunPlan;
use crate::plan::jobs::{Job, JobList};
use crate::plan::sweep::SweepArgs;
use crate::run::execution::{execute, find_device, resolve};
use crate::run::live::RunningSuccess;
use crate::run::stopping::{SequentialCell, Stopping};
use crate::run::trace_file::TraceFile;
use crate::store::build_identity;
use crate::store::results::{ENVIRONMENT, EpisodeKey, Manifest, Results, STOPPING};
use crate::study::machine::{Cores, Machine};
use crate::study::report::{self, Fps};

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
    /// Also print where the time went: the ledger, the bound, and how the number of envs was chosen
    #[arg(long)]
    pub(crate) verbose: bool,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
    #[arg(skip = Instant::now())]
    started: Instant,
}

/// Runs the episodes that the results file does not have yet, and reports the results of the whole plan.
pub(crate) fn run(args: &RunArgs) -> Result<ExitStatus, Failure> {
    let (machine, started) = (Machine::detect(), args.started);
    let mut plan = RunPlan::new(&args.sweep).or_user()?;
    let device = find_device(&plan.policies, &mut plan.config)?;
    let identities = resolve(&mut plan, device.as_deref())?;
    let manifest = Manifest::new(&plan, identities.clone());
    print_notes(&manifest);
    let mut results = Results::open(&plan.db, &manifest).or_user()?;
    let finished = results.finished(&plan)?;
    let n_done = finished.len();
    let todo = JobList::unfinished(&plan, finished);
    print_done(&plan, n_done);
    let (stopping, date) = note_start(&plan, &mut results)?;
    let (stopping, n_skipped) = (RefCell::new(stopping), Cell::new(0));
    let mut live = Live {
        progress: Progress::of_run(plan.n_episodes(), n_done, args.quiet, args.json),
        success: RunningSuccess::new(&plan, &results).or_user()?,
        stopping: &stopping,
        n_skipped: &n_skipped,
        n_finished: 0,
        n_stored: results.n_finished()?,
        trace: open_trace(plan.config.resources.trace.as_deref()).or_user()?,
    };
    let is_wanted = |job: &Job| {
        let wanted = stopping.borrow().as_ref().is_none_or(|stopping| stopping.is_wanted(job));
        n_skipped.set(n_skipped.get() + u64::from(!wanted));
        wanted
    };
    let earlier_renderer = if plan.needs_images() { results.renderer().or_user()? } else { None };
    let outcome = execute(&plan, &identities, todo, earlier_renderer.as_deref(), &is_wanted, |event| {
        match event {
            FleetEvent::EpisodeFinished(job, outcome) => {
                let storing = trace::span(Activity::Store);
                results.record(key(&plan, job), job.seed, outcome)?;
                storing.finish(1);
                live.on_finished(job, outcome);
            }
            FleetEvent::Counters(counters) => live.progress.counters(counters),
            FleetEvent::Spans(process, spans) => live.on_spans(process, spans),
            FleetEvent::Log(line) => live.progress.log(line),
            // Results do not depend on the renderer if no policy reads images.
            FleetEvent::RendererReady(identity) if plan.needs_images() => results.set_renderer(identity)?,
            FleetEvent::RendererReady(_) => {}
        }
        Ok(())
    });
    live.progress.finish();
    results.check_n_finished(live.n_stored)?;
    let traced = live.trace.map_or(Ok(()), TraceFile::finish);
    if outcome.is_err() && n_done + live.n_finished > 0 {
        note_failed_run(&plan, &results, started);
    }
    let (status, totals) = outcome?;
    let mut environment = results.environment().or_user()?;
    if n_done < plan.n_episodes() {
        environment = self::environment(&plan, &machine, &totals, (&environment, date, started));
        results.note(ENVIRONMENT, &environment)?;
    }
    if status == RunStatus::Stopped {
        print_message(&format!("interrupted; {}", resume_hint(&plan)));
        return Ok(ExitStatus::Interrupted);
    }
    let elapsed = started.elapsed();
    let n_threads = plan.config.resources.n_threads();
    let fps = Fps::new(&totals, elapsed, Cores::measure(&machine, n_threads, totals.hosts().flop > 0));
    let conclusions = stopping.borrow().as_ref().map_or_else(Vec::new, Stopping::conclusions);
    let mut run = json!(manifest);
    run["environment"] = environment;
    let status =
        print_results(&plan, &results, &conclusions, &fps, (args.verbose, args.json.then_some(&run)))?;
    traced.or_user()?;
    Ok(status)
}

/// Notes the plan and its rule for early stopping, if it has one, and applies the rule to the episodes so
/// far. Also returns the date.
fn note_start(plan: &RunPlan, results: &mut Results) -> Result<(Option<Stopping>, String), Failure> {
    results.add_plan(plan)?;
    let date = results.now().or_user()?;
    let Some(rule) = &plan.stopping else { return Ok((None, date)) };
    let stopping = Stopping::new(rule, plan, results).or_user()?;
    results.note(STOPPING, &json!(rule))?;
    Ok((Some(stopping), date))
}

/// Says how to go on after a run that ended in an error, and adds its time to that of the earlier ones. If
/// the time cannot be stored either, the error of the run is still the one to report.
fn note_failed_run(plan: &RunPlan, results: &Results, started: Instant) {
    print_message(&resume_hint(plan));
    if let Ok(mut environment @ (Value::Null | Value::Object(_))) = results.environment() {
        let wall_s = total_wall_s(&environment, started);
        environment["wall_s"] = json!(wall_s);
        let _ = results.note(ENVIRONMENT, &environment);
    }
}

fn key<'a>(plan: &'a RunPlan, job: &Job) -> EpisodeKey<'a> {
    EpisodeKey { policy: &plan.policies[job.policy_idx].name, condition: job.condition, episode: job.episode }
}

fn print_notes(manifest: &Manifest) {
    for (name, identity) in &manifest.policies {
        identity.notes.iter().for_each(|note| print_message(&format!("policy `{name}`: {note}")));
    }
}

fn print_done(plan: &RunPlan, n_done: u64) {
    let (db, n_episodes) = (plan.db.display(), plan.n_episodes());
    print_message(&format!("results: {db} ({n_done} of {n_episodes} episodes done)"));
}

fn resume_hint(plan: &RunPlan) -> String {
    format!("{}: finished episodes are stored; run the same command to resume", plan.db.display())
}

/// Prints the results of the whole plan: as JSON with the description `run`, or for people without one, and
/// then with all lines on speed if `verbose`.
fn print_results(
    plan: &RunPlan,
    results: &Results,
    conclusions: &[SequentialCell],
    fps: &Fps,
    (verbose, run): (bool, Option<&Value>),
) -> Result<ExitStatus, Failure> {
    let cells = report::cells(plan, results).or_user()?;
    if let Some(run) = run {
        let mut report = report::json(run, &cells, plan.stopped(), fps);
        if let Some(rule) = &plan.stopping {
            report["stopping"] = report::stopping::json(rule, conclusions);
        }
        print_out(&format!("{report:#}\n"))?;
    } else {
        let speed = if verbose { fps.lines() } else { fps.line() };
        print_report(plan, &cells, conclusions, &speed)?;
    }
    let errored = cells.iter().any(|cell| cell.sums.errors > 0);
    Ok(if errored { ExitStatus::EpisodeErrors } else { ExitStatus::Success })
}

/// Display of a run in progress, and the comparison that may end its cells.
struct Live<'a> {
    progress: Progress,
    success: RunningSuccess,
    stopping: &'a RefCell<Option<Stopping>>,
    /// Jobs that were dropped since the display was updated.
    n_skipped: &'a Cell<u64>,
    /// Episodes stored by this run.
    n_finished: u64,
    /// Episodes without an error that the file must have.
    n_stored: u64,
    trace: Option<TraceFile>,
}

impl Live<'_> {
    fn on_finished(&mut self, job: &Job, outcome: &Outcome) {
        self.n_finished += 1;
        let success = outcome.error.is_none().then_some(outcome.success_once);
        self.n_stored += u64::from(success.is_some());
        self.success.add(job.policy_idx, success);
        if let Some(stopping) = self.stopping.borrow_mut().as_mut() {
            stopping.on_finished(job, success);
        }
        self.progress.skip(self.n_skipped.take());
        self.progress.status(&self.success.parts(self.stopping.borrow().as_ref()));
        self.progress.tick();
    }

    fn on_spans(&mut self, process: &str, spans: &[TraceSpan]) {
        if let Some(file) = &mut self.trace {
            file.add(process, spans);
            file.add("orchestrator", &trace::take());
        }
    }
}

/// Creates the trace file, if there is to be one, and starts recording in this process.
fn open_trace(path: Option<&Path>) -> anyhow::Result<Option<TraceFile>> {
    let file = path.map(TraceFile::create).transpose()?;
    if file.is_some() {
        trace::enable();
    }
    Ok(file)
}

fn print_report(
    plan: &RunPlan,
    cells: &[report::Cell],
    conclusions: &[SequentialCell],
    speed: &str,
) -> Result<(), OutputError> {
    let table = report::table(plan, cells, conclusions);
    let gap = if speed.is_empty() { "" } else { "\n" };
    print_out(&format!("{table}{gap}{speed}"))
}

/// Returns the time of all runs with the file in s.
fn total_wall_s(earlier: &Value, started: Instant) -> f64 {
    earlier["wall_s"].as_f64().unwrap_or(0.0) + started.elapsed().as_secs_f64()
}

/// Returns the facts that timings depend on and results do not.
fn environment(
    plan: &RunPlan,
    machine: &Machine,
    totals: &Totals,
    (earlier, date, started): (&Value, String, Instant),
) -> Value {
    let words: Vec<String> =
        std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    json!({
        "date": date,
        "command": format!("hypogeum {}", words.join(" ")),
        "commit": build_identity::COMMIT,
        "wall_s": total_wall_s(earlier, started),
        "envs": plan.config.resources.envs,
        "env_choice": totals.choice,
        "threads": plan.config.resources.n_threads(),
        "renderer": plan.config.rendering.renderer,
        "adapter": totals.renderer,
        "shm_bytes": totals.shm_bytes,
        "restarts": totals.restarts,
        "machine": machine,
    })
}
