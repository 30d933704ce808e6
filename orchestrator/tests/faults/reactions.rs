//! The supervisor's turns: an event and what must follow it before the next one.
//!
//! Without these rules a fault could hide behind another defence: a restarted sim that is told nothing still
//! gets its episodes, though only after it has reported twice that it waits.

use std::collections::BTreeSet;

use sim::serve::protocol::{Driver, SimCommand};

use super::super::FleetConfig;
use super::history::{Meaning, RunHistory};
use crate::fleet::processes::member::MemberRole;

/// The last event and the reactions to it.
#[derive(Debug, Default)]
pub(crate) struct SupervisorTurn {
    pub(crate) event: Option<(MemberRole, Meaning)>,
    pub(crate) commands: Vec<SimCommand>,
    /// Ids of the episodes that were sent for the first time.
    pub(crate) assigned: Vec<u64>,
    pub(crate) killed: Vec<MemberRole>,
    /// Commands that the last report of a waiting sim lacked.
    lacking: Lacking,
    /// Lanes that were given up before this turn.
    given_up: BTreeSet<u32>,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Lacking {
    episodes: BTreeSet<u64>,
    hosts: BTreeSet<u32>,
}

impl SupervisorTurn {
    fn runs(&self, id: u64) -> bool {
        self.commands.iter().any(|command| matches!(command, SimCommand::Run(run) if run.id == id))
    }

    fn gives_up(&self, idx: u32) -> bool {
        self.commands.iter().any(|command| matches!(command, SimCommand::GiveUp { lane } if *lane == idx))
    }

    fn retracts(&self, host: u32) -> bool {
        self.commands.iter().any(|command| matches!(command, SimCommand::HostDown { lane } if *lane == host))
    }

    fn announces(&self, host: u32) -> bool {
        self.commands.iter().any(|command| matches!(command, SimCommand::HostUp { lane } if *lane == host))
    }
}

impl RunHistory<'_> {
    /// Checks the reactions to the last event.
    pub(crate) fn end_turn(&mut self) {
        assert!(!self.is_impatient, "a second stop was ignored");
        let mut turn = std::mem::take(&mut self.turn);
        let event = turn.event.take();
        if self.shutdown.is_none() {
            self.check_state();
            let newly_given_up = self.given_up.iter().filter(|lane| !turn.given_up.contains(lane));
            for lane in newly_given_up.filter(|_| self.is_up(MemberRole::Sim)) {
                assert!(turn.gives_up(*lane), "the sim was not told that policy p{lane} is given up");
            }
            turn.given_up.clone_from(&self.given_up);
        }
        if self.shutdown.is_none()
            && let Some((role, meaning)) = event
        {
            self.check_reaction(role, &meaning, &turn);
            self.check_moderation(&meaning, &turn);
            turn.lacking = match meaning {
                Meaning::Waiting { held, hosts } => self.check_repetition(&turn, &held, &hosts),
                Meaning::SimReady(_) => Lacking::default(),
                _ => turn.lacking,
            };
        }
        turn.commands.clear();
        turn.assigned.clear();
        turn.killed.clear();
        self.turn = turn;
    }

    /// Checks what holds after every turn.
    fn check_state(&self) {
        assert!(self.causes.is_empty(), "the run goes on despite {:?}", self.causes);
        assert!(!self.has_garbage, "the memory of an exited child was not freed");
        for role in &self.failed {
            let is_given_up = matches!(role, MemberRole::Host(lane) if self.given_up.contains(lane));
            assert!(is_given_up, "the run goes on although {role:?} has failed too often");
        }
        let n_open = |driver: &Driver| self.open_jobs(*driver).count();
        let n_active = self.drivers().iter().filter(|driver| n_open(driver) > 0).count();
        for driver in self.drivers() {
            self.check_supply(driver, n_active.max(1) as u32);
        }
        self.check_lead();
    }

    /// Checks that no driver is far ahead of another, if they have to stay together.
    fn check_lead(&self) {
        let FleetConfig { paired, capacity, .. } = self.scenario.config;
        let limit = 2 * 2 * capacity.max_envs as usize * self.drivers().len();
        if let (true, Some(first)) = (paired, self.first_unassigned()) {
            let is_close = |job: &usize| *job < first + limit;
            assert!(self.assigned.values().all(is_close), "a policy is far ahead of another");
        }
    }

    /// Returns the first wanted job that the sim was not told of.
    fn first_unassigned(&self) -> Option<usize> {
        self.drivers().into_iter().filter_map(|driver| self.unassigned(driver).next()).min()
    }

    /// Returns the wanted jobs of a driver that the sim was not told of.
    fn unassigned(&self, driver: Driver) -> impl Iterator<Item = usize> {
        let is_assigned = |job: &usize| self.assigned.values().any(|assigned| assigned == job);
        self.open_jobs(driver).filter(move |job| !is_assigned(job))
    }

    /// Returns the wanted jobs of a driver without a recorded outcome.
    fn open_jobs(&self, driver: Driver) -> impl Iterator<Item = usize> {
        let is_open = |job: &usize| !self.recorded[*job] && !self.scenario.unwanted.contains(job);
        let jobs = (0..self.recorded.len()).filter(is_open);
        jobs.filter(move |job| self.scenario.jobs[*job].driver == driver)
    }

    /// Checks that the sim has enough episodes of a driver for all envs, and for a share of as many ahead.
    fn check_supply(&self, driver: Driver, n_active: u32) {
        let n_open = self.open_jobs(driver).count();
        let is_given_up = matches!(driver, Driver::Lane(lane) if self.given_up.contains(&lane));
        assert!(n_open == 0 || !is_given_up, "an episode of a given-up policy has no outcome");
        let capacity = self.scenario.config.capacity;
        let n_assigned = n_open - self.unassigned(driver).count();
        let first = self.unassigned(driver).next();
        let may_wait = self.scenario.config.paired && first != self.first_unassigned();
        // Unwanted jobs make a driver active until their turn comes.
        let is_exact = !capacity.tunes && self.scenario.unwanted.is_empty();
        let n_ahead = if is_exact { capacity.envs.div_ceil(n_active) } else { 0 };
        // A lack of memory halves the number that the supervisor chooses.
        let n_halvings = if capacity.tunes { self.n_oom_kills.min(31) } else { 0 };
        let enough = n_open.min(((capacity.envs >> n_halvings).max(1) + n_ahead) as usize);
        let has_enough = n_assigned >= enough || may_wait || !self.is_up(MemberRole::Sim);
        assert!(has_enough, "the sim has too few episodes");
        assert!(n_assigned <= 2 * capacity.max_envs as usize, "the sim has too many episodes");
    }

    fn check_reaction(&self, role: MemberRole, meaning: &Meaning, turn: &SupervisorTurn) {
        match (role, meaning) {
            (_, Meaning::SimReady(_)) => {
                for id in self.outstanding() {
                    assert!(turn.runs(id), "a new sim was not told of episode {id}");
                }
                for lane in 0..self.scenario.config.lanes.len() as u32 {
                    let is_known = if self.given_up.contains(&lane) {
                        turn.gives_up(lane)
                    } else {
                        let is_up = self.is_foreign(lane) || self.is_up(MemberRole::Host(lane));
                        turn.announces(lane) == is_up
                    };
                    assert!(is_known, "a new sim was not told the state of lane {lane}");
                }
            }
            (MemberRole::Host(lane), Meaning::HostReady) if self.is_up(MemberRole::Sim) => {
                assert!(turn.announces(lane), "the sim was not told of host {lane}");
            }
            (MemberRole::Host(lane), Meaning::Closed) if self.is_up(MemberRole::Sim) => {
                assert!(turn.retracts(lane), "the sim was not told that host {lane} is gone");
            }
            (_, Meaning::LaneFailed { lane, .. }) if !self.given_up.contains(lane) => {
                let host = MemberRole::Host(*lane);
                let is_due = !self.is_foreign(*lane) && self.is_up(host);
                assert!(!is_due || turn.killed.contains(&host), "a failed host was not killed");
            }
            _ => {}
        }
    }

    /// Checks that nothing is sent again before two reports have lacked it.
    fn check_moderation(&self, meaning: &Meaning, turn: &SupervisorTurn) {
        let is_early = |command: &SimCommand| match command {
            SimCommand::Run(run) => {
                !turn.assigned.contains(&run.id) && !turn.lacking.episodes.contains(&run.id)
            }
            SimCommand::HostUp { lane } => {
                !matches!(meaning, Meaning::HostReady) && !turn.lacking.hosts.contains(lane)
            }
            _ => false,
        };
        if !matches!(meaning, Meaning::SimReady(_)) {
            let early = turn.commands.iter().find(|command| is_early(command));
            assert!(early.is_none(), "{early:?} was sent again too early");
        }
    }

    /// Checks that what two reports of a waiting sim have lacked was sent again. Returns what this one lacks.
    fn check_repetition(&self, turn: &SupervisorTurn, held: &[u64], hosts: &[bool]) -> Lacking {
        let sent = |id: &u64| turn.runs(*id) && !turn.lacking.episodes.contains(id);
        let episodes: BTreeSet<u64> =
            self.outstanding().into_iter().filter(|id| !held.contains(id) && !sent(id)).collect();
        let is_up = |lane: &u32| self.is_up(MemberRole::Host(*lane));
        let lanes: BTreeSet<u32> =
            (0..).zip(hosts).filter(|(lane, known)| !**known && is_up(lane)).map(|(lane, _)| lane).collect();
        // Without its first line, the supervisor does not know that the sim is ready.
        let is_known = self.is_up(MemberRole::Sim);
        for id in episodes.intersection(&turn.lacking.episodes).filter(|_| is_known) {
            assert!(turn.runs(*id), "episode {id} was not sent again");
        }
        for lane in lanes.intersection(&turn.lacking.hosts).filter(|_| is_known) {
            assert!(turn.announces(*lane), "host {lane} was not announced again");
        }
        Lacking { episodes, hosts: lanes }
    }

    /// Returns the ids of all assigned episodes without a recorded outcome.
    fn outstanding(&self) -> Vec<u64> {
        let assigned = self.assigned.iter();
        assigned.filter(|(_, job)| !self.recorded[**job]).map(|(id, _)| *id).collect()
    }
}
