//! The supervisor's loop: handles one event after another until all episodes are finished or the run has to
//! end.

mod exits;
mod policies;
mod state;
mod timeouts;

use std::time::Duration;

use policy_host::serve::HostEvent;
use run_config::trace::TraceSpan;
use sim::serve::protocol::{Driver, Outcome, SimCommand, SimEvent};

pub(crate) use self::state::Supervisor;
use super::error::FleetError;
use super::event::{FleetEvent, RunStatus, SupervisorEvent};
use crate::fleet::processes::member::MemberRole;
use crate::fleet::processes::process::ChildOutput;
use crate::fleet::tuning::totals::{HostWork, Totals};
use crate::fleet::tuning::tuner::WorkSample;

/// Maximum wait for an event before timeouts are checked.
const TICK: Duration = Duration::from_millis(200);

impl Supervisor<'_> {
    /// Starts the children, runs until all episodes are finished or a stop is requested, and ends the
    /// children.
    pub(crate) fn run(mut self) -> Result<(RunStatus, Totals), FleetError> {
        let status = self.run_episodes();
        let shutdown = self.shut_down();
        self.totals.choice = self.tuner.map(|tuner| tuner.choice().clone());
        let status = status?;
        shutdown?;
        Ok((status, self.totals))
    }

    fn run_episodes(&mut self) -> Result<RunStatus, FleetError> {
        self.start(MemberRole::Sim)?;
        for lane in self.hosted_lanes() {
            self.start(MemberRole::Host(lane))?;
        }
        while !(self.pending.is_empty() && self.outstanding.is_empty()) {
            self.assign_jobs();
            match self.children.next_event(TICK) {
                Some(SupervisorEvent::Child(role, output)) => self.on_output(role, output)?,
                Some(SupervisorEvent::Stop) => return Ok(RunStatus::Stopped),
                None => {}
            }
            self.check_timeouts()?;
        }
        Ok(RunStatus::Complete)
    }

    /// Asks all children to exit and kills those that do not in time, or all of them if another stop is
    /// requested. Episodes that finish meanwhile count.
    fn shut_down(&mut self) -> Result<(), FleetError> {
        let mut result = Ok(());
        self.is_ending = true;
        for role in self.roles() {
            self.children.close(role);
        }
        self.children.update_clock();
        let deadline = self.children.now() + self.config.limits.shutdown;
        while self.children.now() < deadline
            && self.roles().iter().any(|&role| !self.member(role).is_vacant())
        {
            match self.children.next_event(TICK) {
                Some(SupervisorEvent::Child(role, ChildOutput::Closed)) => self.wait_for_exit(role),
                Some(SupervisorEvent::Child(role, output)) if result.is_ok() => {
                    result = self.on_output(role, output);
                }
                Some(SupervisorEvent::Child(..)) | None => {}
                Some(SupervisorEvent::Stop) => break,
            }
        }
        for role in self.roles() {
            self.children.kill(role);
            self.wait_for_exit(role);
        }
        result
    }

    fn on_output(&mut self, role: MemberRole, output: ChildOutput) -> Result<(), FleetError> {
        let now = self.children.now();
        self.member(role).on_output(now);
        match output {
            ChildOutput::Closed => self.restart(role),
            ChildOutput::Log(line) => {
                self.member(role).on_log(&line);
                let line = format!("{}: {line}", self.name(role));
                self.log(&line)
            }
            ChildOutput::Event(line) => {
                let handled = match role {
                    MemberRole::Sim => serde_json::from_str(&line).map(|event| self.on_sim_event(event)),
                    MemberRole::Host(lane) => {
                        serde_json::from_str(&line).map(|event| self.on_host_event(lane, event))
                    }
                };
                handled.unwrap_or_else(|error| {
                    let line = format!("ignored invalid output of {} ({error}): {line}", self.name(role));
                    self.log(&line)
                })
            }
        }
    }

    fn on_sim_event(&mut self, event: SimEvent) -> Result<(), FleetError> {
        match event {
            SimEvent::Ready { shm_bytes, renderer, identity } => {
                self.totals.shm_bytes = shm_bytes;
                self.totals.renderer = Some(renderer);
                self.check_renderer(identity)?;
                self.sim.on_ready(self.children.now());
                self.children.watch_files(true);
                self.send_state_to_sim();
                Ok(())
            }
            SimEvent::Finished(outcome) => self.on_episode_finished(&outcome),
            SimEvent::Progress(counters) => {
                self.totals.on_sim_counters(counters);
                self.measure_memory();
                self.tune();
                self.observer
                    .on_event(&FleetEvent::Counters(&self.totals.sim()))
                    .map_err(FleetError::Observer)
            }
            SimEvent::Spans(spans) => self.report_spans(MemberRole::Sim, &spans),
            SimEvent::RendererFailed { message } => Err(FleetError::Renderer(message)),
            SimEvent::LaneFailed { lane, message, is_final } => self.on_lane_failed(lane, message, is_final),
            SimEvent::HostLost { lane } => self.on_host_lost(lane),
            SimEvent::Waiting { held, hosts } => {
                self.on_waiting(&held, &hosts);
                Ok(())
            }
        }
    }

    fn report_spans(&mut self, role: MemberRole, spans: &[TraceSpan]) -> Result<(), FleetError> {
        let name = self.name(role);
        self.observer.on_event(&FleetEvent::Spans(&name, spans)).map_err(FleetError::Observer)
    }

    fn measure_memory(&mut self) {
        let sum = self.sum_over_children(|children, role| children.memory_bytes(role));
        self.totals.memory_bytes = self.totals.memory_bytes.max(sum);
    }

    /// Adjusts the number of envs to the costs so far, as long as there are episodes that wait for one.
    fn tune(&mut self) {
        if self.tuner.is_none() || self.pending.is_empty() {
            return;
        }
        let cpu_s = self.sum_over_children(|children, role| children.cpu_s(role));
        let idle_s = self.children.idle_core_s();
        let sample = WorkSample::new(self.children.now(), cpu_s, idle_s, &self.totals);
        if let Some(count) = self.tuner.as_mut().and_then(|tuner| tuner.on_work(sample)) {
            self.send_to_sim(&SimCommand::Envs { count });
        }
    }

    /// Checks that all sims of a run, and earlier runs with the same results file, render the same bits.
    fn check_renderer(&mut self, now: String) -> Result<(), FleetError> {
        if let Some(earlier) = self.totals.renderer_identity.take_if(|earlier| *earlier != now) {
            return Err(FleetError::RendererChanged { earlier, now });
        }
        self.observer.on_event(&FleetEvent::RendererReady(&now)).map_err(FleetError::Observer)?;
        self.totals.renderer_identity = Some(now);
        Ok(())
    }

    fn on_host_event(&mut self, lane: u32, event: HostEvent) -> Result<(), FleetError> {
        match event {
            HostEvent::Ready { .. } => {
                let now = self.children.now();
                self.member(MemberRole::Host(lane)).on_ready(now);
                self.send_to_sim(&SimCommand::HostUp { lane });
                Ok(())
            }
            HostEvent::Note { message } => {
                let line = format!("{}: {message}", self.name(MemberRole::Host(lane)));
                self.log(&line)
            }
            HostEvent::Ledger { queries, batches, busy_s, cpu_s, device_s, flop } => {
                let work = HostWork { queries, batches, busy_s, cpu_s, device_s, flop };
                self.totals.on_host_work(lane, work);
                Ok(())
            }
            HostEvent::Spans(spans) => self.report_spans(MemberRole::Host(lane), &spans),
            HostEvent::Failed { message } => {
                let line = format!("{} failed to answer: {message}", self.name(MemberRole::Host(lane)));
                self.log(&line)
            }
        }
    }

    fn assign_jobs(&mut self) {
        while self.sim.is_up() {
            let (envs, observer) = (self.envs() as usize, &mut *self.observer);
            let Some(job) = self.pending.next(envs, &mut |job| observer.is_wanted(job)) else { return };
            let id = self.next_id;
            self.next_id += 1;
            self.outstanding.insert(id, job);
            self.send_to_sim(&SimCommand::Run(job.assignment(id)));
        }
    }

    fn on_episode_finished(&mut self, outcome: &Outcome) -> Result<(), FleetError> {
        let Some(job) = self.outstanding.remove(&outcome.id) else {
            return self.log(&format!("ignored a second outcome of episode {}", outcome.id));
        };
        self.pending.on_finished(job.driver);
        self.sim.reset_failures();
        if let Driver::Lane(lane) = job.driver {
            self.hosts[lane as usize].reset_failures();
        }
        self.observer.on_event(&FleetEvent::EpisodeFinished(&job, outcome)).map_err(FleetError::Observer)
    }
}
