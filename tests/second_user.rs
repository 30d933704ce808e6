//! A second user on the same machine: another user's process watches a run and tries to read it, to change
//! it, to take names that it will need, and to stall its cleanup. The run's rows must not change.
//!
//! The scenario has its own mount namespace with a `/dev/shm` of its own, so that what the attacker leaves
//! there disturbs nobody else. It needs root, because it acts as two users.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions, Permissions};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt, symlink};
use std::os::unix::net::UnixDatagram;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use support::{FinishedRun, Row, act_tiny, finish, program, rows};

/// User of the run.
const RUNNER: u32 = 54_321;
/// User of the attacker.
const ATTACKER: u32 = 65_534;
/// Maximum duration of a run under attack. Undisturbed, it takes a few seconds.
const RUN_TIMEOUT: Duration = Duration::from_secs(60);
/// Environment variable with the folder of the scenario.
const FOLDER: &str = "HYPOGEUM_TEST_FOLDER";
/// Environment variable with the part that a process plays.
const ROLE: &str = "HYPOGEUM_TEST_ROLE";
/// End of the name of the only segment that can be predicted from the prefix.
const PREDICTABLE: &str = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt";

/// Starts itself twice more: as the scenario in a mount namespace, and as the attacker.
#[test]
#[ignore = "needs root"]
fn second_user_cannot_disturb_a_run() {
    let folder = std::env::var_os(FOLDER).map(PathBuf::from);
    match (std::env::var(ROLE).as_deref(), folder) {
        (Ok("scenario"), Some(folder)) => run_scenario(&folder),
        (Ok("attacker"), Some(folder)) => disturb(folder),
        _ => start_scenario(),
    }
}

/// Returns the command line of another process of this test.
fn command_line(role: &str) -> String {
    format!("env {ROLE}={role} ./test --ignored --exact second_user_cannot_disturb_a_run")
}

fn start_scenario() {
    let dir = tempfile::tempdir().unwrap();
    fs::set_permissions(dir.path(), Permissions::from_mode(0o755)).unwrap();
    fs::copy(program(), dir.path().join("program")).unwrap();
    fs::copy(std::env::current_exe().unwrap(), dir.path().join("test")).unwrap();
    let copied = Command::new("cp").args(["-r", &act_tiny()]).arg(dir.path().join("act")).status().unwrap();
    assert!(copied.success());
    let scenario = command_line("scenario");
    let script = format!("mount -t tmpfs -o mode=1777 tmpfs /dev/shm && exec {scenario}");
    let mut command = Command::new("unshare");
    command.args(["--mount", "sh", "-c", &script]).env(FOLDER, dir.path()).current_dir(dir.path());
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let _ = finish(command.spawn().unwrap()).expect_code(0);
}

/// The part in the mount namespace.
fn run_scenario(dir: &Path) {
    let own = dir.join("own");
    fs::create_dir(&own).unwrap();
    std::os::unix::fs::chown(&own, Some(RUNNER), Some(RUNNER)).unwrap();
    let reference = run_to_end(dir, "reference");
    assert_eq!(reference.len(), 24);
    assert_eq!(segments_of(RUNNER), 0);

    let attacker = attack(dir);
    // The attacker is there before the run starts.
    eventually("the attacker starts", || dir.join("report/started").exists());
    assert_eq!(run_to_end(dir, "attacked"), reference);
    assert_eq!(segments_of(RUNNER), 0, "segments were left");

    // A killed child is cleaned up in spite of the attacker's files, and so is a killed run.
    let run = start(dir, "killed-sim");
    let sim = child_with(run.id(), "sim");
    std::thread::sleep(Duration::from_millis(500));
    kill_process(sim, Signal::KILL).unwrap();
    assert_eq!(finish_in_time(run, dir, "killed-sim"), reference);
    let mut run = start(dir, "killed");
    let children = ["sim", "policy-host"].map(|name| child_with(run.id(), name));
    run.kill().unwrap();
    for child in children {
        // It may have noticed the end of its parent.
        let _ = kill_process(child, Signal::KILL);
    }
    run.wait().unwrap();
    eventually("the children exit", || !is_running(RUNNER));
    assert_eq!(run_to_end(dir, "after-kill"), reference);
    assert_eq!(segments_of(RUNNER), 0, "segments were left");

    let n_planted = segments_of(ATTACKER);
    let report = stop(attacker, dir);
    assert!(n_planted > 50, "the attacker planted {n_planted} files\n{report}");
    for trace in ["arguments were read", "the folder is closed", "a host was refused"] {
        assert!(report.contains(trace), "the attacker has not got to `{trace}`:\n{report}");
    }
    assert!(!report.contains("BREACH"), "{report}");

    // Its files stay, and do not disturb later runs either.
    assert_eq!(run_to_end(dir, "later"), reference);
    assert_eq!(segments_of(RUNNER), 0, "segments were left");
    assert_eq!(fs::read_dir(own.join("hypogeum")).unwrap().count(), 0, "run folders were left");
}

fn as_user(program: PathBuf, user: u32, dir: &Path) -> Command {
    let mut command = Command::new(program);
    command.uid(user).gid(user).current_dir(dir).env("XDG_RUNTIME_DIR", dir.join("own"));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn start(dir: &Path, name: &str) -> Child {
    let act = format!("act=act:{}", dir.join("act").display());
    let mut command = as_user(dir.join("program"), RUNNER, dir);
    command.args(["run", "--policy", "expert", "--policy", "random", "--policy", &act, "--envs", "4"]);
    command.args(["--tasks", "RaiseCube,StackCube", "--episodes", "4", "--threads", "2", "--db"]);
    command.arg(dir.join(format!("own/{name}.db"))).spawn().unwrap()
}

fn run_to_end(dir: &Path, name: &str) -> Vec<Row> {
    finish_in_time(start(dir, name), dir, name)
}

fn finish_in_time(run: Child, dir: &Path, name: &str) -> Vec<Row> {
    let started = Instant::now();
    let FinishedRun { status, stderr, .. } = finish(run);
    let took = started.elapsed();
    assert!(status.success() && took < RUN_TIMEOUT, "{name} took {took:?}: {status}\n{stderr}");
    rows(&dir.join(format!("own/{name}.db")))
}

fn eventually(what: &str, mut holds: impl FnMut() -> bool) {
    let started = Instant::now();
    while !holds() {
        assert!(started.elapsed() < Duration::from_secs(20), "timed out: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Returns the number of files in `/dev/shm` that belong to a user.
fn segments_of(user: u32) -> usize {
    let entries = fs::read_dir("/dev/shm").unwrap().flatten();
    entries.filter(|entry| entry.metadata().is_ok_and(|metadata| metadata.uid() == user)).count()
}

/// Returns `true` if a child of a run works under this prefix.
fn is_in_use(prefix: &str) -> bool {
    let processes = processes_of(RUNNER);
    processes.iter().any(|(_, arguments)| arguments.iter().any(|argument| argument.contains(prefix)))
}

/// Returns the ids and arguments of all processes of a user that can be read.
fn processes_of(user: u32) -> Vec<(i32, Vec<String>)> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let of_user = entries.filter(|entry| entry.metadata().is_ok_and(|metadata| metadata.uid() == user));
    let arguments = |entry: fs::DirEntry| {
        let pid = entry.file_name().to_str()?.parse().ok()?;
        let line = fs::read_to_string(entry.path().join("cmdline")).ok()?;
        Some((pid, line.split('\0').map(str::to_owned).collect()))
    };
    of_user.filter_map(arguments).collect()
}

fn is_running(user: u32) -> bool {
    // A process that has exited and was not waited for has no arguments.
    processes_of(user).iter().any(|(_, arguments)| arguments.len() > 1)
}

/// Waits for the child `subcommand` of the run.
fn child_with(run: u32, subcommand: &str) -> Pid {
    let mut found = None;
    eventually("the child starts", || {
        let is_child = |(pid, arguments): &(i32, Vec<String>)| {
            *pid != run.cast_signed() && arguments.get(1).is_some_and(|word| word == subcommand)
        };
        found = processes_of(RUNNER).into_iter().find(is_child).and_then(|(pid, _)| Pid::from_raw(pid));
        found.is_some()
    });
    found.unwrap()
}

fn attack(dir: &Path) -> Child {
    let report = dir.join("report");
    fs::create_dir(&report).unwrap();
    std::os::unix::fs::chown(&report, Some(ATTACKER), Some(ATTACKER)).unwrap();
    let mut command = as_user("sh".into(), ATTACKER, dir);
    command.args(["-c", &format!("exec {}", command_line("attacker"))]);
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command.env(FOLDER, dir).spawn().unwrap()
}

/// Ends the attacker and returns its report.
fn stop(mut attacker: Child, dir: &Path) -> String {
    let is_alive = attacker.try_wait().unwrap().is_none();
    attacker.kill().unwrap();
    attacker.wait().unwrap();
    assert!(is_alive, "the attacker gave up");
    let read = |entry: fs::DirEntry| fs::read_to_string(entry.path()).unwrap();
    fs::read_dir(dir.join("report")).unwrap().flatten().map(read).collect()
}

/// The attacker. It records each kind of success (`BREACH`) and of failure once.
fn disturb(dir: PathBuf) {
    let [recorded, prefixes, joined] = [const { BTreeSet::new() }; 3];
    let mut attacker = Attacker { dir, recorded, prefixes, joined, n_planted: 0 };
    attacker.record("started");
    loop {
        attacker.watch_processes();
        attacker.watch_segments();
        attacker.try_folders();
    }
}

struct Attacker {
    dir: PathBuf,
    recorded: BTreeSet<String>,
    /// Prefixes of runs.
    prefixes: BTreeSet<String>,
    /// Those that it has tried to join as a policy host.
    joined: BTreeSet<String>,
    n_planted: u32,
}

impl Attacker {
    fn record(&mut self, event: &str) {
        if self.recorded.insert(event.to_owned()) {
            let name = event.replace(|c: char| !c.is_ascii_alphanumeric(), "-");
            fs::write(self.dir.join("report").join(name), format!("{event}\n")).unwrap();
        }
    }

    /// Learns the prefix of a run from the arguments of its children, and tries to join it as one.
    fn watch_processes(&mut self) {
        for (_, arguments) in processes_of(RUNNER) {
            let [_, role, _, config, ..] = arguments.as_slice() else { continue };
            let Some(prefix) = config.split("\"prefix\":\"").nth(1).and_then(|rest| rest.split('"').next())
            else {
                continue;
            };
            self.record("arguments were read");
            self.plant(prefix);
            if role == "policy-host" && self.joined.insert(prefix.to_owned()) {
                let mut command = as_user(self.dir.join("program"), ATTACKER, &self.dir);
                let refused = finish(command.args([role, "--config", config]).spawn().unwrap());
                let is_refused = refused.status.code() == Some(2) && refused.stderr.contains("denied");
                self.record(if is_refused { "a host was refused" } else { "BREACH: a host joined" });
            }
        }
    }

    /// Plants files for every new prefix, and tries to use every segment of the run.
    fn watch_segments(&mut self) {
        for entry in fs::read_dir("/dev/shm").unwrap().flatten() {
            let name = entry.file_name().into_string().unwrap();
            let Some(prefix) = name.match_indices('_').nth(2).map(|(end, _)| &name[..=end]) else { continue };
            self.plant(prefix);
            let Ok(metadata) = entry.metadata() else { continue };
            if metadata.uid() != RUNNER {
                continue;
            }
            let path = entry.path();
            for (what, is_possible) in [
                ("read", File::open(&path).is_ok()),
                ("written", OpenOptions::new().write(true).open(&path).is_ok()),
                ("removed", fs::remove_file(&path).is_ok()),
                ("renamed", fs::rename(&path, "/dev/shm/renamed").is_ok()),
                ("opened to others", fs::set_permissions(&path, Permissions::from_mode(0o666)).is_ok()),
                ("linked", fs::hard_link(&path, format!("/dev/shm/{prefix}link")).is_ok()),
            ] {
                if is_possible {
                    self.record(&format!("BREACH: a segment was {what}"));
                }
            }
            self.take_next_names(prefix, &name);
        }
    }

    /// Takes names that the run might use next: the same kind of file with the following numbers.
    fn take_next_names(&mut self, prefix: &str, name: &str) {
        let Some((stem, ending)) = name.rsplit_once('.') else { return };
        let Some((kind, number)) = stem.rsplit_once('_') else { return };
        let Ok(number) = number.parse::<u128>() else { return };
        // The upper 32 bits count the objects that a process has created.
        for next in [number + (1 << 96), number + 1] {
            let path = format!("/dev/shm/{kind}_{next}.{ending}");
            if self.n_planted < 2000 && File::options().write(true).create_new(true).open(path).is_ok() {
                self.n_planted += 1;
            }
        }
        let _ = symlink("/dev/zero", format!("/dev/shm/{prefix}{}.connection", self.n_planted));
    }

    /// Creates all kinds of files with a prefix, unless it is known.
    fn plant(&mut self, prefix: &str) {
        if !self.prefixes.insert(prefix.to_owned()) {
            return;
        }
        let path = |name: &str| PathBuf::from(format!("/dev/shm/{prefix}{name}"));
        let file = |name: &str, mode: u32, size: u64| {
            let options = OpenOptions::new().write(true).create_new(true).mode(mode).open(path(name));
            options.is_ok_and(|file| {
                file.set_permissions(Permissions::from_mode(mode)).and_then(|()| file.set_len(size)).is_ok()
            })
        };
        // A run that has ended has removed its counter, and nobody misses it then.
        if file(PREDICTABLE, 0o666, 16) && is_in_use(prefix) {
            self.record("BREACH: the node counter was taken");
        }
        for (name, mode, size) in [
            ("a.data", 0o666, 0),
            ("b.data", 0o000, 0),
            ("c.dynamic", 0o666, 3),
            ("d.dynamic", 0o644, 1 << 40),
            ("e.event_mgmt", 0o666, 0),
            ("f.connection", 0o000, 100),
        ] {
            file(name, mode, size);
        }
        let fifo = rustix::fs::FileType::Fifo;
        let _ = rustix::fs::mknodat(rustix::fs::CWD, path("g.data"), fifo, 0o666.into(), 0);
        let _ = symlink("/etc/passwd", path("h.data"));
        let _ = fs::create_dir(path("i.data")).and_then(|()| fs::write(path("i.data").join("x"), ""));
    }

    /// Tries the folder of the runs: its files, its locks and its sockets.
    fn try_folders(&mut self) {
        let base = self.dir.join("own/hypogeum");
        let closed =
            fs::read_dir(&base).is_err_and(|error| error.kind() == std::io::ErrorKind::PermissionDenied);
        if closed {
            self.record("the folder is closed");
        } else if base.exists() {
            self.record("BREACH: the folder is open");
        }
        for prefix in &self.prefixes.clone() {
            let tag = prefix.rsplit('_').nth(1).unwrap();
            let root = base.join(tag);
            if File::open(root.join("claim.lock")).is_ok_and(|lock| lock.try_lock_shared().is_ok()) {
                self.record("BREACH: the lock was taken");
            }
            if UnixDatagram::unbound().unwrap().connect(root.join(format!("{prefix}1.event"))).is_ok() {
                self.record("BREACH: a socket was connected");
            }
            if fs::write(root.join("planted"), "").is_ok()
                || fs::create_dir(base.join("0123456789ab")).is_ok()
            {
                self.record("BREACH: a file was planted");
            }
        }
    }
}
