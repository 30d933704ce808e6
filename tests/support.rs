//! Helpers for whole-program tests: running the binary with a deadline and reading the results it leaves.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

pub mod harness;

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

/// Time limit of each run, after which it is killed.
const DEADLINE: Duration = Duration::from_secs(240);

/// Exit status and output of a finished run.
#[derive(Debug)]
pub struct FinishedRun {
    /// Exit status of the orchestrator process.
    pub status: ExitStatus,
    /// Everything the run wrote to stdout.
    pub stdout: String,
    /// Everything the run wrote to stderr.
    pub stderr: String,
}

impl FinishedRun {
    /// Asserts the exit code; a mismatch prints the output.
    #[track_caller]
    pub fn expect_code(self, code: i32) -> Self {
        assert_eq!(self.status.code(), Some(code), "stdout:\n{}\nstderr:\n{}", self.stdout, self.stderr);
        self
    }
}

/// Returns the path of a tiny ACT checkpoint with random weights for both morphologies.
#[must_use]
pub fn act_tiny() -> String {
    let path: PathBuf =
        [env!("CARGO_MANIFEST_DIR"), "..", "policy-host", "tests", "data", "act-tiny"].iter().collect();
    path.canonicalize().unwrap().to_str().unwrap().to_owned()
}

/// Returns the path of the binary that cargo built next to the running test.
#[must_use]
pub fn program() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    test.parent().and_then(Path::parent).unwrap().join("hypogeum-under-test")
}

/// Returns a command that runs the program with `dir` as its working and runtime folder.
#[must_use]
pub fn hypogeum(dir: &Path, args: &[&str]) -> Command {
    hypogeum_at(&program(), dir, args)
}

/// Like [`hypogeum`], with a copy of the program.
#[must_use]
pub fn hypogeum_at(program: &Path, dir: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(program);
    command.args(args).current_dir(dir).env("XDG_RUNTIME_DIR", dir);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Returns a command that runs the program after `script` in a shell, for example with a limit, like
/// [`hypogeum`]. The script ends with `"$@"`, which is the program with its arguments.
#[must_use]
pub fn hypogeum_after(dir: &Path, script: &str, args: &[&str]) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", script, "sh"]).arg(program()).args(args);
    command.current_dir(dir).env("XDG_RUNTIME_DIR", dir);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Runs the program to completion, killing it at the deadline.
#[must_use]
pub fn run(dir: &Path, args: &[&str]) -> FinishedRun {
    finish(hypogeum(dir, args).spawn().unwrap())
}

/// Waits for a running program, killing it at the deadline.
#[must_use]
pub fn finish(mut child: Child) -> FinishedRun {
    let (mut out, mut err) = (child.stdout.take().unwrap(), child.stderr.take().unwrap());
    let stdout = std::thread::spawn(move || read_all(&mut out));
    let stderr = std::thread::spawn(move || read_all(&mut err));
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > DEADLINE {
            child.kill().unwrap();
            break child.wait().unwrap();
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    FinishedRun { status, stdout: stdout.join().unwrap(), stderr: stderr.join().unwrap() }
}

fn read_all(source: &mut impl Read) -> String {
    let mut text = String::new();
    source.read_to_string(&mut text).unwrap();
    text
}

/// One row of a results file without its timings, each column in debug format.
pub type Row = Vec<String>;

/// Returns all rows of a results file without their timings, ordered by episode identity.
#[must_use]
pub fn rows(db: &Path) -> Vec<Row> {
    let connection = rusqlite::Connection::open(db).unwrap();
    let sql = "SELECT policy, task, perturbation, episode, seed, steps, success_once, success_at_end, \
               first_success_step, failed_predicate, fingerprint, error FROM episodes \
               ORDER BY policy, task, perturbation, episode";
    let mut statement = connection.prepare(sql).unwrap();
    let row = |row: &rusqlite::Row<'_>| (0..12).map(|i| Ok(format!("{:?}", row.get_ref(i)?))).collect();
    statement.query_map([], row).unwrap().collect::<Result<_, _>>().unwrap()
}

/// Returns the process id of a child.
#[must_use]
pub fn pid_of(child: &Child) -> Pid {
    Pid::from_child(child)
}

/// Returns the process ids of the children of `parent`.
#[must_use]
pub fn children(parent: Pid) -> Vec<String> {
    // The kernel lists the children of each thread.
    let threads = std::fs::read_dir(format!("/proc/{}/task", parent.as_raw_nonzero()));
    let lists = threads.into_iter().flatten().flatten().map(|thread| thread.path().join("children"));
    let lists = lists.map(|path| std::fs::read_to_string(path).unwrap_or_default());
    lists.flat_map(|list| list.split_whitespace().map(str::to_owned).collect::<Vec<_>>()).collect()
}

/// Returns the child process of `parent` whose command line contains the argument `word`.
#[must_use]
pub fn find_child(parent: Pid, word: &str) -> Option<Pid> {
    children(parent).iter().find_map(|pid| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).ok()?;
        let has_word = line.split(|byte| *byte == 0).any(|arg| arg == word.as_bytes());
        has_word.then(|| Pid::from_raw(pid.parse().ok()?)).flatten()
    })
}

/// Returns the number of finished episodes in a results file, 0 if it cannot be read yet.
#[must_use]
pub fn n_rows(db: &Path) -> usize {
    let Ok(connection) = rusqlite::Connection::open(db) else { return 0 };
    connection.query_row("SELECT count(*) FROM episodes", [], |row| row.get::<_, i64>(0)).unwrap_or(0)
        as usize
}

/// Waits until the run has at least `n` rows. Returns `false` if it exits first.
///
/// # Panics
/// If it takes too long.
#[must_use]
pub fn wait_for_rows(child: &mut Child, db: &Path, n: usize) -> bool {
    let deadline = Instant::now() + Duration::from_secs(120);
    while n_rows(db) < n {
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        assert!(Instant::now() < deadline, "no {n} rows within two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
    true
}

/// Waits for the child process with this subcommand to appear and kills it.
///
/// # Panics
/// If there is none.
pub fn kill_child(parent: Pid, word: &str) {
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        if let Some(pid) = find_child(parent, word) {
            kill_process(pid, Signal::KILL).unwrap();
            return;
        }
        assert!(Instant::now() < deadline, "the run has no `{word}` child");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Returns the errors recorded in a results file, ordered by episode.
#[must_use]
pub fn errors(db: &Path) -> Vec<String> {
    let connection = rusqlite::Connection::open(db).unwrap();
    let mut statement =
        connection.prepare("SELECT error FROM episodes WHERE error IS NOT NULL ORDER BY episode").unwrap();
    statement.query_map([], |row| row.get(0)).unwrap().collect::<Result<_, _>>().unwrap()
}

/// Returns the names of all shared-memory segments created by runs of this program. None may outlive its run.
#[must_use]
pub fn shared_memory() -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir("/dev/shm")
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.starts_with("hyp_"))
        .collect();
    names.sort();
    names
}
