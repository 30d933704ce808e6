//! The policies' side of the supervisor: failed hosts, policies that are given up, and the state that the sim
//! is told again.

use std::collections::BTreeSet;

use sim::serve::protocol::{Driver, EpisodeLedger, Outcome, SimCommand};

use super::super::error::FleetError;
use super::super::event::FleetEvent;
use super::state::{Supervisor, Unconfirmed};
use crate::fleet::processes::member::MemberRole;
use crate::plan::jobs::Job;

impl Supervisor<'_> {
    /// Handles a host that does not answer or answers incorrectly. A host of this fleet is killed, and
    /// restarted when its exit arrives. A foreign host is asked again, until it has failed too often.
    pub(crate) fn on_lane_failed(
        &mut self,
        lane: u32,
        message: String,
        is_final: bool,
    ) -> Result<(), FleetError> {
        // During a shutdown, children exit in any order, and the sim removes its services.
        if self.is_ending || self.given_up[lane as usize] {
            return Ok(());
        }
        self.check_files()?;
        let role = MemberRole::Host(lane);
        self.progress.on_event(self.children.now());
        if self.is_foreign(lane) {
            let (now, window) = (self.children.now(), self.failure_window(role));
            let failures = self.member(role).add_failure(now, window);
            if is_final || failures >= self.config.limits.failures {
                return self.give_up(lane, FleetError::Lane(message));
            }
            return self.log(&format!("{message}; trying again"));
        }
        let host = self.member(role);
        host.on_log(&message);
        if host.is_up() {
            host.on_kill();
            self.children.kill(role);
        }
        self.log(&format!("{message}; killed its host"))
    }

    /// Handles a foreign host that has left with unfinished episodes.
    pub(crate) fn on_host_lost(&mut self, lane: u32) -> Result<(), FleetError> {
        let (role, limit) = (MemberRole::Host(lane), self.config.limits.departures);
        let (now, window) = (self.children.now(), self.failure_window(role));
        let departures = self.member(role).add_departure(now, window);
        self.progress.on_event(now);
        let policy = &self.config.lanes[lane as usize].lane.spec.policy;
        let line = format!("a host of policy `{policy}` left");
        if self.is_ending || self.given_up[lane as usize] {
            return Ok(());
        }
        self.check_files()?;
        if departures >= limit {
            let message =
                format!("{departures} hosts of policy `{policy}` left without finishing an episode");
            return self.give_up(lane, FleetError::Lane(message));
        }
        self.log(&format!("{line}; its episodes restart with the next one"))
    }

    /// Ends a policy that has failed too often: its remaining episodes are recorded as errors, which the same
    /// command runs again later. If the run has no other policy, it ends with the error.
    pub(crate) fn give_up(&mut self, lane: u32, error: FleetError) -> Result<(), FleetError> {
        if self.pending.n_drivers() == 1 {
            return Err(error);
        }
        self.given_up[lane as usize] = true;
        self.send_to_sim(&SimCommand::GiveUp { lane });
        let driver = Driver::Lane(lane);
        let ids: Vec<u64> =
            self.outstanding.iter().filter(|(_, job)| job.driver == driver).map(|(id, _)| *id).collect();
        let mut jobs: Vec<Job> = ids.iter().filter_map(|id| self.outstanding.remove(id)).collect();
        jobs.iter().for_each(|job| self.pending.on_finished(job.driver));
        let observer = &mut *self.observer;
        jobs.extend(self.pending.take_all(driver, &mut |job| observer.is_wanted(job)));
        let policy = &self.config.lanes[lane as usize].lane.spec.policy;
        let n_jobs = jobs.len();
        self.log(&format!("{error}; gave up policy `{policy}`: its {n_jobs} remaining episodes are errors"))?;
        let outcome = failed_outcome(format!("the policy was given up: {}", error.summary()));
        for job in &jobs {
            self.observer
                .on_event(&FleetEvent::EpisodeFinished(job, &outcome))
                .map_err(FleetError::Observer)?;
        }
        Ok(())
    }

    /// Sends a sim that has just become ready the connected hosts and the unfinished episodes.
    pub(crate) fn send_state_to_sim(&mut self) {
        for lane in 0..self.config.lanes.len() as u32 {
            if self.given_up[lane as usize] {
                self.send_to_sim(&SimCommand::GiveUp { lane });
            } else if self.is_foreign(lane) || self.hosts[lane as usize].is_up() {
                self.send_to_sim(&SimCommand::HostUp { lane });
            }
        }
        self.unconfirmed = Unconfirmed::default();
        let unfinished: Vec<_> = self.outstanding.iter().map(|(&id, job)| job.assignment(id)).collect();
        for assignment in unfinished {
            self.send_to_sim(&SimCommand::Run(assignment));
        }
    }

    /// Compares what the sim knows with what it was sent, and sends again what two reports in a row have
    /// lacked. One alone may have crossed the command.
    pub(crate) fn on_waiting(&mut self, held: &[u64], hosts: &[bool]) {
        let knows = |id: &u64| held.binary_search(id).is_ok();
        let episodes: BTreeSet<u64> = self.outstanding.keys().copied().filter(|id| !knows(id)).collect();
        let lacks = |lane: &u32| {
            self.hosts[*lane as usize].is_up() && !hosts.get(*lane as usize).copied().unwrap_or(false)
        };
        let lanes: BTreeSet<u32> = (0..self.hosts.len() as u32).filter(lacks).collect();
        let Unconfirmed { episodes: missing, hosts: unknown } = std::mem::take(&mut self.unconfirmed);
        for &lane in lanes.intersection(&unknown) {
            self.send_to_sim(&SimCommand::HostUp { lane });
        }
        for id in episodes.intersection(&missing) {
            if let Some(job) = self.outstanding.get(id) {
                let assignment = job.assignment(*id);
                self.send_to_sim(&SimCommand::Run(assignment));
            }
        }
        self.unconfirmed = Unconfirmed { episodes, hosts: lanes };
    }
}

/// Returns the outcome of an episode that was never finished.
fn failed_outcome(error: String) -> Outcome {
    Outcome {
        id: 0,
        steps: 0,
        success_once: false,
        success_at_end: false,
        first_success_step: None,
        failed_predicate: None,
        fingerprint: 0,
        actions: None,
        ledger: EpisodeLedger::default(),
        error: Some(error),
    }
}
