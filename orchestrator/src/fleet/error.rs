//! Errors of a fleet.

use std::path::PathBuf;

use ipc_types::is_refusal;
use ipc_types::link::{LinkError, Shortage};
use run_config::allotment::memory_bounds;
use run_config::error_chain;
use thiserror::Error;

use super::limits::LimitError;
use crate::console::exit;
use crate::fleet::processes::member::ChildExit;

/// Errors that can end a fleet before its work is complete. Finished episodes are stored.
#[derive(Debug, Error)]
pub(crate) enum FleetError {
    #[error("failed to use the folder {} for runs; set XDG_RUNTIME_DIR to a folder of your own", path.display())]
    Base { path: PathBuf, source: BaseError },
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error("failed to write the lane description of {name} to {}", path.display())]
    Attach { name: String, path: PathBuf, source: std::io::Error },
    #[error(
        "another run already waits for a foreign host named `{name}` (its lane is in {}); end that run, or choose \
         another name after `attach:`",
        path.display()
    )]
    NameTaken { name: String, path: PathBuf },
    #[error("failed to start {name} ({})", program.display())]
    Spawn { name: String, program: PathBuf, source: std::io::Error },
    #[error("{name} failed: {message}")]
    Child { name: String, message: String },
    #[error("{name} {exit}")]
    Shortage { name: String, exit: ChildExit, source: Shortage },
    #[error(
        "{name} {exit}, and user {user} has put files with the names of this run into /dev/shm, which stall the \
         cleanup"
    )]
    Intruder { name: String, exit: ChildExit, user: u32 },
    #[error(
        "{} is gone, which this run needs to start a child: somebody has removed it, such as systemd at the end of \
         a login session (RemoveIPC in logind.conf; `loginctl enable-linger` prevents that) or a program that cleans \
         /dev/shm",
        path.display()
    )]
    Vanished { path: PathBuf },
    #[error("{what}; the run's shared memory may be damaged")]
    Stuck { what: String },
    #[error(
        "the kernel has killed {name} {failures} times for lack of memory{}; use a smaller --envs or fewer policies, or \
         allow more memory",
        tightest_limit()
    )]
    OutOfMemory { name: String, failures: u32 },
    #[error(
        "{name} was ended {failures} times from outside; the last time it {exit}: find out who sends that signal"
    )]
    Ended { name: String, failures: u32, exit: ChildExit },
    #[error(
        "{name} has used all core-seconds that the limit of this shell allows a process; lift it (`ulimit -t unlimited`) \
         and run the same command again"
    )]
    CpuTime { name: String },
    #[error(transparent)]
    Limit(#[from] LimitError),
    #[error("{}{}", self.summary(), log_tail(log))]
    TooManyFailures { name: String, failures: u32, exit: ChildExit, log: Vec<String> },
    #[error("{0}")]
    Lane(String),
    #[error("the sim {0}; run the same command to resume")]
    Renderer(String),
    #[error(
        "finished episodes were rendered with {earlier}, but the sim now renders with {now}, whose images differ; choose \
         the same with --renderer and --samples, or use another results file with --db"
    )]
    RendererChanged { earlier: String, now: String },
    #[error(transparent)]
    Observer(anyhow::Error),
}

/// Errors that can occur while preparing the base folder of runs.
#[derive(Debug, Error)]
pub(crate) enum BaseError {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("it belongs to user {owner}")]
    ForeignOwner { owner: u32 },
    #[error("it is {found}; remove it")]
    NotAFolder { found: &'static str },
    #[error("everybody may replace it, because {} has mode {mode:o}; take the write permission of others away", parent.display())]
    OpenParent { parent: PathBuf, mode: u32 },
}

impl FleetError {
    /// Returns the error without the log of the child.
    pub(crate) fn summary(&self) -> String {
        match self {
            Self::TooManyFailures { name, failures, exit, .. } => format!(
                "{name} failed {failures} times without finishing an episode; the last time it {exit}"
            ),
            other => error_chain(other),
        }
    }

    /// Returns `true` if the run may go on in shared memory with other names.
    pub(crate) fn may_go_on_elsewhere(&self) -> bool {
        matches!(self, Self::Intruder { .. } | Self::Vanished { .. } | Self::Stuck { .. })
    }

    /// Returns `true` if the user can fix the error.
    pub(crate) fn is_user_error(&self) -> bool {
        match self {
            Self::Base { .. }
            | Self::Link(_)
            | Self::Attach { .. }
            | Self::NameTaken { .. }
            | Self::Lane(_)
            | Self::Child { .. }
            | Self::Shortage { .. }
            | Self::Intruder { .. }
            | Self::Vanished { .. }
            | Self::OutOfMemory { .. }
            | Self::Ended { .. }
            | Self::CpuTime { .. }
            | Self::Limit(_)
            | Self::Renderer(_)
            | Self::RendererChanged { .. } => true,
            // A full disk, a deleted file, a lock.
            Self::Observer(error) => exit::is_user_error(error),
            // A limit of processes, files or memory.
            Self::Spawn { source, .. } => is_refusal(source),
            Self::TooManyFailures { .. } | Self::Stuck { .. } => false,
        }
    }
}

/// Returns a clause on the limit of memory that is closest.
pub(crate) fn tightest_limit() -> String {
    let tightest = memory_bounds().into_iter().min_by_key(|bound| bound.remaining);
    tightest.map_or_else(String::new, |bound| format!(" ({} MiB: {})", bound.limit >> 20, bound.source))
}

fn log_tail(log: &[String]) -> String {
    if log.is_empty() {
        " (its log is empty)".to_owned()
    } else {
        format!("; the end of its log: {}", log.join(" | "))
    }
}
