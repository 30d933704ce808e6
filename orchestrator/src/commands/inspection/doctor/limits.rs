//! The limits in force: cores, memory, those of the shell, and what becomes of shared memory at logout.

use std::path::Path;

use run_config::allotment::{core_bounds, memory_bounds, n_cores};
use rustix::process::{Resource, getrlimit, getuid};

use crate::commands::inspection::doctor::check::{Check, CheckStatus};

/// Memory below which few envs fit, in bytes.
const COMFORTABLE_MEMORY: u64 = 1 << 30;
/// Folders with the settings of systemd's login manager; the first takes precedence.
const LOGIND: [&str; 3] = ["/etc/systemd", "/run/systemd", "/usr/lib/systemd"];
/// Lowest user id of a person. The login manager spares the shared memory of system users.
const FIRST_PERSON: u32 = 1000;

/// Tells how many cores runs use, and what says so.
pub(crate) fn cores() -> Check {
    let bounds = core_bounds();
    let bounds: Vec<_> = bounds.iter().map(|bound| format!("{} by {}", bound.limit, bound.source)).collect();
    Check::ok("cores", format!("{} in use ({})", n_cores(), bounds.join(", ")))
}

/// Tells how much memory runs may use, and what says so.
pub(crate) fn memory() -> Check {
    const NAME: &str = "memory";
    let bounds = memory_bounds();
    let mebibytes = |bytes: u64| bytes >> 20;
    let texts = bounds.iter().map(|bound| {
        let (remaining, limit) = (mebibytes(bound.remaining), mebibytes(bound.limit));
        format!("{remaining} of {limit} MiB available within {}", bound.source)
    });
    let found = texts.collect::<Vec<_>>().join(", ");
    match bounds.iter().map(|bound| bound.remaining).min() {
        None => Check::new(NAME, CheckStatus::Warning, "the system tells nothing", "choose --envs yourself"),
        Some(least) if least < COMFORTABLE_MEMORY => {
            let advice = "runs use few envs; allow more memory for more speed";
            Check::new(NAME, CheckStatus::Warning, found, advice)
        }
        Some(_) => Check::ok(NAME, found),
    }
}

/// Lists the limits of the shell.
pub(crate) fn resources() -> Check {
    let limits = [
        ("open files", Resource::Nofile, "-n"),
        ("processes", Resource::Nproc, "-u"),
        ("address space", Resource::As, "-v"),
        ("file size", Resource::Fsize, "-f"),
        ("core-seconds", Resource::Cpu, "-t"),
        ("locked memory", Resource::Memlock, "-l"),
        ("stack", Resource::Stack, "-s"),
    ];
    let texts = limits.map(|(name, resource, flag)| {
        let limit = getrlimit(resource).current;
        let limit = limit.map_or_else(|| "unlimited".to_owned(), |limit| limit.to_string());
        format!("{name} {limit} ({flag})")
    });
    let found = texts.join(", ");
    let ends = [Resource::Fsize, Resource::Cpu].map(|resource| getrlimit(resource).current.is_some());
    if ends.contains(&true) {
        let advice = "long runs may end early; lift the limits: `ulimit -f unlimited -t unlimited`";
        return Check::new("limits", CheckStatus::Warning, found, advice);
    }
    Check::ok("limits", found)
}

/// Tells whether the shared memory of a run survives the end of the login session.
pub(crate) fn logout() -> Check {
    const NAME: &str = "logout";
    let uid = getuid().as_raw();
    if !Path::new("/run/systemd/system").exists() {
        return Check::ok(NAME, "no systemd, which would remove shared memory at the end of a session");
    }
    if uid < FIRST_PERSON {
        return Check::ok(NAME, "systemd keeps the shared memory of this user (a system user)");
    }
    let user = std::env::var("USER").unwrap_or_default();
    if !user.is_empty() && Path::new("/var/lib/systemd/linger").join(user).exists() {
        return Check::ok(NAME, "this user lingers, so that runs survive the end of a session");
    }
    match remove_ipc() {
        Some(false) => Check::ok(NAME, "RemoveIPC=no: runs survive the end of a session"),
        set => {
            let found = if set.is_some() { "RemoveIPC=yes" } else { "RemoveIPC is not set, which means yes" };
            let found = format!("{found}: systemd removes shared memory at the end of the last session");
            let advice = "before leaving a run alone: `loginctl enable-linger`";
            Check::new(NAME, CheckStatus::Warning, found, advice)
        }
    }
}

/// Returns the value of the setting that counts, if there is one.
fn remove_ipc() -> Option<bool> {
    let drop_ins = |folder: &str| {
        let entries = std::fs::read_dir(Path::new(folder).join("logind.conf.d")).into_iter().flatten();
        let mut paths: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
        paths.sort();
        paths
    };
    let files = LOGIND
        .iter()
        .rev()
        .flat_map(|folder| std::iter::once(Path::new(folder).join("logind.conf")).chain(drop_ins(folder)));
    let texts = files.filter_map(|path| std::fs::read_to_string(path).ok());
    let values = texts.flat_map(|text| {
        let lines: Vec<_> =
            text.lines().filter_map(|line| line.trim().strip_prefix("RemoveIPC=")).map(is_yes).collect();
        lines
    });
    values.last()
}

/// Reads a truth value as systemd does.
fn is_yes(value: &str) -> bool {
    matches!(value.trim().to_ascii_lowercase().as_str(), "1" | "yes" | "y" | "true" | "t" | "on")
}
