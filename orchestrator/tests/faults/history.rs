//! The history of a simulated run, and the rules that hold at every moment of it.
//!
//! It sees what the supervisor receives and does, but not its state. A rule that is broken ends the test.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::os::unix::process::ExitStatusExt;
use std::time::Duration;

use sim::serve::protocol::{Assignment, Counters, Driver, Outcome, SimCommand, SimEvent};

use super::super::{FleetEvent, SupervisorEvent};
use super::child::FakeChild;
use super::reactions::SupervisorTurn;
use super::scenario::FaultScenario;
use super::sim::outcome;
use crate::fleet::processes::member::MemberRole;
use crate::fleet::processes::process::ChildOutput;
use crate::plan::jobs::Job;

/// Number of log lines that a failed test shows.
const TAIL: usize = 60;
/// Signal of a process that has used all its core-seconds.
const SIGXCPU: i32 = 24;
/// Start of the error of an episode whose policy was given up.
const GIVEN_UP: &str = "the policy was given up: ";

/// The content of a line, as far as the rules depend on it.
#[derive(Clone, Debug)]
pub(crate) enum Meaning {
    Other,
    /// A report without consequences, which is not logged.
    Quiet,
    Closed,
    /// With the renderer's identity.
    SimReady(String),
    HostReady,
    LaneFailed {
        lane: u32,
        is_final: bool,
    },
    HostLost(u32),
    RendererFailed,
    Waiting {
        held: Vec<u64>,
        hosts: Vec<bool>,
    },
}

/// Causes of a run's end that are not failures of a child.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum EndCause {
    DiskFull,
    SpawnFailed,
    Intruder,
    Shortage,
    Vanished,
    RendererFailed,
    RendererChanged,
    Stop,
}

/// The children of one role so far.
#[derive(Debug, Default)]
pub(crate) struct RoleHistory {
    pub(crate) n_spawns: u32,
    /// `true` while a child is ready, as far as the supervisor knows.
    pub(crate) is_up: bool,
    /// Time of the supervisor's clock from which its timeouts count.
    active: Duration,
    /// Times of its failures since its last finished episode: exits, or failures of a foreign host.
    failures: Vec<Duration>,
    /// Times at which a foreign host has left since then.
    departures: Vec<Duration>,
}

/// Everything that has happened in a run.
pub(crate) struct RunHistory<'a> {
    pub(crate) scenario: &'a FaultScenario,
    pub(crate) log: VecDeque<String>,
    /// Virtual time.
    pub(crate) time: Duration,
    pub(crate) roles: BTreeMap<MemberRole, RoleHistory>,
    /// Job of each assignment id.
    pub(crate) assigned: BTreeMap<u64, usize>,
    /// By job: `true` once its outcome is recorded.
    pub(crate) recorded: Vec<bool>,
    pub(crate) given_up: BTreeSet<u32>,
    /// Roles that have failed too often, or for a reason that the user can fix.
    pub(crate) failed: BTreeSet<MemberRole>,
    pub(crate) causes: BTreeSet<EndCause>,
    pub(crate) turn: SupervisorTurn,
    renderer: Option<String>,
    /// Virtual time in which the supervisor could do nothing.
    pub(crate) pauses: Duration,
    n_reports: u64,
    pub(crate) n_runs: u32,
    pub(crate) n_kills: u32,
    pub(crate) n_restarts: u32,
    /// Control steps and queries of the sim so far, and the time of the supervisor's clock at which it was
    /// told.
    work: (u64, u64),
    work_at: Duration,
    /// Number of times that the kernel has killed a child for lack of memory.
    pub(crate) n_oom_kills: u32,
    /// `true` while the memory of an exited child has not been freed.
    pub(crate) has_garbage: bool,
    /// Virtual time and the supervisor's at which the children were asked to exit.
    pub(crate) shutdown: Option<(Duration, Duration)>,
    /// `true` once a stop is requested during the shutdown.
    pub(crate) is_impatient: bool,
}

impl Meaning {
    pub(crate) fn of(event: SimEvent) -> Self {
        match event {
            SimEvent::Ready { identity, .. } => Self::SimReady(identity),
            SimEvent::LaneFailed { lane, is_final, .. } => Self::LaneFailed { lane, is_final },
            SimEvent::HostLost { lane } => Self::HostLost(lane),
            SimEvent::RendererFailed { .. } => Self::RendererFailed,
            SimEvent::Waiting { held, hosts } => Self::Waiting { held, hosts },
            SimEvent::Progress(_) => Self::Quiet,
            SimEvent::Finished(_) | SimEvent::Spans(_) => Self::Other,
        }
    }
}

impl<'a> RunHistory<'a> {
    pub(crate) fn new(scenario: &'a FaultScenario) -> Self {
        Self {
            scenario,
            log: VecDeque::new(),
            time: Duration::ZERO,
            roles: BTreeMap::new(),
            assigned: BTreeMap::new(),
            recorded: vec![false; scenario.jobs.len()],
            given_up: BTreeSet::new(),
            failed: BTreeSet::new(),
            causes: BTreeSet::new(),
            turn: SupervisorTurn::default(),
            renderer: scenario.config.earlier_renderer.clone(),
            pauses: Duration::ZERO,
            n_reports: 0,
            n_runs: 0,
            n_kills: 0,
            n_restarts: 0,
            work: (0, 0),
            work_at: Duration::ZERO,
            n_oom_kills: 0,
            has_garbage: false,
            shutdown: None,
            is_impatient: false,
        }
    }

    pub(crate) fn record(&mut self, text: impl FnOnce() -> String) {
        self.log.push_back(format!("{:9.4} {}", self.time.as_secs_f64(), text()));
    }

    /// Returns the last lines of the log.
    pub(crate) fn tail(&self) -> String {
        let start = self.log.len().saturating_sub(TAIL);
        self.log.range(start..).cloned().collect::<Vec<_>>().join("\n")
    }

    pub(crate) fn role(&mut self, role: MemberRole) -> &mut RoleHistory {
        self.roles.entry(role).or_default()
    }

    pub(crate) fn is_up(&self, role: MemberRole) -> bool {
        self.roles.get(&role).is_some_and(|role| role.is_up)
    }

    pub(crate) fn is_foreign(&self, lane: u32) -> bool {
        self.scenario.config.lanes[lane as usize].lane.foreign
    }

    pub(crate) fn on_spawn_error(&mut self) {
        self.record(|| "a spawn fails".to_owned());
        self.causes.insert(EndCause::SpawnFailed);
    }

    pub(crate) fn on_spawn(&mut self, role: MemberRole, clock: Duration) {
        self.record(|| format!("{role:?} is spawned"));
        assert!(self.shutdown.is_none(), "{role:?} was spawned after the end of the run");
        assert!(!self.failed.contains(&role), "{role:?} was spawned again although it fails too often");
        assert!(!self.has_garbage, "the memory of an exited child was not freed");
        let state = self.role(role);
        state.n_spawns += 1;
        (state.is_up, state.active) = (false, clock);
    }

    /// Returns the time within which the failures of a role count together.
    fn window(&self, role: MemberRole) -> Duration {
        let limits = self.scenario.config.limits;
        let longest = match role {
            MemberRole::Sim => limits.sim_start + limits.silence,
            MemberRole::Host(lane) => {
                let seconds = self.scenario.config.lanes[lane as usize].lane.answer_timeout_s;
                limits.host_start + Duration::from_secs(seconds.into())
            }
        };
        longest * limits.failures
    }

    pub(crate) fn on_exit(&mut self, role: MemberRole, child: &FakeChild, clock: Duration) {
        self.record(|| format!("{role:?} is waited for"));
        self.role(role).is_up = false;
        if self.shutdown.is_some() {
            return;
        }
        self.n_restarts += 1;
        self.has_garbage = true;
        let (limit, window) = (self.scenario.config.limits.failures, self.window(role));
        let state = self.role(role);
        state.failures.push(clock);
        let is_out_of_time = child.status.and_then(|status| status.signal()) == Some(SIGXCPU);
        if child.has_user_error || is_out_of_time || n_within(&state.failures, clock, window) >= limit {
            self.failed.insert(role);
        }
    }

    pub(crate) fn on_shutdown(&mut self, clock: Duration) {
        self.shutdown.get_or_insert((self.time, clock));
    }

    pub(crate) fn on_intruder(&mut self) {
        self.causes.insert(EndCause::Intruder);
    }

    pub(crate) fn on_lost_file(&mut self) {
        self.causes.insert(EndCause::Vanished);
    }

    pub(crate) fn on_shortage(&mut self) {
        self.causes.insert(EndCause::Shortage);
    }

    /// Checks that a child that is killed has exceeded a timeout, or that its lane has failed.
    pub(crate) fn on_kill(&mut self, role: MemberRole, clock: Duration) {
        self.record(|| format!("{role:?} is killed"));
        self.n_kills += 1;
        let limits = self.scenario.config.limits;
        let work_at = self.work_at;
        let is_over = self.shutdown.is_some_and(|(_, since)| clock - since >= limits.shutdown);
        let state = self.role(role);
        let timeout = match (role, state.is_up) {
            (MemberRole::Sim, false) => Some(limits.sim_start),
            (MemberRole::Sim, true) => Some(limits.silence),
            (MemberRole::Host(_), false) => Some(limits.host_start),
            (MemberRole::Host(_), true) => None,
        };
        let is_timed_out = timeout.is_some_and(|timeout| clock - state.active > timeout)
            || (role == MemberRole::Sim && state.is_up && clock - work_at > limits.silence);
        state.active = clock;
        let lane_failed = |lane| role == MemberRole::Host(lane);
        let has_failed =
            matches!(self.turn.event, Some((_, Meaning::LaneFailed { lane, .. })) if lane_failed(lane));
        let is_due = is_over || self.is_impatient || is_timed_out || has_failed;
        assert!(is_due, "{role:?} was killed for no reason");
    }

    /// Records an event that the supervisor receives.
    pub(crate) fn on_event(&mut self, event: &SupervisorEvent, meaning: Meaning, clock: Duration) {
        let SupervisorEvent::Child(role, output) = event else {
            self.record(|| "a stop is requested".to_owned());
            self.causes.insert(EndCause::Stop);
            self.is_impatient |= self.shutdown.is_some();
            return;
        };
        let role = *role;
        if !matches!(meaning, Meaning::Quiet) {
            self.record(|| match output {
                ChildOutput::Event(line) => format!("{role:?} -> {line}"),
                other => format!("{role:?} -> {other:?}"),
            });
        }
        if self.is_up(role) {
            self.role(role).active = clock;
        }
        if let ChildOutput::Event(line) = output
            && let Ok(SimEvent::Progress(Counters { env_steps, queries, .. })) = serde_json::from_str(line)
            && self.work != (env_steps, queries)
            && env_steps + queries > 0
        {
            (self.work, self.work_at) = ((env_steps, queries), clock);
        }
        match &meaning {
            Meaning::SimReady(_) | Meaning::HostReady => {
                let state = self.role(role);
                (state.is_up, state.active) = (true, clock);
            }
            Meaning::Closed => self.role(role).is_up = false,
            Meaning::LaneFailed { lane, is_final } => {
                self.on_lane_failed(*lane, *is_final, clock);
            }
            Meaning::HostLost(lane) => {
                let role = MemberRole::Host(*lane);
                let (limit, window) = (self.scenario.config.limits.departures, self.window(role));
                let departures = &mut self.role(role).departures;
                departures.push(clock);
                if n_within(departures, clock, window) >= limit {
                    self.failed.insert(role);
                }
            }
            Meaning::RendererFailed => {
                self.causes.insert(EndCause::RendererFailed);
            }
            Meaning::Other | Meaning::Quiet | Meaning::Waiting { .. } => {}
        }
        if let Meaning::SimReady(identity) = &meaning
            && *self.renderer.get_or_insert_with(|| identity.clone()) != *identity
        {
            self.causes.insert(EndCause::RendererChanged);
        }
        self.turn.event = Some((role, meaning));
    }

    /// The failure of a foreign host counts at once, that of another one when it exits.
    fn on_lane_failed(&mut self, lane: u32, is_final: bool, clock: Duration) {
        let role = MemberRole::Host(lane);
        let (limit, window) = (self.scenario.config.limits.failures, self.window(role));
        if self.is_foreign(lane) && !self.given_up.contains(&lane) {
            let failures = &mut self.role(role).failures;
            failures.push(clock);
            if is_final || n_within(failures, clock, window) >= limit {
                self.failed.insert(role);
            }
        }
    }

    /// Records a command to the sim.
    pub(crate) fn on_command(&mut self, command: &SimCommand) {
        self.record(|| format!("Sim <- {}", serde_json::json!(command)));
        assert!(
            self.is_up(MemberRole::Sim) || self.shutdown.is_some(),
            "a sim that is not ready got a command"
        );
        if let SimCommand::Run(assignment) = command {
            self.n_runs += 1;
            self.on_assignment(assignment);
        }
        self.turn.commands.push(command.clone());
    }

    fn on_assignment(&mut self, assignment: &Assignment) {
        let jobs = &self.scenario.jobs;
        let job = jobs.iter().position(|job| job.assignment(assignment.id) == *assignment);
        let job = job.expect("every assigned episode is a job");
        assert!(self.scenario.is_wanted(&jobs[job]), "job {job} is not wanted");
        assert!(!self.recorded[job], "job {job} was assigned although its outcome is recorded");
        if let Driver::Lane(lane) = assignment.driver {
            assert!(!self.given_up.contains(&lane), "job {job} of a given-up policy was assigned");
        }
        assert!(
            self.assigned.iter().all(|(id, other)| (*id == assignment.id) == (*other == job)),
            "job {job} and id {} belong together",
            assignment.id
        );
        if self.assigned.insert(assignment.id, job).is_none() {
            self.turn.assigned.push(assignment.id);
        }
    }

    /// Receives a report of the supervisor. Returns an error if the disk is full.
    pub(crate) fn on_report(&mut self, report: &FleetEvent<'_>) -> anyhow::Result<()> {
        self.n_reports += 1;
        if self.scenario.disk_full_after.is_some_and(|limit| self.n_reports > limit) {
            self.causes.insert(EndCause::DiskFull);
            anyhow::bail!("the disk is full");
        }
        match report {
            FleetEvent::EpisodeFinished(job, outcome) => self.on_outcome(job, outcome),
            FleetEvent::Log(line) => {
                self.record(|| (*line).to_owned());
                if let Some((_, policy)) = line.split_once("gave up policy `p") {
                    let digits: String = policy.chars().take_while(char::is_ascii_digit).collect();
                    self.on_given_up(digits.parse().unwrap());
                }
            }
            FleetEvent::Counters(_) | FleetEvent::RendererReady(_) | FleetEvent::Spans(..) => {}
        }
        Ok(())
    }

    fn on_given_up(&mut self, lane: u32) {
        assert!(self.failed.contains(&MemberRole::Host(lane)), "policy p{lane} was given up too early");
        assert!(self.drivers().len() > 1, "the only policy was given up");
        assert!(self.given_up.insert(lane), "policy p{lane} was given up twice");
    }

    fn on_outcome(&mut self, job: &Job, found: &Outcome) {
        let idx = self.scenario.jobs.iter().position(|other| other == job).expect("the job is known");
        self.record(|| format!("job {idx} is recorded"));
        assert!(!self.recorded[idx], "job {idx} was recorded twice");
        assert!(self.scenario.is_wanted(job), "job {idx} is not wanted");
        self.recorded[idx] = true;
        if found.error.as_ref().is_some_and(|error| error.starts_with(GIVEN_UP)) {
            let Driver::Lane(lane) = job.driver else { panic!("the expert was given up") };
            assert!(self.given_up.contains(&lane), "policy p{lane} was not given up");
            return;
        }
        assert_eq!(self.assigned.get(&found.id), Some(&idx), "the outcome belongs to another job");
        assert_eq!(*found, outcome(&job.assignment(found.id)), "the outcome is wrong");
        let lane = if let Driver::Lane(lane) = job.driver { Some(MemberRole::Host(lane)) } else { None };
        for role in std::iter::once(MemberRole::Sim).chain(lane) {
            let state = self.role(role);
            state.failures.clear();
            state.departures.clear();
        }
    }

    /// Returns the drivers of all jobs.
    pub(crate) fn drivers(&self) -> Vec<Driver> {
        let mut drivers: Vec<Driver> = Vec::new();
        for job in &self.scenario.jobs {
            if !drivers.contains(&job.driver) {
                drivers.push(job.driver);
            }
        }
        drivers
    }
}

/// Returns the number of times within the last `window`.
fn n_within(times: &[Duration], now: Duration, window: Duration) -> u32 {
    times.iter().filter(|time| now - **time <= window).count() as u32
}
