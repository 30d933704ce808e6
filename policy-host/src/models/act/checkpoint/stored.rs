//! The networks in a checkpoint folder, one per morphology.

use std::path::Path;

use ipc_types::Morphology;

use super::ActCheckpoint;
use crate::formats::folder::{build_networks, checkpoint_folders};
use crate::formats::{CheckpointError, CheckpointFolderError, ObservationMapping};
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
    let robot_of = |checkpoint: &ActCheckpoint| Ok(checkpoint.mapping()?.morphology);
    build_networks(folder, open_all(folder)?, robots, robot_of, |checkpoint| {
        build(read(checkpoint).map_err(CheckpointFolderError::from)?)
    })
}

/// Opens the checkpoints in `folder`: `folder` itself, or its subfolders `single` and `bimanual`.
///
/// # Errors
/// If there is none, or one is invalid.
pub(crate) fn open_all(folder: &Path) -> Result<Vec<ActCheckpoint>, CheckpointFolderError> {
    let folders = checkpoint_folders(folder, CONFIG_FILE, |folder| folder.join(CONFIG_FILE).is_file())?;
    Ok(folders.iter().map(|folder| ActCheckpoint::open(folder)).collect::<Result<_, _>>()?)
}

fn read(mut checkpoint: ActCheckpoint) -> Result<StoredNetwork, CheckpointError> {
    Ok(StoredNetwork {
        mapping: checkpoint.mapping()?.clone(),
        encoder: checkpoint.text_encoder()?,
        state_dict: checkpoint.state_dict()?,
        architecture: checkpoint.architecture().clone(),
        normalisation: checkpoint.normalisation().clone(),
        ensemble_decay: checkpoint.chunk_settings().ensemble_decay,
    })
}
