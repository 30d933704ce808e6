//! Checkpoint folders, alone or as the subfolders `single` and `bimanual`: one network per morphology.

use std::path::{Path, PathBuf};

use ipc_types::{ControlMode, Morphology};
use thiserror::Error;

use super::CheckpointError;

/// Errors that can occur while loading the networks in a folder or checking them against a run.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum CheckpointFolderError {
    #[error(
        "no checkpoint in {}: neither the folder nor its subfolders `single` and `bimanual` contain {expected}",
        folder.display()
    )]
    NoCheckpoint { folder: PathBuf, expected: &'static str },
    #[error(transparent)]
    Checkpoint(Box<CheckpointError>),
    #[error("checkpoint {} is for {found}, the run has {expected} tasks", folder.display())]
    Morphology { folder: PathBuf, found: String, expected: &'static str },
    #[error("checkpoint {} drives the {robot} robot in {found}, the run in {expected}", folder.display())]
    ControlMode { folder: PathBuf, robot: &'static str, found: &'static str, expected: &'static str },
    #[error("both subfolders of {} contain a checkpoint for {morphology}", folder.display())]
    DuplicateMorphology { folder: PathBuf, morphology: &'static str },
}

impl From<CheckpointError> for CheckpointFolderError {
    fn from(error: CheckpointError) -> Self {
        Self::Checkpoint(Box::new(error))
    }
}

/// Returns the checkpoint folders in `folder`: `folder` itself, or its subfolders `single` and `bimanual`.
/// `is_checkpoint` recognises one by the files that `expected` names.
pub(crate) fn checkpoint_folders(
    folder: &Path,
    expected: &'static str,
    is_checkpoint: impl Fn(&Path) -> bool,
) -> Result<Vec<PathBuf>, CheckpointFolderError> {
    if is_checkpoint(folder) {
        return Ok(vec![folder.to_owned()]);
    }
    let inner = Morphology::ALL.into_iter().map(|morphology| folder.join(morphology.name()));
    let found: Vec<_> = inner.filter(|folder| is_checkpoint(folder)).collect();
    if found.is_empty() {
        return Err(CheckpointFolderError::NoCheckpoint { folder: folder.to_owned(), expected });
    }
    Ok(found)
}

/// Checks the robots and control modes of the networks in `folder` against those of a run.
pub(crate) fn check_robots(
    folder: &Path,
    networks: &[(Morphology, ControlMode)],
    robots: &[(Morphology, ControlMode)],
) -> Result<(), CheckpointFolderError> {
    for &(morphology, control_mode) in robots {
        let Some((_, own)) = networks.iter().find(|(robot, _)| *robot == morphology) else {
            let found: Vec<_> = networks.iter().map(|(robot, _)| robot.name()).collect();
            let (folder, found) = (folder.to_owned(), found.join(", "));
            return Err(CheckpointFolderError::Morphology { folder, found, expected: morphology.name() });
        };
        let (expected, found) = (control_mode.name(), own.name());
        if expected != found {
            let (folder, robot) = (folder.to_owned(), morphology.name());
            return Err(CheckpointFolderError::ControlMode { folder, robot, expected, found });
        }
    }
    Ok(())
}
