//! The supervisor's loop: handles one event after another until all episodes are finished or the run has to
//! end.

mod exits;
mod policies;
mod timeouts;

use std::collections::BTreeMap;
use std::iter::Sum;
use std::time::Duration;

use ipc_types::link::Domain;
use ipc_types::trace::TraceSpan;
use policy_host::serve::HostEvent;
use sim::serve::protocol::{Driver, Outcome, SimCommand, SimEvent};

use self::policies::Unconfirmed;
use self::timeouts::WorkWatch;
use super::children::Children;
use super::error::FleetError;
use super::member::{Member, MemberRole};
use super::process::ChildOutput;
use super::queue::JobQueue;
use super::totals::{HostWork, Totals};
use super::tuner::{EnvTuner, WorkSample};
use super::{FleetConfig, FleetEvent, PolicyLane, RunStatus, Sink, SupervisorEvent};
use crate::jobs::Job;

/// Maximum wait for an event before timeouts are checked.
const TICK: Duration = Duration::from_millis(200);

pub(crate) struct Supervisor<'a> {
    config: &'a FleetConfig,
    domain: &'a Domain,
    children: &'a mut dyn Children,
    sim: Member,
    /// By lane; the member of a foreign host stays vacant.
    hosts: Vec<Member>,
    pending: JobQueue<'a>,
    /// Jobs assigned to the sim, by assignment id.
    outstanding: BTreeMap<u64, Job>,
    next_id: u64,
    /// Commands that the sim's last report lacked. What the next one lacks, too, is sent again.
    unconfirmed: Unconfirmed,
    /// By lane: `true` once its policy has failed too often.
    given_up: Vec<bool>,
    /// Chooses the number of envs, unless the user fixed it.
    tuner: Option<EnvTuner>,
    totals: Totals,
    progress: WorkWatch,
    /// Processes that the kernel had killed for lack of memory before, and children that it has killed since.
    oom_kills: u64,
    sink: &'a mut Sink<'a>,
}

impl<'a> Supervisor<'a> {
    pub(crate) fn new(
        config: &'a FleetConfig,
        domain: &'a Domain,
        children: &'a mut dyn Children,
        pending: JobQueue<'a>,
        sink: &'a mut Sink<'a>,
    ) -> Self {
        let (n_lanes, capacity, n_cores) = (config.lanes.len(), config.capacity, children.n_cores());
        let mut totals = Totals::new(n_lanes, config.earlier_renderer.clone());
        let oom_kills = children.oom_kills();
        let foreign = |policy: &PolicyLane| policy.lane.foreign.then(|| policy.lane.spec.policy.clone());
        totals.foreign = config.lanes.iter().map(foreign).collect();
        Self {
            config,
            domain,
            children,
            sim: Member::default(),
            hosts: std::iter::repeat_with(Member::default).take(n_lanes).collect(),
            pending,
            outstanding: BTreeMap::new(),
            next_id: 0,
            unconfirmed: Unconfirmed::default(),
            given_up: vec![false; n_lanes],
            tuner: capacity.tunes.then(|| EnvTuner::new(capacity.envs, capacity.max_envs, n_cores)),
            totals,
            progress: WorkWatch::default(),
            oom_kills,
            sink,
        }
    }

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

    fn start(&mut self, role: MemberRole) -> Result<(), FleetError> {
        let config = match role {
            MemberRole::Sim => serde_json::json!(self.config.sim(self.domain, self.envs())),
            MemberRole::Host(lane) => serde_json::json!(self.config.host(self.domain, lane)),
        };
        self.children.spawn(role, &config.to_string()).map_err(|source| FleetError::Spawn {
            name: self.name(role),
            program: self.config.program.clone(),
            source,
        })?;
        let now = self.children.now();
        self.member(role).on_spawn(now);
        if let Some(tuner) = &mut self.tuner {
            tuner.interrupt();
        }
        Ok(())
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
                (self.sink)(FleetEvent::Counters(&self.totals.sim())).map_err(FleetError::Sink)
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
        (self.sink)(FleetEvent::Spans(&name, spans)).map_err(FleetError::Sink)
    }

    fn measure_memory(&mut self) {
        let sum = self.sum_over_children(|children, role| children.memory_bytes(role));
        self.totals.memory_bytes = self.totals.memory_bytes.max(sum);
    }

    /// Sums what the system tells about the children that are alive.
    fn sum_over_children<T: Sum>(&self, of: impl Fn(&dyn Children, MemberRole) -> Option<T>) -> T {
        self.roles().into_iter().filter_map(|role| of(self.children, role)).sum()
    }

    /// Returns the number of episodes in progress at a time.
    fn envs(&self) -> u32 {
        self.tuner.as_ref().map_or(self.config.capacity.envs, |tuner| tuner.choice().envs)
    }

    /// Adjusts the number of envs to the costs so far, as long as there are episodes that wait for one.
    fn tune(&mut self) {
        if self.tuner.is_none() || self.pending.is_empty() {
            return;
        }
        let cpu_s = self.sum_over_children(|children, role| children.cpu_s(role));
        let sample = WorkSample::new(self.children.now(), cpu_s, &self.totals);
        if let Some(count) = self.tuner.as_mut().and_then(|tuner| tuner.on_work(sample)) {
            self.send_to_sim(&SimCommand::Envs { count });
        }
    }

    /// Checks that all sims of a run, and earlier runs with the same results file, render the same bits.
    fn check_renderer(&mut self, now: String) -> Result<(), FleetError> {
        if let Some(earlier) = self.totals.renderer_identity.take_if(|earlier| *earlier != now) {
            return Err(FleetError::RendererChanged { earlier, now });
        }
        (self.sink)(FleetEvent::RendererReady(&now)).map_err(FleetError::Sink)?;
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
            let Some(job) = self.pending.next(self.envs() as usize) else { return };
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
        (self.sink)(FleetEvent::EpisodeFinished(&job, outcome)).map_err(FleetError::Sink)
    }

    /// Sends a command to the sim if it is ready. Otherwise it learns the state when it becomes ready.
    fn send_to_sim(&mut self, command: &SimCommand) {
        if self.sim.is_up() {
            self.children.send(MemberRole::Sim, serde_json::json!(command).to_string());
        }
    }

    fn log(&mut self, line: &str) -> Result<(), FleetError> {
        (self.sink)(FleetEvent::Log(line)).map_err(FleetError::Sink)
    }

    fn name(&self, role: MemberRole) -> String {
        match role {
            MemberRole::Sim => "sim".to_owned(),
            MemberRole::Host(lane) => {
                format!("host of `{}`", self.config.lanes[lane as usize].lane.spec.policy)
            }
        }
    }

    fn member(&mut self, role: MemberRole) -> &mut Member {
        match role {
            MemberRole::Sim => &mut self.sim,
            MemberRole::Host(lane) => &mut self.hosts[lane as usize],
        }
    }

    fn hosted_lanes(&self) -> Vec<u32> {
        let lanes = (0..).zip(&self.config.lanes);
        lanes.filter(|(_, policy)| policy.spec.hosted()).map(|(lane, _)| lane).collect()
    }

    fn roles(&self) -> Vec<MemberRole> {
        let hosts = self.hosted_lanes().into_iter().map(MemberRole::Host);
        std::iter::once(MemberRole::Sim).chain(hosts).collect()
    }
}
