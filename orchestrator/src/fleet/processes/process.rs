//! One child process: its pipes and its termination.
//!
//! A separate thread writes commands to its stdin, so that a child that does not read never blocks the fleet.
//! The child has its own process group, so that Ctrl-C signals the orchestrator only.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use ipc_types::link::Domain;
use rustix::process::{Pid, WaitId, WaitIdOptions, waitid};

/// Interval at which an exiting child is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Maximum time to free the memory of exited children, longer than the deadline of [`Domain::reap`].
const REAP_TIMEOUT: Duration = Duration::from_secs(8);
/// Maximum wait for the rest of a child's stderr after its stdout has closed.
const STDERR_TIMEOUT: Duration = Duration::from_secs(1);

/// Score of a child for the kernel's choice of what to kill, from -1000 to 1000 (proc(5), `oom_score_adj`).
const OOM_SCORE: i32 = 900;

/// A child process. Dropping it kills the child.
#[derive(Debug)]
pub(crate) struct ChildProcess {
    child: Child,
    commands: Option<Sender<String>>,
}

/// Lets the kernel choose a child rather than this process if memory runs out: a child can be replaced.
fn offer_memory(child: u32) {
    let path = format!("/proc/{child}/oom_score_adj");
    let current: Option<i32> = std::fs::read_to_string(&path).ok().and_then(|text| text.trim().parse().ok());
    if current.is_some_and(|score| score < OOM_SCORE) {
        // Without the right to, nothing changes.
        let _ = tell_kernel(&path, &OOM_SCORE.to_string());
    }
}

/// Writes to one of the kernel's own files.
pub(crate) fn tell_kernel(path: &str, text: &str) -> io::Result<()> {
    std::fs::OpenOptions::new().write(true).open(path)?.write_all(text.as_bytes())
}

/// The output of a child, in order.
#[derive(Debug)]
pub(crate) enum ChildOutput {
    /// A line on stdout, which is an event.
    Event(String),
    /// A line on stderr, which is the log.
    Log(String),
    /// The end of stdout: the child is exiting or has exited. Nothing follows.
    Closed,
}

impl ChildProcess {
    /// Starts `program subcommand --config config`. Calls `on_output` for all its output, from other threads.
    pub(crate) fn spawn(
        program: &Path,
        subcommand: &str,
        config: &str,
        on_output: impl Fn(ChildOutput) + Clone + Send + 'static,
    ) -> io::Result<Self> {
        // Its name in process lists is that of this process: the program may be a link of the kernel.
        let name = std::env::args_os().next().unwrap_or_else(|| program.into());
        let mut child = Command::new(program)
            .arg0(name)
            .args([subcommand, "--config", config])
            // Otherwise Mesa's device selection looks for a desktop and writes errors to stderr if there is
            // none.
            .env("NODEVICE_SELECT", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .process_group(0)
            .spawn()?;
        offer_memory(child.id());
        let (Some(mut stdin), Some(stdout), Some(stderr)) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take())
        else {
            unreachable!("all three are piped")
        };
        let (commands, queue) = channel::<String>();
        // Dropped, and the child killed, if a thread cannot be started.
        let process = Self { child, commands: Some(commands) };
        let thread = |name: &str| thread::Builder::new().name(name.to_owned());
        thread("commands").spawn(move || {
            // A write fails only if the child has exited, which its stdout shows. Dropping the queue closes
            // stdin.
            for line in queue {
                if stdin.write_all(line.as_bytes()).is_err() {
                    return;
                }
            }
        })?;
        let (log_ends, log_ended) = channel::<()>();
        let on_log = on_output.clone();
        thread("log").spawn(move || {
            each_line(stderr, |line| on_log(ChildOutput::Log(line)));
            drop(log_ends);
        })?;
        thread("events").spawn(move || {
            each_line(stdout, |line| on_output(ChildOutput::Event(line)));
            // Nothing is ever sent: this returns when the thread above ends, or after the timeout.
            let _ = log_ended.recv_timeout(STDERR_TIMEOUT);
            on_output(ChildOutput::Closed);
        })?;
        Ok(process)
    }

    /// Returns the child's resident memory in bytes without shared memory, where the system tells it.
    pub(crate) fn memory_bytes(&self) -> Option<u64> {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).ok()?;
        let kibibytes = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key))?;
            line.split_whitespace().next()?.parse::<u64>().ok()
        };
        Some((kibibytes("RssAnon:")? + kibibytes("RssFile:")?) << 10)
    }

    /// Returns the core-seconds that the child has used, where the system tells it. The resolution is a tick
    /// of the kernel, 10 ms.
    pub(crate) fn cpu_s(&self) -> Option<f64> {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.child.id())).ok()?;
        // The name of the program comes second, in parentheses, and may contain spaces.
        let (_, after_name) = stat.rsplit_once(')')?;
        let mut fields = after_name.split_whitespace().skip(11);
        let mut ticks = || fields.next()?.parse::<u64>().ok();
        let (user, system) = (ticks()?, ticks()?);
        Some((user + system) as f64 / rustix::param::clock_ticks_per_second() as f64)
    }

    /// Returns the process id.
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Returns `true` if the child has exited. It can still be waited for.
    pub(crate) fn has_exited(&self) -> bool {
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        // The call fails only for a child that has already been waited for.
        waitid(WaitId::Pid(Pid::from_child(&self.child)), options).map_or(true, |status| status.is_some())
    }

    /// Queues a line for the child's stdin. If the child has exited, the line is dropped.
    pub(crate) fn send(&self, line: String) {
        if let Some(commands) = &self.commands {
            let _ = commands.send(line + "\n");
        }
    }

    /// Asks the child to exit by closing its stdin after all queued lines.
    pub(crate) fn close(&mut self) {
        self.commands = None;
    }

    /// Kills the child. Its exit arrives as [`ChildOutput::Closed`], as usual.
    pub(crate) fn kill(&mut self) {
        // This fails only for a child that has already been reaped.
        let _ = self.child.kill();
    }

    /// Waits for the child to exit; kills it after `timeout`.
    pub(crate) fn wait(mut self, timeout: Duration) -> io::Result<ExitStatus> {
        let start = Instant::now();
        while start.elapsed() < timeout {
            if let Some(status) = self.child.try_wait()? {
                return Ok(status);
            }
            thread::sleep(POLL_INTERVAL);
        }
        self.child.kill()?;
        self.child.wait()
    }
}

impl Drop for ChildProcess {
    fn drop(&mut self) {
        self.kill();
        // A killed child exits; if waiting for it fails, nothing better can be done.
        let _ = self.child.wait();
    }
}

/// Frees the shared memory of exited children in a separate process, so that a damaged segment can neither
/// crash this one nor stall it. Returns `false` if that process fails.
pub(crate) fn reap(program: &Path, domain: &Domain) -> bool {
    let mut command = Command::new(program);
    command.args(["reap", "--config", &serde_json::json!(domain).to_string()]).process_group(0);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let process = command.spawn().map(|child| ChildProcess { child, commands: None });
    process.and_then(|process| process.wait(REAP_TIMEOUT)).is_ok_and(|status| status.success())
}

fn each_line(pipe: impl Read, mut on_line: impl FnMut(String)) {
    let mut reader = BufReader::new(pipe);
    let mut line = Vec::new();
    while reader.read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
        on_line(String::from_utf8_lossy(&line).trim_end().to_owned());
        line.clear();
    }
}
