//! The queue of shards, and the threads that run them on machines.

use std::collections::{BTreeMap, VecDeque};
use std::fs::OpenOptions;
use std::path::Path;
use std::process::{Child, ExitStatus};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use run_config::{error_chain, input};

use crate::commands::distribution::status::{Overview, StatusLines};
use crate::commands::distribution::submit::sharded_sweep::ShardedSweep;
use crate::commands::distribution::submit::ssh::remote::Remote;
use crate::plan::partition::SweepShard;
use crate::store::shards::{ShardPhase, ShardState};

/// Number of failures in a row after which a machine is given up.
const MAX_HOST_FAILURES: u32 = 3;
/// Number of failures after which a shard is given up.
const MAX_ATTEMPTS: u32 = 5;
/// Time between a failure and the next attempt on the machine.
const PAUSE: Duration = Duration::from_secs(3);
/// Time between two copies of a shard's state.
const STATE_INTERVAL: Duration = Duration::from_secs(20);
/// Time between two copies of a shard's results.
const RESULTS_INTERVAL: Duration = Duration::from_secs(60);
/// Time after which a task that was asked to end is killed.
const GRACE: Duration = Duration::from_secs(150);
/// Time between two looks at children and signals.
const TICK: Duration = Duration::from_millis(100);
/// Time between two looks at the states.
const SHOW_INTERVAL: Duration = Duration::from_secs(2);

/// Exit code of ssh if the connection fails.
const NO_CONNECTION: i32 = 255;

/// The shards that have not finished, and the display of the progress.
#[derive(Debug)]
pub(crate) struct ShardPool<'a> {
    sweep: &'a ShardedSweep,
    inputs: &'a [String],
    /// Number of signals: the first one ends tasks in order, the second one kills them.
    signals: &'a AtomicU32,
    queue: Mutex<ShardQueue>,
    lines: Mutex<StatusLines>,
}

#[derive(Debug, Default)]
struct ShardQueue {
    waiting: VecDeque<SweepShard>,
    n_running: usize,
    failures: BTreeMap<u32, u32>,
    n_given_up: usize,
}

/// The next thing that a thread does.
enum WorkerStep {
    Run(SweepShard),
    Wait,
    End,
}

/// The end of a task that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TaskEnd {
    Done,
    Stopped,
}

impl<'a> ShardPool<'a> {
    /// Makes the queue of the shards that have not finished according to their states here.
    ///
    /// # Errors
    /// If a state cannot be read.
    pub(crate) fn new(sweep: &'a ShardedSweep, inputs: &'a [String], signals: &'a AtomicU32) -> Result<Self> {
        let mut waiting = VecDeque::new();
        for index in 0..sweep.shards {
            let shard = SweepShard { index, count: sweep.shards };
            let path = sweep.folder.state(shard);
            let state =
                ShardState::read(&path).with_context(|| format!("failed to read {}", path.display()))?;
            let has_finished = state.is_some_and(|state| state.phase == ShardPhase::Finished);
            if !has_finished || !sweep.folder.results(shard).exists() {
                waiting.push_back(shard);
            }
        }
        let queue = Mutex::new(ShardQueue { waiting, ..ShardQueue::default() });
        Ok(Self { sweep, inputs, signals, queue, lines: Mutex::new(StatusLines::new()) })
    }

    /// Runs the shards on machines, each with a number of them at a time, and returns how many have not
    /// finished.
    pub(crate) fn run<'m>(&self, machines: impl Iterator<Item = (u32, &'m Remote<'m>)>) -> usize {
        if lock(&self.queue).waiting.is_empty() {
            return 0;
        }
        thread::scope(|scope| {
            let threads: Vec<_> =
                machines.map(|(n_tasks, remote)| scope.spawn(move || self.serve(remote, n_tasks))).collect();
            let mut shown = None::<Instant>;
            while !threads.iter().all(thread::ScopedJoinHandle::is_finished) {
                if shown.is_none_or(|time| time.elapsed() >= SHOW_INTERVAL) {
                    // Ages of states mean nothing here: they are copies.
                    if let Ok(overview) = Overview::read(&self.sweep.folder, None) {
                        lock(&self.lines).show(&overview);
                    }
                    shown = Some(Instant::now());
                }
                thread::sleep(TICK);
            }
        });
        lock(&self.lines).finish();
        if let Ok(overview) = Overview::read(&self.sweep.folder, None) {
            self.log(&overview.line());
        }
        let queue = lock(&self.queue);
        queue.waiting.len() + queue.n_given_up
    }

    /// Runs shards on one machine until there are no more, or it fails again and again.
    fn serve(&self, remote: &Remote<'_>, n_tasks: u32) {
        let failures = AtomicU32::new(0);
        while let Err(error) = self.set_up(remote) {
            self.fail(remote, &failures, "", &error);
            if failures.load(Ordering::Relaxed) >= MAX_HOST_FAILURES || self.is_stopped() {
                break;
            }
        }
        thread::scope(|scope| {
            for _ in 0..n_tasks {
                scope.spawn(|| self.work(remote, &failures));
            }
        });
        if failures.load(Ordering::Relaxed) >= MAX_HOST_FAILURES {
            self.log(&format!("{}: given up after {MAX_HOST_FAILURES} failures in a row", remote.host));
        }
    }

    /// Copies what the machine needs, and fetches what earlier tasks have left there.
    fn set_up(&self, remote: &Remote<'_>) -> Result<()> {
        if self.is_stopped() {
            return Ok(());
        }
        remote.set_up(&self.sweep.program, self.inputs)?;
        let waiting: Vec<String> =
            lock(&self.queue).waiting.iter().map(|shard| name(&self.sweep.folder.results(*shard))).collect();
        remote.fetch_leftovers(&waiting)
    }

    fn work(&self, remote: &Remote<'_>, failures: &AtomicU32) {
        while failures.load(Ordering::Relaxed) < MAX_HOST_FAILURES {
            match self.next() {
                WorkerStep::End => return,
                WorkerStep::Wait => thread::sleep(TICK),
                WorkerStep::Run(shard) => {
                    let result = self.run_shard(remote, shard);
                    self.put_back(shard, &result);
                    match result {
                        Ok(_) => failures.store(0, Ordering::Relaxed),
                        Err(error) => self.fail(remote, failures, &format!("shard {shard}: "), &error),
                    }
                }
            }
        }
    }

    fn next(&self) -> WorkerStep {
        let mut queue = lock(&self.queue);
        match queue.waiting.pop_front() {
            Some(shard) if self.is_stopped() => {
                queue.waiting.push_front(shard);
                WorkerStep::End
            }
            Some(shard) => {
                queue.n_running += 1;
                WorkerStep::Run(shard)
            }
            // The shard of a machine that fails comes back.
            None if queue.n_running > 0 && !self.is_stopped() => WorkerStep::Wait,
            None => WorkerStep::End,
        }
    }

    /// Returns a shard to the queue if it has not finished.
    fn put_back(&self, shard: SweepShard, result: &Result<TaskEnd>) {
        let mut queue = lock(&self.queue);
        queue.n_running -= 1;
        match result {
            Ok(TaskEnd::Done) => {}
            Ok(TaskEnd::Stopped) => queue.waiting.push_front(shard),
            Err(_) => {
                let n = queue.failures.entry(shard.index).or_default();
                *n += 1;
                if *n < MAX_ATTEMPTS {
                    queue.waiting.push_back(shard);
                } else {
                    queue.n_given_up += 1;
                }
            }
        }
    }

    fn run_shard(&self, remote: &Remote<'_>, shard: SweepShard) -> Result<TaskEnd> {
        let folder = &self.sweep.folder;
        let (results, state) = (name(&folder.results(shard)), name(&folder.state(shard)));
        remote.push(&[name(&folder.sweep()), results.clone()])?;
        let log = self.sweep.log(shard.index);
        let file = OpenOptions::new().create(true).append(true).open(&log);
        let file = file.with_context(|| format!("failed to open {}", log.display()))?;
        let mut task = remote.start(&self.sweep.run_words(&shard.to_string()), file)?;
        let (mut results_at, mut state_at) = (Instant::now(), Instant::now());
        let ended = self.wait(&mut task, || {
            // A copy that fails is made again; if the machine is gone, ssh notices it.
            if results_at.elapsed() >= RESULTS_INTERVAL {
                let _ = remote.fetch_results(std::slice::from_ref(&results));
                results_at = Instant::now();
            }
            if state_at.elapsed() >= STATE_INTERVAL {
                let _ = remote.fetch_state(&state);
                state_at = Instant::now();
            }
        })?;
        let fetched = remote.fetch_results(&[results]).and_then(|()| remote.fetch_state(&state));
        match ended.code() {
            _ if self.is_stopped() => fetched.map(|()| TaskEnd::Stopped),
            Some(0 | 1) => fetched.map(|()| TaskEnd::Done),
            Some(NO_CONNECTION) => bail!("the connection failed: {}", last_line(&log)),
            _ => bail!("{ended}: {}", last_line(&log)),
        }
    }

    /// Waits for the end of a task, and ends it if this process has got a signal.
    fn wait(&self, task: &mut Child, mut meanwhile: impl FnMut()) -> Result<ExitStatus> {
        let mut stdin = task.stdin.take();
        let mut stopped = None::<Instant>;
        loop {
            if let Some(status) = task.try_wait().context("failed to wait for ssh")? {
                return Ok(status);
            }
            if self.is_stopped() {
                drop(stdin.take());
                let since = *stopped.get_or_insert_with(Instant::now);
                if self.signals.load(Ordering::Relaxed) > 1 || since.elapsed() >= GRACE {
                    task.kill().context("failed to end ssh")?;
                }
            } else {
                meanwhile();
            }
            thread::sleep(TICK);
        }
    }

    /// Counts and reports a failure of a machine, and waits a little.
    fn fail(&self, remote: &Remote<'_>, failures: &AtomicU32, what: &str, error: &anyhow::Error) {
        self.log(&format!("{}: {what}{}", remote.host, error_chain(error.as_ref())));
        failures.fetch_add(1, Ordering::Relaxed);
        let failed = Instant::now();
        while failed.elapsed() < PAUSE && !self.is_stopped() {
            thread::sleep(TICK);
        }
    }

    fn is_stopped(&self) -> bool {
        self.signals.load(Ordering::Relaxed) > 0
    }

    fn log(&self, line: &str) {
        lock(&self.lines).log(line);
    }
}

/// Locks a mutex. Each use leaves consistent data, even one that panics.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the name of a file in the folder of the shards.
fn name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Returns the last line of a log, which says why a task has ended.
fn last_line(log: &Path) -> String {
    let text = input::read(log).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default();
    let line = text.lines().rev().map(str::trim).find(|line| !line.is_empty());
    line.unwrap_or("its log is empty").to_owned()
}
