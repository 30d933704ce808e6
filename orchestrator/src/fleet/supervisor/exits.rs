//! Children that have exited: the cause is found, their shared memory is freed, and they are replaced.

use sim::serve::protocol::SimCommand;

use super::super::error::{FleetError, tightest_limit};
use super::state::Supervisor;
use crate::fleet::processes::member::MemberRole;

impl Supervisor<'_> {
    /// Reaps a child, cleans up its shared memory and restarts it, unless it has failed too often or its
    /// failures have a cause that will not go away.
    pub(crate) fn restart(&mut self, role: MemberRole) -> Result<(), FleetError> {
        let (limits, window, now) = (self.config.limits, self.failure_window(role), self.children.now());
        let Some(exit) = self.children.wait(role, limits.shutdown) else { return Ok(()) };
        let is_out_of_memory = exit.was_killed() && self.take_oom_kill();
        let lost = self.check_files();
        let member = self.member(role);
        member.on_exit();
        let fails_often = member.add_failure(now, window) >= limits.failures;
        if let Some(user) = self.children.intruder() {
            return Err(FleetError::Intruder { name: self.name(role), exit, user });
        }
        self.free_memory(role)?;
        match role {
            MemberRole::Sim => {
                self.children.watch_files(false);
                self.totals.on_sim_exit();
            }
            MemberRole::Host(lane) => {
                self.totals.on_host_exit(lane);
                self.send_to_sim(&SimCommand::HostDown { lane });
            }
        }
        lost?;
        let name = self.name(role);
        if let Some(source) =
            (fails_often || exit.lacked_memory()).then(|| self.children.shortage()).flatten()
        {
            return Err(FleetError::Shortage { name, exit, source });
        }
        let member = self.member(role);
        let (message, was_ended) = (member.user_error(&exit), member.was_ended(&exit));
        if message.is_none() && !was_ended && (exit.lacked_link() || fails_often) {
            self.suspect(&format!("{name} {exit}"))?;
        }
        let error = match message {
            Some(message) => FleetError::Child { name, message },
            None if exit.lacked_time() => FleetError::CpuTime { name },
            None if fails_often && is_out_of_memory => {
                FleetError::OutOfMemory { name, failures: limits.failures }
            }
            None if fails_often && was_ended => FleetError::Ended { name, failures: limits.failures, exit },
            None if fails_often => {
                let log = self.member(role).log_tail();
                FleetError::TooManyFailures { name, failures: limits.failures, exit, log }
            }
            None => {
                let cause = if is_out_of_memory { self.ease_memory() } else { String::new() };
                self.log(&format!("{name} {exit}{cause}; restarting it"))?;
                return self.start(role);
            }
        };
        match role {
            MemberRole::Sim => Err(error),
            MemberRole::Host(lane) => self.give_up(lane, error),
        }
    }

    /// Lets the next sim run fewer episodes at a time, if that is ours to choose. Returns a clause on the
    /// lack of memory.
    fn ease_memory(&mut self) -> String {
        let fewer = self.tuner.as_mut().map_or_else(String::new, |tuner| {
            tuner.halve();
            format!(", and at most {} envs are used from now on", tuner.choice().envs)
        });
        format!(", by the kernel for lack of memory{}{fewer}", tightest_limit())
    }

    /// Returns `true` if the kernel has killed more processes for lack of memory than children are known to
    /// have ended by that, and counts one more of these.
    fn take_oom_kill(&mut self) -> bool {
        let is_new = self.children.oom_kills() > self.oom_kills;
        self.oom_kills += u64::from(is_new);
        is_new
    }

    /// Frees the shared memory of a child that has exited.
    fn free_memory(&mut self, role: MemberRole) -> Result<(), FleetError> {
        if self.children.free_memory() {
            return Ok(());
        }
        let line = format!("failed to free the shared memory of {}", self.name(role));
        self.log(&line)?;
        self.suspect(&line)
    }

    /// Waits for a child that was asked to exit. Its exit status does not matter.
    pub(crate) fn wait_for_exit(&mut self, role: MemberRole) {
        let _ = self.children.wait(role, self.config.limits.shutdown);
        self.member(role).on_exit();
    }
}
