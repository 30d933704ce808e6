//! Why a fleet could not finish its work.

use std::path::PathBuf;
use std::time::Duration;

use ipc_types::link::{BudgetError, LinkError};
use thiserror::Error;

use super::member::Death;

/// A fleet that stopped before its work was done. Finished episodes are kept.
#[derive(Debug, Error)]
pub(crate) enum FleetError {
    #[error("failed to use {} for the link: {reason}; set XDG_RUNTIME_DIR to a folder of yours", path.display())]
    Base { path: PathBuf, reason: String },
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error(transparent)]
    Budget(#[from] BudgetError),
    #[error("failed to describe the lane of {name} in {}: {source}", path.display())]
    Attach { name: String, path: PathBuf, source: std::io::Error },
    #[error("failed to start {name} ({}): {source}", program.display())]
    Spawn { name: String, program: PathBuf, source: std::io::Error },
    #[error("{name} was not ready after {} s{log}", patience.as_secs(), log = last_words(log))]
    StartUp { name: String, patience: Duration, log: Vec<String> },
    #[error("{name} died {deaths} times without finishing an episode; at last it {death}{log}", log = last_words(log))]
    GaveUp { name: String, deaths: u32, death: Death, log: Vec<String> },
    #[error("{0}")]
    Lane(String),
    #[error("the sim {0}; the same command continues where it stopped")]
    Renderer(String),
    #[error(
        "finished episodes were drawn with {before}, but the sim now draws with {now}, whose images differ; choose the same \
         with --renderer and --samples, or name another results file with --db"
    )]
    OtherRenderer { before: String, now: String },
    #[error(transparent)]
    Sink(anyhow::Error),
}

impl FleetError {
    /// Whether the user can mend it.
    pub(crate) fn is_users(&self) -> bool {
        match self {
            Self::Base { .. }
            | Self::Link(_)
            | Self::Budget(_)
            | Self::Attach { .. }
            | Self::Lane(_)
            | Self::Renderer(_)
            | Self::OtherRenderer { .. } => true,
            Self::Spawn { .. } | Self::StartUp { .. } | Self::GaveUp { .. } | Self::Sink(_) => false,
        }
    }
}

fn last_words(log: &[String]) -> String {
    if log.is_empty() {
        ", and it had logged nothing".to_owned()
    } else {
        format!("; the end of its log:\n  {}", log.join("\n  "))
    }
}
