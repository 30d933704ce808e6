//! Problems with the machine: limits, full or read-only file systems, folders without rights. Each ends in
//! exit code 2 and one message with the cause and the remedy (docs/troubleshooting.md), loses no results and
//! leaves nothing behind.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs::{self, File, Permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use support::{FinishedRun, act_tiny, finish, hypogeum, hypogeum_after, rows, run};

/// Time within which a run that cannot start has to end.
const PROMPT: Duration = Duration::from_secs(30);

/// Arguments of a short run with two policy hosts.
fn arguments() -> Vec<String> {
    let act = format!("act=act:{}", act_tiny());
    let words = ["run", "--policy", "idle", "--policy", &act, "--tasks", "RaiseCube", "--episodes", "2"];
    words.iter().chain(&["--threads", "2"]).map(|word| (*word).to_owned()).collect()
}

/// Returns a command that makes the short run after a shell script.
fn run_after(dir: &Path, script: &str) -> Command {
    let args = arguments();
    hypogeum_after(dir, script, &args.iter().map(String::as_str).collect::<Vec<_>>())
}

/// Runs `command` and asserts that it ends soon with exit code 2 and one error, which contains `words`, and
/// that no run folder is left.
#[track_caller]
fn assert_refused(dir: &Path, mut command: Command, words: &[&str]) -> FinishedRun {
    let started = Instant::now();
    let finished = finish(command.spawn().unwrap()).expect_code(2);
    assert!(started.elapsed() < PROMPT, "took {:?}", started.elapsed());
    let errors: Vec<&str> = finished.stderr.lines().filter(|line| line.starts_with("error")).collect();
    assert_eq!(errors.len(), 1, "one error: {}", finished.stderr);
    for word in words {
        assert!(errors[0].contains(word), "`{word}` is missing in: {}", finished.stderr);
    }
    assert!(!finished.stderr.contains("panicked"), "{}", finished.stderr);
    let left = fs::read_dir(dir.join("hypogeum")).map_or(0, Iterator::count);
    assert_eq!(left, 0, "run folders were left");
    finished
}

#[test]
fn low_limit_of_open_files_is_named() {
    let dir = tempfile::tempdir().unwrap();
    for limit in [12, 16, 32, 64] {
        let limited = run_after(dir.path(), &format!("ulimit -n {limit}; exec \"$@\""));
        assert_refused(dir.path(), limited, &["open files", &format!("limit is {limit}"), "ulimit -n"]);
    }
    let limited = run_after(dir.path(), "ulimit -n 5; exec \"$@\"");
    let finished = finish({ limited }.spawn().unwrap()).expect_code(2);
    assert!(!finished.stderr.contains("panicked"), "{}", finished.stderr);
    // A soft limit is raised.
    let _ = finish(run_after(dir.path(), "ulimit -S -n 32; exec \"$@\"").spawn().unwrap()).expect_code(0);
}

#[test]
fn low_limit_of_address_space_is_named() {
    let dir = tempfile::tempdir().unwrap();
    for kibibytes in [200_000, 400_000, 1_000_000] {
        let limited = run_after(dir.path(), &format!("ulimit -v {kibibytes}; exec \"$@\""));
        let limit = format!("limit is {kibibytes} KiB");
        assert_refused(dir.path(), limited, &["address space", &limit, "ulimit -v unlimited"]);
    }
}

#[test]
fn limits_that_end_a_process_are_named() {
    let dir = tempfile::tempdir().unwrap();
    // The units are blocks of 512 bytes and core-seconds.
    let limited = run_after(dir.path(), "ulimit -f 100; exec \"$@\"");
    assert_refused(dir.path(), limited, &["files of up to", "ulimit -f unlimited"]);
    let args = ["run", "--policy", "expert", "--tasks", "all", "--episodes", "10", "--db", "large.db"];
    let limited = hypogeum_after(dir.path(), "ulimit -f 400; exec \"$@\"", &args);
    assert_refused(dir.path(), limited, &["large.db", "204800 bytes", "ulimit -f unlimited"]);
    let args = ["run", "--policy", "expert", "--tasks", "all", "--perturbations", "all", "--episodes", "100"];
    let limited = hypogeum_after(dir.path(), "ulimit -t 3; exec \"$@\"", &args);
    assert_refused(dir.path(), limited, &["core-seconds", "ulimit -t unlimited", "same command"]);
    // A small stack is no obstacle: the program asks for its own.
    let _ = finish(run_after(dir.path(), "ulimit -s 64; exec \"$@\"").spawn().unwrap()).expect_code(0);
}

#[test]
fn repeated_kills_from_outside_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let args = ["run", "--policy", "idle", "--tasks", "all", "--episodes", "1000", "--envs", "200"];
    let mut child = hypogeum(dir.path(), &args).spawn().unwrap();
    let orchestrator = support::pid_of(&child);
    let started = Instant::now();
    while child.try_wait().unwrap().is_none() {
        assert!(started.elapsed() < PROMPT, "the run goes on");
        if let Some(sim) = support::find_child(orchestrator, "sim") {
            let _ = rustix::process::kill_process(sim, rustix::process::Signal::KILL);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let finished = finish(child).expect_code(2);
    assert!(finished.stderr.contains("times from outside"), "{}", finished.stderr);
}

/// A control group of version 1 or 2 with limited memory, for processes that enter it by a line of a shell.
struct MemoryGroup(PathBuf);

impl MemoryGroup {
    /// Makes a group; `None` without the right to.
    fn new(mebibytes: u64) -> Option<Self> {
        let name = format!("hypogeum-test-{}", std::process::id());
        let roots = [("/sys/fs/cgroup/memory", "memory.limit_in_bytes"), ("/sys/fs/cgroup", "memory.max")];
        roots.into_iter().find_map(|(root, limit)| {
            let group = Self(Path::new(root).join(&name));
            fs::create_dir(&group.0).ok()?;
            // In version 1, the file must not create the limit: it exists with the controller only.
            let limit = group.0.join(limit);
            let set = limit.exists().then(|| fs::write(&limit, (mebibytes << 20).to_string()).ok()).flatten();
            // Otherwise the kernel would use swap space before it kills.
            let _ = fs::write(group.0.join("memory.swap.max"), "0");
            let _ = fs::write(group.0.join("memory.swappiness"), "0");
            set.map(|()| group)
        })
    }

    fn run(&self, dir: &Path, args: &[&str]) -> FinishedRun {
        let script = format!("echo $$ > {}/cgroup.procs; exec \"$@\"", self.0.display());
        finish(hypogeum_after(dir, &script, args).spawn().unwrap())
    }
}

impl Drop for MemoryGroup {
    fn drop(&mut self) {
        // Its last process may still be exiting.
        for _ in 0..100 {
            if fs::remove_dir(&self.0).is_ok() {
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

#[test]
#[ignore = "needs root and a memory controller"]
fn memory_of_the_control_group_is_what_counts() {
    let group = MemoryGroup::new(90).expect("root may make a control group with a memory controller");
    let dir = tempfile::tempdir().unwrap();
    let act = format!("act=act:{}/../checkpoints/act-all", env!("CARGO_MANIFEST_DIR"));
    let args = ["run", "--tasks", "RaiseCube", "--episodes", "128", "--policy"];
    let fixed = [&args[..], &[&act, "--envs", "128", "--db", "fixed.db"]].concat();
    // While no child is alive, the kernel can only choose the orchestrator. The same command goes on then.
    let mut runs = (0..5).map(|_| group.run(dir.path(), &fixed));
    let finished = runs.find(|run| run.status.code().is_some()).expect("one of five runs ends by itself");
    let finished = finished.expect_code(2);
    let words = ["lack of memory", "(90 MiB: /sys/fs/cgroup/", "--envs"];
    assert!(words.iter().all(|word| finished.stderr.contains(word)), "{}", finished.stderr);
    let finished = group.run(dir.path(), &[&args[..], &["random"]].concat()).expect_code(0);
    assert!(!finished.stderr.contains("lack of memory"), "{}", finished.stderr);
    let finished = group.run(dir.path(), &["doctor", "--json"]).expect_code(0);
    assert!(finished.stdout.contains("of 90 MiB available within"), "{}", finished.stdout);
}

#[test]
fn full_standard_output_keeps_results() {
    let dir = tempfile::tempdir().unwrap();
    let to_full = |args: &[&str]| hypogeum_after(dir.path(), "exec \"$@\" > /dev/full", args);
    let words = ["standard output", "No space left on device", "df -h"];
    assert_refused(dir.path(), run_after(dir.path(), "exec \"$@\" > /dev/full"), &words);
    assert_eq!(rows(&dir.path().join("hypogeum.db")).len(), 4);
    assert_refused(dir.path(), run_after(dir.path(), "exec \"$@\" --json > /dev/full"), &words);
    for args in [&["tasks"][..], &["compare", "hypogeum.db", "--a", "idle", "--b", "act"], &["--help"]] {
        assert_refused(dir.path(), to_full(args), &words);
    }
    let sheet = hypogeum(dir.path(), &["show", "RaiseCube", "-o", "/dev/full"]);
    assert_refused(dir.path(), sheet, &["/dev/full", "No space left on device"]);
}

#[test]
fn unwritable_trace_loses_no_results() {
    let dir = tempfile::tempdir().unwrap();
    let traced = run_after(dir.path(), "exec \"$@\" --trace /dev/full");
    let finished = assert_refused(dir.path(), traced, &["trace /dev/full", "results are complete"]);
    assert!(finished.stdout.contains("success_once"), "{}", finished.stdout);
    assert_eq!(rows(&dir.path().join("hypogeum.db")).len(), 4);
    let traced = run_after(dir.path(), "exec \"$@\" --trace absent/trace.json");
    assert_refused(dir.path(), traced, &["absent/trace.json", "No such file"]);
}

#[test]
fn results_file_without_a_place_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let words = ["absent/x.db", "its folder does not exist; create it"];
    assert_refused(dir.path(), run_after(dir.path(), "exec \"$@\" --db absent/x.db"), &words);
    let words = ["/dev/full", "not a regular file", "--db"];
    assert_refused(dir.path(), run_after(dir.path(), "exec \"$@\" --db /dev/full"), &words);
}

#[test]
fn results_file_locked_in_mid_run_resumes() {
    let dir = tempfile::tempdir().unwrap();
    let args = ["run", "--policy", "expert", "--tasks", "all", "--episodes", "10", "--db", "x.db"];
    let child = hypogeum(dir.path(), &args).spawn().unwrap();
    let path = dir.path().join("x.db");
    let count = |connection: &rusqlite::Connection| {
        connection.query_row("SELECT count(*) FROM episodes", [], |row| row.get::<_, u32>(0)).unwrap_or(0)
    };
    let started = Instant::now();
    let other = loop {
        assert!(started.elapsed() < PROMPT, "no episode was stored");
        std::thread::sleep(Duration::from_millis(50));
        if !path.exists() {
            continue;
        }
        let other = rusqlite::Connection::open(&path).unwrap();
        if count(&other) > 3 && other.execute_batch("BEGIN IMMEDIATE").is_ok() {
            break other;
        }
    };
    let n_before = count(&other);
    let finished = finish(child).expect_code(2);
    assert!(
        finished.stderr.contains("database is locked; finished episodes are stored"),
        "{}",
        finished.stderr
    );
    drop(other);
    assert_eq!(rows(&path).len() as u32, n_before);
    let _ = run(dir.path(), &args).expect_code(0);
    assert_eq!(rows(&path).len(), 280);
}

#[test]
fn unusable_runtime_folder_falls_back() {
    let dir = tempfile::tempdir().unwrap();
    File::create(dir.path().join("file")).unwrap();
    fs::create_dir(dir.path().join("relative")).unwrap();
    for (number, value) in ["", "relative", "/nonexistent", "file"].iter().enumerate() {
        let script = format!("XDG_RUNTIME_DIR='{value}' exec \"$@\" --db {number}.db");
        let _ = finish(run_after(dir.path(), &script).spawn().unwrap()).expect_code(0);
    }
    let _ =
        finish(run_after(dir.path(), "unset XDG_RUNTIME_DIR; exec \"$@\"").spawn().unwrap()).expect_code(0);
    assert!(fs::read_dir(dir.path().join("relative")).unwrap().next().is_none());
}

#[test]
fn run_folder_is_closed_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let base = dir.path().join("hypogeum");
    fs::create_dir(&base).unwrap();
    fs::set_permissions(&base, Permissions::from_mode(0o777)).unwrap();
    let _ = finish(run_after(dir.path(), "exec \"$@\"").spawn().unwrap()).expect_code(0);
    assert_eq!(fs::metadata(&base).unwrap().mode() & 0o777, 0o700);
    fs::remove_file(dir.path().join("hypogeum.db")).unwrap();

    fs::rename(&base, dir.path().join("target")).unwrap();
    symlink(dir.path().join("target"), &base).unwrap();
    assert_refused(dir.path(), run_after(dir.path(), "exec \"$@\""), &["symbolic link", "XDG_RUNTIME_DIR"]);
    fs::remove_file(&base).unwrap();
    symlink("/nonexistent", &base).unwrap();
    assert_refused(dir.path(), run_after(dir.path(), "exec \"$@\""), &["symbolic link", "XDG_RUNTIME_DIR"]);
    fs::remove_file(&base).unwrap();
    File::create(&base).unwrap();
    assert_refused(dir.path(), run_after(dir.path(), "exec \"$@\""), &["no folder; remove it"]);
    fs::remove_file(&base).unwrap();

    let open = dir.path().join("open");
    fs::create_dir(&open).unwrap();
    fs::set_permissions(&open, Permissions::from_mode(0o777)).unwrap();
    let script = format!("XDG_RUNTIME_DIR={} exec \"$@\"", open.display());
    assert_refused(dir.path(), run_after(dir.path(), &script), &["everybody", "mode 777"]);

    let long = dir.path().join("x".repeat(60));
    fs::create_dir(&long).unwrap();
    let script = format!("XDG_RUNTIME_DIR={} exec \"$@\"", long.display());
    let words = ["socket paths would be too long", "XDG_RUNTIME_DIR to a folder with a shorter path"];
    assert_refused(dir.path(), run_after(dir.path(), &script), &words);
}

/// Returns a command that makes the short run in a mount namespace of its own, after a shell script of
/// mounts.
fn run_with_mounts(dir: &Path, script: &str) -> Command {
    let inner = run_after(dir, script);
    let mut command = Command::new("unshare");
    command.args(namespace_options()).arg("sh").args(inner.get_args());
    command.current_dir(dir).env("XDG_RUNTIME_DIR", dir);
    command.stdin(std::process::Stdio::null());
    command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
    command
}

/// Options of unshare(1): a mount namespace, and for an ordinary user one of users, too.
fn namespace_options() -> &'static [&'static str] {
    if rustix::process::geteuid().is_root() { &["--mount"] } else { &["--map-root-user", "--mount"] }
}

#[test]
#[ignore = "needs mount namespaces: root, or user namespaces"]
fn shared_memory_without_room_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let cases: [(&str, &[&str]); 5] = [
        ("-o ro", &["Read-only file system", "mode 1777"]),
        ("-o size=8k", &["in /dev/shm", "are free", "--envs"]),
        ("-o nr_inodes=2", &["files in /dev/shm", "nr_inodes", "df -i"]),
        ("-o nr_inodes=20", &["files in /dev/shm", "nr_inodes", "df -i"]),
        ("-o size=16k,nr_inodes=1000", &["in /dev/shm", "are free", "--shm-size"]),
    ];
    for (options, words) in cases {
        let mounted =
            run_with_mounts(dir.path(), &format!("mount -t tmpfs {options} tmpfs /dev/shm && exec \"$@\""));
        assert_refused(dir.path(), mounted, words);
    }
}

#[test]
#[ignore = "needs mount namespaces: root, or user namespaces"]
fn shared_memory_that_fills_up_is_named() {
    let dir = tempfile::tempdir().unwrap();
    // The checks before the start pass; then somebody else takes what is left.
    let started =
        "set -- /dev/shm/*.global_mgmt; until [ -e \"$1\" ]; do set -- /dev/shm/*.global_mgmt; done";
    let fillers = [
        ("dd if=/dev/zero of=/dev/shm/rest bs=64k 2> /dev/null", ["/dev/shm", "free"]),
        ("i=0; while true > /dev/shm/rest$i; do i=$((i + 1)); done 2> /dev/null", ["/dev/shm", "inodes"]),
    ];
    for (filler, words) in fillers {
        let size = "size=12m,nr_inodes=120";
        let script =
            format!("mount -t tmpfs -o {size} tmpfs /dev/shm && {{ ({started}; {filler}) & exec \"$@\"; }}");
        // The run may be faster than the filler.
        let is_refused = |_: &i32| {
            let _ = fs::remove_file(dir.path().join("hypogeum.db"));
            let finished = finish(run_with_mounts(dir.path(), &script).spawn().unwrap());
            if finished.status.success() {
                return false;
            }
            let finished = finished.expect_code(2);
            let error = finished.stderr.lines().find(|line| line.starts_with("error")).unwrap_or_default();
            assert!(words.iter().all(|word| error.contains(word)), "{words:?}: {}", finished.stderr);
            true
        };
        assert!((0..10).find(is_refused).is_some(), "no run was disturbed by {filler}");
    }
}

#[test]
#[ignore = "needs mount namespaces: root, or user namespaces"]
fn full_or_closed_file_systems_are_named() {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir(dir.path().join("m")).unwrap();
    let full = "mount -t tmpfs -o size=4k tmpfs m && echo > m/rest";
    let with_runtime = format!("XDG_RUNTIME_DIR={}/m exec \"$@\"", dir.path().display());
    let cases: [(&str, &str, &[&str]); 6] = [
        (full, "exec \"$@\" --db m/x.db", &["m/x.db", "full", "0 KiB free", "--db"]),
        ("mount -t tmpfs -o size=40k tmpfs m", "exec \"$@\" --db m/x.db", &["m/x.db", "KiB free", "--db"]),
        ("mount -t tmpfs -o ro tmpfs m", "exec \"$@\" --db m/x.db", &["m/x.db", "Read-only"]),
        (full, &with_runtime, &["m/hypogeum", "are free", "XDG_RUNTIME_DIR"]),
        ("mount -t tmpfs -o nr_inodes=6 tmpfs m", &with_runtime, &["m/hypogeum", "inodes"]),
        ("mount -t tmpfs -o ro tmpfs m", &with_runtime, &["m/hypogeum", "Read-only", "XDG_RUNTIME_DIR"]),
    ];
    for (mounts, exec, words) in cases {
        assert_refused(dir.path(), run_with_mounts(dir.path(), &format!("{mounts} && {exec}")), words);
    }
}

#[test]
#[ignore = "needs mount namespaces: root, or user namespaces"]
fn missing_proc_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let hidden = run_with_mounts(dir.path(), "mount -t tmpfs tmpfs /proc && exec \"$@\"");
    assert_refused(dir.path(), hidden, &["/proc/self/exe", "mount -t proc"]);
}

#[test]
#[ignore = "needs root"]
fn missing_rights_and_processes_are_named() {
    let dir = tempfile::tempdir().unwrap();
    fs::set_permissions(dir.path(), Permissions::from_mode(0o755)).unwrap();
    fs::copy(support::program(), dir.path().join("program")).unwrap();
    let as_user = "exec setpriv --reuid 54321 --regid 54321 --clear-groups ./program";
    let args = "run --policy idle --tasks RaiseCube --episodes 2 --db own/x.db --threads 2";
    fs::create_dir(dir.path().join("own")).unwrap();
    std::os::unix::fs::chown(dir.path().join("own"), Some(54321), Some(54321)).unwrap();
    let own = format!("export XDG_RUNTIME_DIR={}/own", dir.path().display());

    let closed = format!("mount -t tmpfs -o mode=0755 tmpfs /dev/shm && {own} && {as_user} {args}");
    let words = ["/dev/shm", "Permission denied", "mode 1777"];
    assert_refused(dir.path(), run_with_mounts(dir.path(), &closed), &words);
    // The umask takes the owner's rights away, which the program restores for its own files.
    let masked = format!("{own} && umask 777 && {as_user} {args}").replace("own/x.db", "own/masked.db");
    let _ = finish(run_with_mounts(dir.path(), &masked).spawn().unwrap()).expect_code(0);
    let foreign = format!("{as_user} {args}");
    assert_refused(
        dir.path(),
        run_with_mounts(dir.path(), &foreign),
        &["Permission denied", "XDG_RUNTIME_DIR"],
    );
    fs::remove_dir(dir.path().join("own/hypogeum")).unwrap();
    fs::create_dir(dir.path().join("own/hypogeum")).unwrap();
    assert_refused(
        dir.path(),
        run_with_mounts(dir.path(), &format!("{own} && {as_user} {args}")),
        &["belongs to user 0", "XDG_RUNTIME_DIR"],
    );
    fs::remove_dir(dir.path().join("own/hypogeum")).unwrap();
    for limit in [1, 2, 4, 6, 8, 10] {
        let limited =
            format!("{own} && {as_user} {args}").replace("./", &format!("prlimit --nproc={limit} ./"));
        assert_refused(dir.path(), run_with_mounts(dir.path(), &limited), &["ulimit -u", "--threads"]);
    }
}

#[test]
fn doctor_reproduces_the_reference_episode() {
    let dir = tempfile::tempdir().unwrap();
    let finished = run(dir.path(), &["doctor", "--json"]).expect_code(0);
    let report: serde_json::Value = serde_json::from_str(&finished.stdout).unwrap();
    let status = |name: &str| {
        let checks = report["checks"].as_array().unwrap();
        checks.iter().find(|check| check["name"] == name).unwrap()["status"].clone()
    };
    assert_eq!((status("episode fingerprint"), status("image checksum")), ("ok".into(), "ok".into()));
    assert_eq!(
        run(dir.path(), &["doctor", "--python", "/absent"]).expect_code(0).stdout.matches("/absent").count(),
        1
    );
}
