//! What tests of the whole program share: running the binary with a bound on time, and reading what it left.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// No run of a test takes longer.
const DEADLINE: Duration = Duration::from_secs(240);

/// What a finished run left.
#[derive(Debug)]
pub struct Finished {
    /// Exit status.
    pub status: ExitStatus,
    /// All of stdout.
    pub stdout: String,
    /// All of stderr.
    pub stderr: String,
}

impl Finished {
    /// Exit code, and the output when it is another one.
    #[track_caller]
    pub fn expect_code(self, code: i32) -> Self {
        assert_eq!(self.status.code(), Some(code), "stdout:\n{}\nstderr:\n{}", self.stdout, self.stderr);
        self
    }
}

/// The tiny random ACT checkpoint of both morphologies.
#[must_use]
pub fn act_tiny() -> String {
    let path: PathBuf =
        [env!("CARGO_MANIFEST_DIR"), "..", "policy-host", "tests", "data", "act-tiny"].iter().collect();
    path.canonicalize().unwrap().to_str().unwrap().to_owned()
}

/// The binary that cargo built beside the running test.
fn program() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    test.parent().and_then(Path::parent).unwrap().join("hypogeum-under-test")
}

/// The program with its working folder and its runtime folder in `dir`.
#[must_use]
pub fn hypogeum(dir: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(program());
    command.args(args).current_dir(dir).env("XDG_RUNTIME_DIR", dir);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Runs the program to its end.
#[must_use]
pub fn run(dir: &Path, args: &[&str]) -> Finished {
    finish(hypogeum(dir, args).spawn().unwrap())
}

/// Waits for a started program, killing it at the deadline.
#[must_use]
pub fn finish(mut child: Child) -> Finished {
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
    Finished { status, stdout: stdout.join().unwrap(), stderr: stderr.join().unwrap() }
}

fn read_all(source: &mut impl Read) -> String {
    let mut text = String::new();
    source.read_to_string(&mut text).unwrap();
    text
}

/// One row of a results file, without its times.
pub type Row = Vec<String>;

/// All rows of a results file but their times, in the order of their identity.
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

/// Errors of a results file's episodes.
#[must_use]
pub fn errors(db: &Path) -> Vec<String> {
    let connection = rusqlite::Connection::open(db).unwrap();
    let mut statement =
        connection.prepare("SELECT error FROM episodes WHERE error IS NOT NULL ORDER BY episode").unwrap();
    statement.query_map([], |row| row.get(0)).unwrap().collect::<Result<_, _>>().unwrap()
}

/// Segments in /dev/shm that belong to runs under `dir`, by their processes: none may outlive a run.
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
