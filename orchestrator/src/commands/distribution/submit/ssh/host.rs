//! The machines of `--hosts`.

use std::collections::BTreeSet;
use std::str::FromStr;

use anyhow::{Result, ensure};

/// Largest number of shards that a machine runs at a time.
const MAX_TASKS: u32 = 1024;

/// A machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct SshHost {
    /// Name as for ssh, perhaps with a user.
    pub(crate) name: String,
    /// Number of shards that it runs at a time.
    pub(crate) n_tasks: u32,
}

impl FromStr for SshHost {
    type Err = String;

    /// Parses `HOST` or `HOST:N`.
    fn from_str(typed: &str) -> Result<Self, String> {
        let (name, n_tasks) = match typed.split_once(':') {
            None => (typed, Some(1)),
            Some((name, n)) => (name, n.parse().ok().filter(|n| (1..=MAX_TASKS).contains(n))),
        };
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "._-@".contains(c);
        if name.is_empty() || name.starts_with('-') || !name.chars().all(is_plain) {
            return Err("expected HOST, USER@HOST or HOST:N".to_owned());
        }
        let n_tasks = n_tasks.ok_or_else(|| format!("expected 1 to {MAX_TASKS} shards after the colon"))?;
        Ok(Self { name: name.to_owned(), n_tasks })
    }
}

/// Checks that no machine is named twice.
///
/// # Errors
/// If one is.
pub(crate) fn check_hosts(hosts: &[SshHost]) -> Result<()> {
    let mut names = BTreeSet::new();
    for SshHost { name, .. } in hosts {
        ensure!(names.insert(name), "--hosts names {name} twice: write {name}:2 for two shards at a time");
    }
    Ok(())
}
