//! The state of the supervisor, and the basic operations of which its reactions consist.

use std::collections::{BTreeMap, BTreeSet};
use std::iter::Sum;
use std::time::Duration;

use ipc_types::link::Domain;
use sim::serve::protocol::{Lane, SimCommand};

use super::super::children::Children;
use super::super::config::FleetConfig;
use super::super::error::FleetError;
use super::super::event::{FleetEvent, Observer};
use super::super::queue::JobQueue;
use crate::fleet::processes::member::{Member, MemberRole};
use crate::fleet::tuning::totals::Totals;
use crate::fleet::tuning::tuner::EnvTuner;
use crate::plan::jobs::Job;
use crate::plan::lanes::PolicyLane;

/// The state of a fleet in progress.
pub(crate) struct Supervisor<'a> {
    pub(crate) config: &'a FleetConfig,
    pub(crate) domain: &'a Domain,
    pub(crate) children: &'a mut dyn Children,
    pub(crate) sim: Member,
    /// By lane; the member of a foreign host stays vacant.
    pub(crate) hosts: Vec<Member>,
    pub(crate) pending: JobQueue,
    /// Jobs assigned to the sim, by assignment id.
    pub(crate) outstanding: BTreeMap<u64, Job>,
    pub(crate) next_id: u64,
    /// Commands that the sim's last report lacked. What the next one lacks, too, is sent again.
    pub(crate) unconfirmed: Unconfirmed,
    /// By lane: `true` once its policy has failed too often.
    pub(crate) given_up: Vec<bool>,
    /// Chooses the number of envs, unless the user fixed it.
    pub(crate) tuner: Option<EnvTuner>,
    pub(crate) totals: Totals,
    pub(crate) progress: WorkWatch,
    /// `true` once the children have been asked to exit.
    pub(crate) is_ending: bool,
    /// Processes that the kernel had killed for lack of memory before, and children that it has killed since.
    pub(crate) oom_kills: u64,
    pub(crate) observer: &'a mut dyn Observer,
}

/// Commands that a report of the sim lacked.
#[derive(Debug, Default)]
pub(crate) struct Unconfirmed {
    /// Ids of the missing episodes.
    pub(crate) episodes: BTreeSet<u64>,
    /// Lanes whose host the sim does not know.
    pub(crate) hosts: BTreeSet<u32>,
}

/// The last sign that work is being done.
#[derive(Debug, Default)]
pub(crate) struct WorkWatch {
    /// Control steps and queries of all children.
    pub(crate) work: u64,
    /// The time at which there was more work than before, or none to be done.
    pub(crate) at: Duration,
}

impl WorkWatch {
    /// Records that something has happened that no work shows.
    pub(crate) fn on_event(&mut self, now: Duration) {
        self.at = now;
    }
}

impl<'a> Supervisor<'a> {
    pub(crate) fn new(
        config: &'a FleetConfig,
        domain: &'a Domain,
        children: &'a mut dyn Children,
        pending: JobQueue,
        observer: &'a mut dyn Observer,
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
            is_ending: false,
            oom_kills,
            observer,
        }
    }

    pub(crate) fn start(&mut self, role: MemberRole) -> Result<(), FleetError> {
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

    /// Sums what the system tells about the children that are alive.
    pub(crate) fn sum_over_children<T: Sum>(&self, of: impl Fn(&dyn Children, MemberRole) -> Option<T>) -> T {
        self.roles().into_iter().filter_map(|role| of(self.children, role)).sum()
    }

    /// Returns the number of episodes in progress at a time.
    pub(crate) fn envs(&self) -> u32 {
        self.tuner.as_ref().map_or(self.config.capacity.envs, |tuner| tuner.choice().envs)
    }

    /// Sends a command to the sim if it is ready. Otherwise it learns the state when it becomes ready.
    pub(crate) fn send_to_sim(&mut self, command: &SimCommand) {
        if self.sim.is_up() {
            self.children.send(MemberRole::Sim, serde_json::json!(command).to_string());
        }
    }

    pub(crate) fn log(&mut self, line: &str) -> Result<(), FleetError> {
        self.observer.on_event(&FleetEvent::Log(line)).map_err(FleetError::Observer)
    }

    pub(crate) fn name(&self, role: MemberRole) -> String {
        match role {
            MemberRole::Sim => "sim".to_owned(),
            MemberRole::Host(lane) => {
                format!("host of `{}`", self.config.lanes[lane as usize].lane.spec.policy)
            }
        }
    }

    pub(crate) fn member(&mut self, role: MemberRole) -> &mut Member {
        match role {
            MemberRole::Sim => &mut self.sim,
            MemberRole::Host(lane) => &mut self.hosts[lane as usize],
        }
    }

    pub(crate) fn hosted_lanes(&self) -> Vec<u32> {
        let lanes = (0..).zip(&self.config.lanes);
        lanes.filter(|(_, policy)| policy.spec.hosted()).map(|(lane, _)| lane).collect()
    }

    pub(crate) fn roles(&self) -> Vec<MemberRole> {
        let hosts = self.hosted_lanes().into_iter().map(MemberRole::Host);
        std::iter::once(MemberRole::Sim).chain(hosts).collect()
    }

    /// Ends the fleet if a file that every new child needs has disappeared. The services of a sim that has
    /// exited do not count: its replacement makes them again.
    pub(crate) fn check_files(&self) -> Result<(), FleetError> {
        match self.children.lost_file() {
            Some(path) if Domain::is_service(&path) && self.children.has_exited(MemberRole::Sim) => Ok(()),
            Some(path) => Err(FleetError::Vanished { path }),
            None => Ok(()),
        }
    }

    /// Ends the fleet if its shared memory may be to blame and the episodes can continue in another fleet.
    pub(crate) fn suspect(&self, what: &str) -> Result<(), FleetError> {
        if self.config.can_move { Err(FleetError::Stuck { what: what.to_owned() }) } else { Ok(()) }
    }

    /// Returns the time within which the failures of a child count together.
    pub(crate) fn failure_window(&self, role: MemberRole) -> Duration {
        let limits = self.config.limits;
        let longest = match role {
            MemberRole::Sim => limits.sim_start + limits.silence,
            MemberRole::Host(lane) => {
                let lane: &Lane = &self.config.lanes[lane as usize].lane;
                limits.host_start + Duration::from_secs(lane.answer_timeout_s.into())
            }
        };
        longest * limits.failures
    }

    pub(crate) fn is_foreign(&self, lane: u32) -> bool {
        self.config.lanes[lane as usize].lane.foreign
    }
}
