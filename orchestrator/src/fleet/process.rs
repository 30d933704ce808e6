//! One child process: its three pipes, and its end.
//!
//! Commands go in line by line on a thread of their own, so that a child that does not read never blocks the fleet. The
//! child is in a process group of its own, so that Ctrl-C reaches the orchestrator alone.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

/// How often an ending child is looked at.
const POLL: Duration = Duration::from_millis(5);
/// After its stdout has closed, how long the rest of a child's stderr is waited for.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// A child process. Dropping it kills it.
#[derive(Debug)]
pub(super) struct Process {
    child: Child,
    commands: Option<Sender<String>>,
}

/// What a child lets be heard, in order.
#[derive(Debug)]
pub(super) enum Said {
    /// A line on stdout: an event.
    Event(String),
    /// A line on stderr: its log.
    Log(String),
    /// Stdout is closed: the child is leaving, or dead. Nothing follows.
    Closed,
}

impl Process {
    /// Starts `program subcommand --config config`. Whatever it says goes to `hear`, from threads of ours.
    pub(super) fn spawn(
        program: &Path,
        subcommand: &str,
        config: &str,
        hear: impl Fn(Said) + Clone + Send + 'static,
    ) -> io::Result<Self> {
        let mut child = Command::new(program)
            .args([subcommand, "--config", config])
            // Else Mesa, asked for a GPU, looks for a desktop and complains on stderr where there is none.
            .env("NODEVICE_SELECT", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .process_group(0)
            .spawn()?;
        let (Some(mut stdin), Some(stdout), Some(stderr)) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take())
        else {
            unreachable!("all three were asked for")
        };
        let (commands, queue) = channel::<String>();
        thread::spawn(move || {
            // A write fails only when the child is gone, which its stdout says. The end of the queue closes stdin.
            for line in queue {
                if stdin.write_all(line.as_bytes()).is_err() {
                    return;
                }
            }
        });
        let (log_ends, log_ended) = channel::<()>();
        let hear_log = hear.clone();
        thread::spawn(move || {
            each_line(stderr, |line| hear_log(Said::Log(line)));
            drop(log_ends);
        });
        thread::spawn(move || {
            each_line(stdout, |line| hear(Said::Event(line)));
            // Its only message is its end; either way the wait is over.
            let _ = log_ended.recv_timeout(LAST_WORDS);
            hear(Said::Closed);
        });
        Ok(Self { child, commands: Some(commands) })
    }

    /// Queues a line for the child's stdin. A child that has gone is noticed by its stdout.
    pub(super) fn send(&self, line: String) {
        if let Some(commands) = &self.commands {
            let _ = commands.send(line + "\n");
        }
    }

    /// Asks the child to leave: closes its stdin once what is queued is written.
    pub(super) fn close(&mut self) {
        self.commands = None;
    }

    /// Ends the child at once; that it is gone is heard as usual.
    pub(super) fn kill(&mut self) {
        // It fails only for a child that has already been waited for.
        let _ = self.child.kill();
    }

    /// Waits until the child has ended; kills it when patience runs out.
    pub(super) fn wait(mut self, patience: Duration) -> io::Result<ExitStatus> {
        let start = Instant::now();
        while start.elapsed() < patience {
            if let Some(status) = self.child.try_wait()? {
                return Ok(status);
            }
            thread::sleep(POLL);
        }
        self.child.kill()?;
        self.child.wait()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
        // A killed child ends; should the kernel not tell, nothing better can be done.
        let _ = self.child.wait();
    }
}

fn each_line(pipe: impl Read, mut hear: impl FnMut(String)) {
    let mut reader = BufReader::new(pipe);
    let mut line = Vec::new();
    while reader.read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
        hear(String::from_utf8_lossy(&line).trim_end().to_owned());
        line.clear();
    }
}
