//! The results file of a run in progress: its episodes, its plan and its circumstances.

use std::time::Instant;

use policy_host::spec::server::without_credentials;
use run_config::trace::{self, Activity};
use serde_json::{Value, json};

use crate::console::exit::{Failure, OrUser};
use crate::console::output::print_message;
use crate::fleet::{FleetEvent, Totals};
use crate::plan::RunPlan;
use crate::plan::jobs::JobList;
use crate::plan::partition::{ShardPart, StoredShard, SweepShard};
use crate::run::stopping::Stopping;
use crate::store::build_identity;
use crate::store::results::{ENVIRONMENT, EpisodeKey, Manifest, Results, SHARD, STOPPING, StoreError};
use crate::study::machine::Machine;

/// Stores the episodes of a run.
#[derive(Debug)]
pub(crate) struct Recorder<'a> {
    plan: &'a RunPlan,
    /// Number of episodes of the plan, or of the shard of it that is run.
    n_planned: u64,
    /// The shard, if one is run.
    shard: Option<SweepShard>,
    results: Results,
    started: Instant,
    /// Start of the run, in UTC.
    date: String,
    /// Episodes of the plan that earlier runs have finished.
    n_done: u64,
    /// Episodes that this run has finished.
    n_finished: u64,
    /// Episodes without an error that the file must have.
    n_stored: u64,
}

impl<'a> Recorder<'a> {
    /// Opens or creates the results file of a plan, or of a part of it, and notes that in it. Also returns
    /// the episodes that are left.
    ///
    /// # Errors
    /// If the file is not one of this plan, or cannot be read and written.
    pub(crate) fn open(
        plan: &'a RunPlan,
        manifest: &Manifest,
        started: Instant,
        part: Option<&ShardPart>,
    ) -> Result<(Self, JobList), Failure> {
        let results = Results::open(&plan.db, manifest).or_user()?;
        let finished = results.finished(plan)?;
        let n_done = finished.len();
        let todo = JobList::unfinished(plan, finished, part);
        let (db, n_planned) = (plan.db.display(), part.map_or(plan.n_episodes(), ShardPart::len));
        let shard = part.map_or_else(String::new, |part| format!("shard {}: ", part.shard));
        print_message(&format!("{shard}results: {db} ({n_done} of {n_planned} episodes done)"));
        results.add_plan(plan)?;
        if let Some(part) = part {
            let machine = Machine::detect().to_string();
            let earlier: Option<StoredShard> = results.metadata(SHARD).or_user()?;
            let mut machines = earlier.map_or_else(Vec::new, |earlier| earlier.machines);
            if !machines.contains(&machine) {
                machines.push(machine);
            }
            results.set_metadata(SHARD, &json!(part.stored(machines, words())))?;
        }
        let (date, n_stored) = (results.now().or_user()?, results.n_finished()?);
        Ok((
            Self {
                plan,
                n_planned,
                shard: part.map(|part| part.shard),
                results,
                started,
                date,
                n_done,
                n_finished: 0,
                n_stored,
            },
            todo,
        ))
    }

    pub(crate) fn results(&self) -> &Results {
        &self.results
    }

    /// Returns the number of episodes of the run, those of earlier runs included.
    pub(crate) fn n_planned(&self) -> u64 {
        self.n_planned
    }

    /// Returns the number of them that earlier runs have finished.
    pub(crate) fn n_done(&self) -> u64 {
        self.n_done
    }

    /// Returns `true` if any policy reads images.
    pub(crate) fn needs_images(&self) -> bool {
        self.plan.needs_images()
    }

    /// Applies the plan's rule for early stopping, if it has one, to the episodes so far, and notes it.
    ///
    /// # Errors
    /// If the file cannot be read and written.
    pub(crate) fn stopping(&self) -> Result<Option<Stopping>, Failure> {
        let Some(rule) = &self.plan.stopping else { return Ok(None) };
        let stopping = Stopping::new(rule, self.plan, &self.results).or_user()?;
        self.results.set_metadata(STOPPING, &json!(rule))?;
        Ok(Some(stopping))
    }

    /// Returns the renderer whose images the rows depend on. They depend on none if no policy reads images.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(crate) fn renderer(&self) -> Result<Option<String>, Failure> {
        if self.plan.needs_images() { self.results.renderer().or_user() } else { Ok(None) }
    }

    /// Stores what an event tells.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(crate) fn on_event(&mut self, event: &FleetEvent<'_>) -> Result<(), StoreError> {
        match event {
            FleetEvent::EpisodeFinished(job, outcome) => {
                let storing = trace::span(Activity::Store);
                let policy = &self.plan.policies[job.policy_idx].name;
                let key = EpisodeKey { policy, condition: job.condition, episode: job.episode };
                self.results.record(key, job.seed, outcome)?;
                storing.finish(1);
                self.n_finished += 1;
                self.n_stored += u64::from(outcome.error.is_none());
            }
            FleetEvent::RendererReady(identity) if self.plan.needs_images() => {
                self.results.set_renderer(identity)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Checks that the file has all rows.
    ///
    /// # Errors
    /// If some are missing.
    pub(crate) fn check(&self) -> Result<(), StoreError> {
        self.results.check_n_finished(self.n_stored)
    }

    /// Says how to go on after a run that ended in an error, and adds its time to that of the earlier ones.
    /// If the time cannot be stored either, the error of the run is still the one to report.
    pub(crate) fn on_failure(&self) {
        if self.n_done + self.n_finished == 0 {
            return;
        }
        print_message(&self.resume_hint());
        if let Ok(mut environment @ (Value::Null | Value::Object(_))) =
            self.results.metadata(ENVIRONMENT).map(Option::unwrap_or_default)
        {
            environment["wall_s"] = json!(self.total_wall_s(&environment));
            let _ = self.results.set_metadata(ENVIRONMENT, &environment);
        }
    }

    pub(crate) fn resume_hint(&self) -> String {
        match self.shard {
            Some(shard) => format!("finished episodes are stored; the next task with shard {shard} resumes"),
            None => format!(
                "{}: finished episodes are stored; run the same command to resume",
                self.plan.db.display()
            ),
        }
    }

    /// Notes the circumstances of the run, unless it had nothing to do, and returns those in the file.
    ///
    /// # Errors
    /// If the file cannot be read and written.
    pub(crate) fn note_environment(&self, machine: &Machine, totals: &Totals) -> Result<Value, Failure> {
        let earlier: Value = self.results.metadata(ENVIRONMENT).or_user()?.unwrap_or_default();
        if self.n_done == self.n_planned {
            return Ok(earlier);
        }
        let environment = self.environment(machine, totals, &earlier);
        self.results.set_metadata(ENVIRONMENT, &environment)?;
        Ok(environment)
    }

    /// Returns the facts that timings depend on and results do not.
    fn environment(&self, machine: &Machine, totals: &Totals, earlier: &Value) -> Value {
        let config = &self.plan.config;
        json!({
            "date": self.date,
            "command": format!("hypogeum {}", words().join(" ")),
            "commit": build_identity::COMMIT,
            "wall_s": self.total_wall_s(earlier),
            "envs": config.resources.envs,
            "env_choice": totals.choice,
            "threads": config.resources.n_threads(),
            "renderer": config.rendering.renderer,
            "adapter": totals.renderer,
            "shm_bytes": totals.shm_bytes,
            "restarts": totals.restarts,
            "machine": machine,
        })
    }

    /// Returns the time of all runs with the file in s.
    fn total_wall_s(&self, earlier: &Value) -> f64 {
        earlier["wall_s"].as_f64().unwrap_or(0.0) + self.started.elapsed().as_secs_f64()
    }
}

/// Returns the words of the command without the program and without credentials.
fn words() -> Vec<String> {
    std::env::args_os().skip(1).map(|word| without_credentials(&word.to_string_lossy())).collect()
}
