//! The comparison of a host's checkpoint with the one that the run started with.

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::protocol::HostConfig;
use crate::PolicySpec;
use crate::formats::content::CheckpointContent;

/// A checkpoint whose content is the one that the run started with.
#[derive(Debug)]
pub(crate) struct CheckpointGuard {
    content: CheckpointContent,
    /// `true` if the policy reads weights where they lie in their files, for as long as it lives.
    is_mapped: bool,
}

/// The error of a host whose checkpoint is not the one that the run started with.
#[derive(Debug, Error)]
#[error(
    "the checkpoint {} has changed during the run: its content hash was {expected} at the start and {found}; no episode \
     was recorded with the new content: put the old files back and run the same command again, or evaluate the new ones \
     with another results file",
    folder.display()
)]
pub struct CheckpointChangedError {
    folder: PathBuf,
    expected: String,
    /// The clause on the hash now.
    found: String,
}

impl CheckpointGuard {
    /// Hashes the checkpoint of a host. Returns `None` if the policy has none, or its hash is not known.
    pub(crate) fn new(config: &HostConfig) -> Result<Option<Self>, CheckpointChangedError> {
        let (Some(folder), Some(expected)) = (config.spec.checkpoint(), &config.checkpoint) else {
            return Ok(None);
        };
        let content = CheckpointContent::read(folder).ok().filter(|content| content.hash() == *expected);
        let content = content.ok_or_else(|| CheckpointChangedError::new(folder, expected, None))?;
        let is_mapped =
            matches!(config.spec, PolicySpec::Network(family, _) if family.definition().maps_weights);
        Ok(Some(Self { content, is_mapped }))
    }

    /// Checks that a policy which has just been loaded was read from the files that were hashed.
    pub(crate) fn check_loaded(&self) -> Result<(), CheckpointChangedError> {
        self.content.changed_file().map_or(Ok(()), |file| Err(self.error(&file)))
    }

    /// Checks that the files that a policy still reads have not changed up to now.
    pub(crate) fn check_mapped(&self) -> Result<(), CheckpointChangedError> {
        let changed = if self.is_mapped { self.content.changed_weights() } else { None };
        changed.map_or(Ok(()), |file| Err(self.error(file)))
    }

    fn error(&self, file: &Path) -> CheckpointChangedError {
        CheckpointChangedError::new(self.content.folder(), &self.content.hash(), Some(file))
    }
}

impl CheckpointChangedError {
    /// Hashes the folder once more, for the message. `file` is known to have changed.
    fn new(folder: &Path, expected: &str, file: Option<&Path>) -> Self {
        let found = match CheckpointContent::read(folder).map(|content| content.hash()) {
            // Its content may have been another one meanwhile.
            Ok(now) if now == *expected => {
                let file = file.unwrap_or(folder).display();
                format!("is the same now, but {file} was written to")
            }
            Ok(now) => format!("is {now} now"),
            Err(error) => format!("cannot be computed now ({})", run_config::error_chain(&error)),
        };
        Self { folder: folder.to_owned(), expected: expected.to_owned(), found }
    }
}
