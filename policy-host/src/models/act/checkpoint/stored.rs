//! The networks in a checkpoint folder, one per morphology.

use std::path::{Path, PathBuf};

use ipc_types::Morphology;

use super::Checkpoint;
use crate::formats::folder::checkpoint_folders;
use crate::formats::{CheckpointFolderError, ObservationMapping};
use crate::models::act::architecture::{Architecture, Normalisation};
use crate::text::TextEncoder;
use crate::weights::{CONFIG_FILE, StateDict};

/// Everything that a checkpoint says about one network.
pub(crate) struct StoredNetwork {
    pub(crate) architecture: Architecture,
    pub(crate) normalisation: Normalisation,
    pub(crate) state_dict: StateDict,
    pub(crate) mapping: ObservationMapping,
    pub(crate) encoder: Option<TextEncoder>,
    /// Decay of the temporal ensemble's weights, if the checkpoint specifies one.
    pub(crate) ensemble_decay: Option<f64>,
}

/// Reads the networks for `robots` one after another and passes each to `build`.
///
/// # Errors
/// The first file or tensor that is missing, unexpected or damaged, or the error of `build`.
pub(crate) fn load_networks<N, E: From<CheckpointFolderError>>(
    folder: &Path,
    robots: &[Morphology],
    mut build: impl FnMut(StoredNetwork) -> Result<N, E>,
) -> Result<Vec<N>, E> {
    let (mut networks, mut found) = (Vec::new(), Vec::new());
    for inner in folders(folder)? {
        let Some(stored) = read(&inner, robots)? else { continue };
        let morphology = stored.mapping.morphology;
        if found.contains(&morphology) {
            let (folder, morphology) = (folder.to_owned(), morphology.name());
            return Err(CheckpointFolderError::DuplicateMorphology { folder, morphology }.into());
        }
        found.push(morphology);
        networks.push(build(stored)?);
    }
    Ok(networks)
}

/// Returns the checkpoint folders in `folder`: `folder` itself, or its subfolders `single` and `bimanual`.
pub(crate) fn folders(folder: &Path) -> Result<Vec<PathBuf>, CheckpointFolderError> {
    checkpoint_folders(folder, CONFIG_FILE, |folder| folder.join(CONFIG_FILE).is_file())
}

/// Reads the network in `folder`, unless it is for another robot.
fn read(folder: &Path, robots: &[Morphology]) -> Result<Option<StoredNetwork>, CheckpointFolderError> {
    let mut checkpoint = Checkpoint::open(folder)?;
    let mapping = checkpoint.mapping()?.clone();
    if !robots.contains(&mapping.morphology) {
        return Ok(None);
    }
    let encoder = checkpoint.text_encoder()?;
    let state_dict = checkpoint.state_dict()?;
    Ok(Some(StoredNetwork {
        architecture: checkpoint.architecture().clone(),
        normalisation: checkpoint.normalisation().clone(),
        state_dict,
        mapping,
        encoder,
        ensemble_decay: checkpoint.chunk_settings().ensemble_decay,
    }))
}
