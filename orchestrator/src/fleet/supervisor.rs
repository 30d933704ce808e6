//! The loop: one event after another until all episodes are finished, or it is known why they cannot be.

use std::collections::{BTreeMap, VecDeque};
use std::sync::mpsc::{Receiver, Sender};
use std::time::Duration;

use ipc_types::link::Domain;
use policy_host::PolicySpec;
use policy_host::serve::{HostConfig, HostEvent};
use sim::serve::protocol::{Driver, Outcome, SimCommand, SimConfig, SimEvent};

use super::clock::Clock;
use super::error::FleetError;
use super::member::{Member, Place};
use super::process::{Process, Said};
use super::totals::{HostWork, Totals};
use super::{Conclusion, Event, Happening, Settings, Sink, folder};
use crate::work::Job;

/// Longest wait for an event before patience is looked at.
const TICK: Duration = Duration::from_millis(200);
/// Episodes given to the sim ahead of time, per env: enough that an env never waits for the orchestrator.
const JOBS_PER_ENV: usize = 2;

pub(super) struct Supervisor<'a> {
    settings: &'a Settings,
    domain: &'a Domain,
    events: Sender<Event>,
    inbox: Receiver<Event>,
    clock: Clock,
    sim: Member,
    /// By lane; the place of a foreign host stays empty.
    hosts: Vec<Member>,
    pending: VecDeque<Job>,
    /// Given to the sim, by number.
    outstanding: BTreeMap<u64, Job>,
    next_id: u64,
    totals: Totals,
    sink: &'a mut Sink<'a>,
}

impl<'a> Supervisor<'a> {
    pub(super) fn new(
        settings: &'a Settings,
        domain: &'a Domain,
        events: Sender<Event>,
        inbox: Receiver<Event>,
        jobs: Vec<Job>,
        sink: &'a mut Sink<'a>,
    ) -> Self {
        let n_lanes = settings.lanes.len();
        Self {
            settings,
            domain,
            events,
            inbox,
            clock: Clock::new(),
            sim: Member::default(),
            hosts: std::iter::repeat_with(Member::default).take(n_lanes).collect(),
            pending: jobs.into(),
            outstanding: BTreeMap::new(),
            next_id: 0,
            totals: Totals::new(n_lanes, settings.drawn_with.clone()),
            sink,
        }
    }

    /// Starts the children and works until all episodes are finished or somebody wants to stop.
    pub(super) fn work(&mut self) -> Result<Conclusion, FleetError> {
        self.invite_foreign_hosts()?;
        self.start(Place::Sim)?;
        for lane in self.hosted_lanes() {
            self.start(Place::Host(lane))?;
        }
        while !(self.pending.is_empty() && self.outstanding.is_empty()) {
            self.feed();
            match self.next_event() {
                Some(Event::Child(place, said)) => self.hear(place, said)?,
                Some(Event::Stop) => return Ok(Conclusion::Stopped),
                None => {}
            }
            self.look_after()?;
        }
        Ok(Conclusion::Complete)
    }

    /// Asks all children to leave and kills those that do not, or all at once if somebody wants to stop. Episodes that
    /// are finished meanwhile count.
    pub(super) fn close(&mut self) -> Result<(), FleetError> {
        let mut result = Ok(());
        for place in self.places() {
            if let Some(process) = self.member(place).process() {
                process.close();
            }
        }
        self.clock.look();
        let deadline = self.clock.now() + self.settings.limits.leave;
        while self.clock.now() < deadline && self.places().iter().any(|&place| !self.member(place).is_empty())
        {
            match self.next_event() {
                Some(Event::Child(place, Said::Closed)) => self.dismiss(place),
                Some(Event::Child(place, said)) if result.is_ok() => result = self.hear(place, said),
                Some(Event::Child(..)) | None => {}
                Some(Event::Stop) => break,
            }
        }
        for place in self.places() {
            if let Some(process) = self.member(place).process() {
                process.kill();
            }
            self.dismiss(place);
        }
        result
    }

    pub(super) fn into_totals(self) -> Totals {
        self.totals
    }

    fn next_event(&mut self) -> Option<Event> {
        let event = self.inbox.recv_timeout(TICK).ok();
        self.clock.look();
        event
    }

    fn start(&mut self, place: Place) -> Result<(), FleetError> {
        let (subcommand, config) = match place {
            Place::Sim => ("sim", serde_json::json!(self.sim_config())),
            Place::Host(lane) => ("policy-host", serde_json::json!(self.host_config(lane))),
        };
        let events = self.events.clone();
        let hear = move |said| {
            // The loop is gone only when the children are to be, too.
            let _ = events.send(Event::Child(place, said));
        };
        let program = &self.settings.program;
        let process = Process::spawn(program, subcommand, &config.to_string(), hear).map_err(|source| {
            FleetError::Spawn { name: self.name(place), program: program.clone(), source }
        })?;
        let now = self.clock.now();
        self.member(place).started(process, now);
        Ok(())
    }

    fn hear(&mut self, place: Place, said: Said) -> Result<(), FleetError> {
        let now = self.clock.now();
        self.member(place).heard(now);
        match said {
            Said::Closed => self.replace(place),
            Said::Log(line) => {
                self.member(place).logged(&line);
                let line = format!("{}: {line}", self.name(place));
                self.log(&line)
            }
            Said::Event(line) => {
                let understood = match place {
                    Place::Sim => serde_json::from_str(&line).map(|event| self.hear_sim(event)),
                    Place::Host(lane) => serde_json::from_str(&line).map(|event| self.hear_host(lane, event)),
                };
                understood.unwrap_or_else(|error| {
                    let line = format!("{} said what is no event ({error}): {line}", self.name(place));
                    self.log(&line)
                })
            }
        }
    }

    fn hear_sim(&mut self, event: SimEvent) -> Result<(), FleetError> {
        match event {
            SimEvent::Ready { shm_bytes, renderer, identity } => {
                self.totals.shm_bytes = shm_bytes;
                self.totals.renderer = Some(renderer);
                self.draw_with(identity)?;
                self.sim.ready(self.clock.now());
                self.brief_sim();
                Ok(())
            }
            SimEvent::Finished(outcome) => self.finish(&outcome),
            SimEvent::Progress(counters) => {
                self.totals.sim_reports(counters);
                (self.sink)(Happening::Counters(&self.totals.sim())).map_err(FleetError::Sink)
            }
            SimEvent::RendererFailed { message } => Err(FleetError::Renderer(message)),
            SimEvent::LaneFailed { lane, message } => self.lane_failed(lane, message),
        }
    }

    /// All sims of a run draw the same bits.
    fn draw_with(&mut self, now: String) -> Result<(), FleetError> {
        if let Some(before) = self.totals.drawn_with.take_if(|before| *before != now) {
            return Err(FleetError::OtherRenderer { before, now });
        }
        (self.sink)(Happening::Drawing(&now)).map_err(FleetError::Sink)?;
        self.totals.drawn_with = Some(now);
        Ok(())
    }

    fn hear_host(&mut self, lane: u32, event: HostEvent) -> Result<(), FleetError> {
        match event {
            HostEvent::Ready { .. } => {
                let now = self.clock.now();
                self.member(Place::Host(lane)).ready(now);
                self.tell_sim(&SimCommand::HostUp { lane });
                Ok(())
            }
            HostEvent::Ledger { queries, batches, busy_s } => {
                self.totals.host_reports(lane, HostWork { queries, batches, busy_s });
                Ok(())
            }
            HostEvent::Failed { message } => {
                let line = format!("{} could not answer: {message}", self.name(Place::Host(lane)));
                self.log(&line)
            }
        }
    }

    /// A host that does not answer, or answers what was not asked: one of ours is killed, and replaced when its death is
    /// heard; a foreign one is its owner's affair.
    fn lane_failed(&mut self, lane: u32, message: String) -> Result<(), FleetError> {
        if self.settings.lanes[lane as usize].lane.foreign {
            return Err(FleetError::Lane(message));
        }
        let host = self.member(Place::Host(lane));
        host.logged(&message);
        if host.is_up()
            && let Some(process) = host.process()
        {
            process.kill();
        }
        self.log(&format!("{message}; killed its host"))
    }

    /// Tells a sim that has just got ready who is there and what is to be done.
    fn brief_sim(&mut self) {
        for (lane, policy) in (0..).zip(&self.settings.lanes) {
            if policy.lane.foreign || self.hosts[lane as usize].is_up() {
                self.tell_sim(&SimCommand::HostUp { lane });
            }
        }
        let unfinished: Vec<_> = self.outstanding.iter().map(|(&id, job)| job.assignment(id)).collect();
        for assignment in unfinished {
            self.tell_sim(&SimCommand::Run(assignment));
        }
    }

    fn feed(&mut self) {
        let room = JOBS_PER_ENV * self.settings.config.resources.envs as usize;
        while self.sim.is_up() && self.outstanding.len() < room {
            let Some(job) = self.pending.pop_front() else { return };
            let id = self.next_id;
            self.next_id += 1;
            self.outstanding.insert(id, job);
            self.tell_sim(&SimCommand::Run(job.assignment(id)));
        }
    }

    fn finish(&mut self, outcome: &Outcome) -> Result<(), FleetError> {
        let Some(job) = self.outstanding.remove(&outcome.id) else {
            return self.log(&format!("the sim finished episode {} again; ignored", outcome.id));
        };
        self.sim.forgive();
        if let Driver::Lane(lane) = job.driver {
            self.hosts[lane as usize].forgive();
        }
        (self.sink)(Happening::Finished(&job, outcome)).map_err(FleetError::Sink)
    }

    /// A child is gone: cleans up after it and starts another in its place, unless that has been tried too often.
    fn replace(&mut self, place: Place) -> Result<(), FleetError> {
        let Settings { limits, .. } = self.settings;
        let Some(death) = self.member(place).bury(limits.leave) else { return Ok(()) };
        let _n_cleaned = self.domain.reap();
        let (name, deaths, log) = (self.name(place), self.member(place).deaths(), self.member(place).log());
        if deaths >= limits.deaths {
            return Err(FleetError::GaveUp { name, deaths, death, log });
        }
        match place {
            Place::Sim => self.totals.sim_died(),
            Place::Host(lane) => {
                self.totals.host_died(lane);
                self.tell_sim(&SimCommand::HostDown { lane });
            }
        }
        self.log(&format!("{name} {death}; starting it again"))?;
        self.start(place)
    }

    /// A child leaves as it was asked to.
    fn dismiss(&mut self, place: Place) {
        let leave = self.settings.limits.leave;
        if let Some(process) = self.member(place).take() {
            // How it ends is its own affair now.
            let _ = process.wait(leave);
        }
    }

    /// Kills a sim that hangs; gives up on children that never get ready. Whether a host hangs the sim can tell better: it
    /// knows what it has asked.
    fn look_after(&mut self) -> Result<(), FleetError> {
        let (now, limits) = (self.clock.now(), self.settings.limits);
        for place in self.places() {
            let patience = if place == Place::Sim { limits.sim_start } else { limits.host_start };
            let member = self.member(place);
            if member.starting_for(now).is_some_and(|time| time > patience) {
                let log = member.log();
                return Err(FleetError::StartUp { name: self.name(place), patience, log });
            }
        }
        if self.sim.silent_for(now).is_some_and(|time| time > limits.silence) {
            self.sim.heard(now);
            if let Some(process) = self.sim.process() {
                process.kill();
            }
            let line = format!("the sim said nothing for {} s; killed it", limits.silence.as_secs());
            self.sim.logged(&line);
            return self.log(&line);
        }
        Ok(())
    }

    fn invite_foreign_hosts(&mut self) -> Result<(), FleetError> {
        let Settings { lanes, morphologies, run_id, config, .. } = self.settings;
        for policy in lanes {
            if let PolicySpec::Attach(name) = &policy.spec {
                let path =
                    folder::invite(self.domain, *run_id, name, &policy.lane, morphologies, &config.results)?;
                let policy = &policy.lane.spec.policy;
                let line =
                    format!("policy `{policy}` waits for a foreign host; its lane is in {}", path.display());
                self.log(&line)?;
            }
        }
        Ok(())
    }

    fn sim_config(&self) -> SimConfig {
        let settings = self.settings;
        SimConfig {
            domain: self.domain.clone(),
            run_id: settings.run_id,
            lanes: settings.lanes.iter().map(|policy| policy.lane.clone()).collect(),
            run: settings.config,
        }
    }

    fn host_config(&self, lane: u32) -> HostConfig {
        let settings = self.settings;
        let policy = &settings.lanes[lane as usize];
        HostConfig {
            domain: self.domain.clone(),
            run_id: settings.run_id,
            lane: policy.lane.spec.clone(),
            spec: policy.spec.clone(),
            run: settings.config,
        }
    }

    /// A sim that is not up is told when it is.
    fn tell_sim(&mut self, command: &SimCommand) {
        if self.sim.is_up()
            && let Some(process) = self.sim.process()
        {
            process.send(serde_json::json!(command).to_string());
        }
    }

    fn log(&mut self, line: &str) -> Result<(), FleetError> {
        (self.sink)(Happening::Log(line)).map_err(FleetError::Sink)
    }

    fn name(&self, place: Place) -> String {
        match place {
            Place::Sim => "sim".to_owned(),
            Place::Host(lane) => {
                format!("host of `{}`", self.settings.lanes[lane as usize].lane.spec.policy)
            }
        }
    }

    fn member(&mut self, place: Place) -> &mut Member {
        match place {
            Place::Sim => &mut self.sim,
            Place::Host(lane) => &mut self.hosts[lane as usize],
        }
    }

    fn hosted_lanes(&self) -> Vec<u32> {
        let lanes = (0..).zip(&self.settings.lanes);
        lanes.filter(|(_, policy)| policy.spec.hosted()).map(|(lane, _)| lane).collect()
    }

    fn places(&self) -> Vec<Place> {
        let hosts = self.hosted_lanes().into_iter().map(Place::Host);
        std::iter::once(Place::Sim).chain(hosts).collect()
    }
}
