//! Deadlines of the children: to get ready, to write something, and to do work.

use std::time::Duration;

use sim::serve::protocol::Driver;

use super::super::error::FleetError;
use super::state::{Supervisor, WorkWatch};
use crate::fleet::processes::member::MemberRole;

impl Supervisor<'_> {
    /// Kills a hung sim, and a child that does not get ready in time. Hung hosts are detected by the sim,
    /// which knows the unanswered queries.
    pub(crate) fn check_timeouts(&mut self) -> Result<(), FleetError> {
        let (now, limits) = (self.children.now(), self.config.limits);
        for role in self.roles() {
            let timeout = if role == MemberRole::Sim { limits.sim_start } else { limits.host_start };
            if self.member(role).starting_for(now).is_some_and(|time| time > timeout) {
                let line =
                    format!("{} was not ready after {} s; killed it", self.name(role), timeout.as_secs());
                self.kill(role, &line)?;
            }
        }
        if self.sim.silent_for(now).is_some_and(|time| time > limits.silence) {
            let line = format!("the sim wrote nothing for {} s; killed it", limits.silence.as_secs());
            self.kill(MemberRole::Sim, &line)?;
        }
        self.check_progress(now)
    }

    /// Kills the sim if nothing proceeds although there is work for children that are ready: what they share
    /// may be damaged in a way that they cannot notice.
    fn check_progress(&mut self, now: Duration) -> Result<(), FleetError> {
        let work = self.totals.work();
        let Some(timeout) = self.progress_timeout().filter(|_| work == self.progress.work) else {
            self.progress = WorkWatch { work, at: now };
            return Ok(());
        };
        if now.saturating_sub(self.progress.at) <= timeout {
            return Ok(());
        }
        self.progress.at = now;
        let line = format!("no episode has proceeded for {} s; killed the sim", timeout.as_secs());
        self.kill(MemberRole::Sim, &line)
    }

    /// Returns the longest time that may pass between two signs of work; `None` if none is expected, because
    /// no episode is in progress, or a child has yet to get ready.
    fn progress_timeout(&self) -> Option<Duration> {
        let timeout = |driver| match driver {
            Driver::Expert => Some(Duration::ZERO),
            Driver::Lane(idx) => {
                let lane = &self.config.lanes[idx as usize].lane;
                let answer = Duration::from_secs(lane.answer_timeout_s.into());
                if lane.foreign {
                    Some(self.config.limits.foreign + answer)
                } else {
                    self.hosts[idx as usize].is_up().then_some(answer)
                }
            }
        };
        let longest = self.outstanding.values().filter_map(|job| timeout(job.driver)).max()?;
        self.sim.is_up().then(|| longest + self.config.limits.silence)
    }

    /// Kills a child for the reason in `line`, unless its episodes can go on in other shared memory. Its exit
    /// arrives as usual.
    fn kill(&mut self, role: MemberRole, line: &str) -> Result<(), FleetError> {
        self.log(line)?;
        self.suspect(line)?;
        let now = self.children.now();
        let member = self.member(role);
        member.restart_clock(now);
        member.on_log(line);
        member.on_kill();
        self.children.kill(role);
        Ok(())
    }
}
