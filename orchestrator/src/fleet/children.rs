//! The interface between the supervisor and the world: child processes, their messages, shared memory that
//! they leave behind, and time.
//!
//! The supervisor does nothing but through this trait and its observer, so that a simulated world can
//! replace the real one.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use ipc_types::link::Shortage;

use super::event::SupervisorEvent;
use crate::fleet::processes::member::{ChildExit, MemberRole};

/// The children of a run, at most one per role, and the rest of the supervisor's world. Requests to a role
/// without a child have no effect.
pub(crate) trait Children {
    /// Starts a child with a configuration in JSON. The role has no child.
    fn spawn(&mut self, role: MemberRole, config: &str) -> io::Result<()>;

    /// Queues a line for the child's stdin.
    fn send(&mut self, role: MemberRole, line: String);

    /// Asks the child to exit by closing its stdin after all queued lines.
    fn close(&mut self, role: MemberRole);

    /// Kills the child. Its exit arrives as an event, as usual.
    fn kill(&mut self, role: MemberRole);

    /// Waits for the child to exit and removes it from its role. Kills it after `timeout`. Returns `None` if
    /// there is no child.
    fn wait(&mut self, role: MemberRole, timeout: Duration) -> Option<ChildExit>;

    /// Returns `true` if the child has exited, or there is none.
    fn has_exited(&self, role: MemberRole) -> bool;

    /// Returns the child's resident memory in bytes without shared memory, where the system tells it.
    fn memory_bytes(&self, role: MemberRole) -> Option<u64>;

    /// Returns the core-seconds that the child has used, where the system tells it.
    fn cpu_s(&self, role: MemberRole) -> Option<f64>;

    /// Waits for the next event, at most for `timeout`, and advances the clock.
    fn next_event(&mut self, timeout: Duration) -> Option<SupervisorEvent>;

    /// Advances the clock.
    fn update_clock(&mut self);

    /// Returns the time for which this process has run, as of the last advance of the clock.
    fn now(&self) -> Duration;

    /// Frees the shared memory of children that have exited. Returns `false` if that failed or took too long.
    fn free_memory(&mut self) -> bool;

    /// Returns another user who has put files with the names of this run into shared memory.
    fn intruder(&self) -> Option<u32>;

    /// Returns the resource that this process lacks now, if any.
    fn shortage(&self) -> Option<Shortage>;

    /// Remembers which files the run needs from now on, because its sim is ready, or that it needs none,
    /// because that has exited.
    fn watch_files(&mut self, is_ready: bool);

    /// Returns one of these files that is gone.
    fn lost_file(&self) -> Option<PathBuf>;

    /// Returns how many processes the kernel has killed for lack of memory, where it tells.
    fn oom_kills(&self) -> u64;

    /// Returns the number of cores.
    fn n_cores(&self) -> u32;

    /// Returns the core-seconds so far in which these cores had nothing to do, where the system tells it.
    fn idle_core_s(&self) -> Option<f64>;
}
