//! Checkpoint folders: found from what a user types, alone or as the subfolders `single` and `bimanual` (one
//! network per morphology), and recognised where they are something else.

use std::path::{Path, PathBuf};

use ipc_types::{ControlMode, Morphology};
use run_config::{Execution, QueryOptions};
use thiserror::Error;

use super::error::CheckpointError;
use super::mapping::ObservationMapping;
use crate::policy::execution::{ChunkSettings, TooManyRowsError};
use crate::weights::{CONFIG_FILE, INDEX_FILE, MODEL_FILE};

/// Folder that LeRobot writes into a checkpoint of a training run.
const PRETRAINED: &str = "pretrained_model";
/// Folder of a training run's checkpoints, and LeRobot's link to the latest.
const CHECKPOINTS: &str = "checkpoints";
const LAST: &str = "last";
/// File of a LoRA adapter.
const ADAPTER: &str = "adapter_config.json";

/// Errors that can occur while loading the networks in a folder or checking them against a run.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum CheckpointFolderError {
    #[error(
        "no checkpoint in {}: neither the folder nor its subfolders `single` and `bimanual` contain {expected}; a run of \
         lerobot-train has it in checkpoints/last/pretrained_model",
        folder.display()
    )]
    NoCheckpoint { folder: PathBuf, expected: &'static str },
    #[error("checkpoint {} does not exist", path.display())]
    Absent { path: PathBuf },
    #[error(
        "checkpoint {} does not exist; if it is a model on the Hugging Face hub, download it with `hf download {} \
         --local-dir {}` and name that folder",
        path.display(), path.display(), path.file_name().unwrap_or_default().display()
    )]
    Hub { path: PathBuf },
    #[error(
        "checkpoint {} is a file, expected a folder; python/convert_act_checkpoint.py converts the benchmark's .pt files",
        path.display()
    )]
    File { path: PathBuf },
    #[error(
        "{} contains an adapter (LoRA), not a network: merge it into its base model (peft's `merge_and_unload`, then \
         `save_pretrained`) and name the merged folder",
        folder.display()
    )]
    Adapter { folder: PathBuf },
    #[error(
        "{} contains a JAX checkpoint of openpi: convert it to PyTorch with openpi's \
         examples/convert_jax_model_to_pytorch.py and name the converted folder",
        folder.display()
    )]
    Jax { folder: PathBuf },
    #[error(
        "{} contains weights in PyTorch's own format ({found}), expected {MODEL_FILE}: save them with LeRobot's \
         `save_pretrained`, or convert the benchmark's with python/convert_act_checkpoint.py",
        folder.display()
    )]
    Pickle { folder: PathBuf, found: String },
    #[error(transparent)]
    Checkpoint(Box<CheckpointError>),
    #[error("checkpoint {} is for {found}, the run has {expected} tasks", folder.display())]
    Morphology { folder: PathBuf, found: String, expected: &'static str },
    #[error(
        "checkpoint {} drives the {robot} robot in {found}, the run in {expected}: add --control-mode {found}",
        folder.display()
    )]
    ControlMode { folder: PathBuf, robot: &'static str, found: &'static str, expected: &'static str },
    #[error("both subfolders of {} contain a checkpoint for {morphology}", folder.display())]
    DuplicateMorphology { folder: PathBuf, morphology: &'static str },
    #[error("checkpoint {}", folder.display())]
    Rows { folder: PathBuf, source: TooManyRowsError },
    #[error(
        "the checkpoints in {} were trained for different use of their chunks ({}); choose one with --execute or --mode",
        folder.display(), notes.join("; ")
    )]
    Execution { folder: PathBuf, notes: Vec<String> },
}

impl From<CheckpointError> for CheckpointFolderError {
    fn from(error: CheckpointError) -> Self {
        Self::Checkpoint(Box::new(error))
    }
}

/// Returns the folder that a user means by a path: the checkpoint itself, or the last one of a training run
/// of LeRobot. Symbolic links are resolved, so that a link that moves later changes nothing.
///
/// # Errors
/// If there is nothing, or something else that can be recognised.
pub fn resolve(path: &Path) -> Result<PathBuf, CheckpointFolderError> {
    let path = path.to_owned();
    if path.is_file() {
        return Err(CheckpointFolderError::File { path });
    }
    if !path.exists() {
        let plain = path.components().all(|part| matches!(part, std::path::Component::Normal(_)));
        let is_hub = plain && path.components().count() == 2;
        return Err(if is_hub {
            CheckpointFolderError::Hub { path }
        } else {
            CheckpointFolderError::Absent { path }
        });
    }
    let links = [
        PathBuf::from(PRETRAINED),
        [CHECKPOINTS, LAST, PRETRAINED].iter().collect(),
        [LAST, PRETRAINED].iter().collect(),
    ];
    let numbered = || {
        let folder = if path.file_name().is_some_and(|name| name == CHECKPOINTS) {
            path.clone()
        } else {
            path.join(CHECKPOINTS)
        };
        Some(last_numbered(&folder)?.join(PRETRAINED))
    };
    let own = has_weights_or_subfolders(&path).then(|| path.clone());
    let found = own
        .or_else(|| links.iter().map(|link| path.join(link)).find(|folder| has_weights(folder)))
        .or_else(|| numbered().filter(|folder| has_weights(folder)))
        .unwrap_or_else(|| path.clone());
    refuse_other_kinds(&found)?;
    Ok(std::fs::canonicalize(&found).unwrap_or(found))
}

fn has_weights(folder: &Path) -> bool {
    [CONFIG_FILE, MODEL_FILE, INDEX_FILE].iter().any(|name| folder.join(name).is_file())
}

fn has_weights_or_subfolders(folder: &Path) -> bool {
    has_weights(folder) || Morphology::ALL.iter().any(|robot| has_weights(&folder.join(robot.name())))
}

/// Returns the subfolder whose name is the highest number.
fn last_numbered(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    let number = |path: &PathBuf| path.file_name()?.to_str()?.parse::<u64>().ok();
    entries
        .filter(|path| path.is_dir())
        .filter_map(|path| Some((number(&path)?, path)))
        .max()
        .map(|(_, path)| path)
}

/// Refuses folders that are recognised as other kinds of checkpoints.
fn refuse_other_kinds(folder: &Path) -> Result<(), CheckpointFolderError> {
    let (owned, exists) = (folder.to_owned(), |name: &str| folder.join(name).exists());
    let has_model = exists(MODEL_FILE) || exists(INDEX_FILE);
    if exists(ADAPTER) && !has_model {
        return Err(CheckpointFolderError::Adapter { folder: owned });
    }
    let is_jax = |folder: &Path| folder.join("_METADATA").exists() || folder.join("manifest.ocdbt").exists();
    if !has_model && (is_jax(&folder.join("params")) || is_jax(folder)) {
        return Err(CheckpointFolderError::Jax { folder: owned });
    }
    let pickles = ["pytorch_model.bin", "model.pt", "model.pth", "model.ckpt"];
    match pickles.into_iter().find(|name| !has_model && exists(name)) {
        Some(found) => Err(CheckpointFolderError::Pickle { folder: owned, found: found.to_owned() }),
        None => Ok(()),
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

/// Builds the networks for `robots` from the checkpoints in `folder`, one after another.
///
/// # Errors
/// If two are for the same robot, or the error of `robot_of` or `build`.
pub(crate) fn build_networks<C, N, E: From<CheckpointFolderError>>(
    folder: &Path,
    checkpoints: Vec<C>,
    robots: &[Morphology],
    robot_of: impl Fn(&C) -> Result<Morphology, CheckpointError>,
    mut build: impl FnMut(C) -> Result<N, E>,
) -> Result<Vec<N>, E> {
    let (mut networks, mut found) = (Vec::new(), Vec::new());
    for checkpoint in checkpoints {
        let robot = robot_of(&checkpoint).map_err(CheckpointFolderError::from)?;
        if !robots.contains(&robot) {
            continue;
        }
        if found.contains(&robot) {
            let (folder, morphology) = (folder.to_owned(), robot.name());
            return Err(CheckpointFolderError::DuplicateMorphology { folder, morphology }.into());
        }
        found.push(robot);
        networks.push(build(checkpoint)?);
    }
    Ok(networks)
}

/// Facts about a policy that are known before it is loaded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PolicyCheck {
    /// Use of its chunks, if the policy has a checkpoint.
    pub execution: Option<Execution>,
    /// Inputs of its networks, one per robot of the run.
    pub mappings: Vec<ObservationMapping>,
    /// Sentences for the user about settings of the checkpoint.
    pub notes: Vec<String>,
}

/// Contents of the checkpoint for one robot that matter before it is loaded.
#[derive(Debug)]
pub(crate) struct NetworkCheck {
    pub(crate) mapping: ObservationMapping,
    pub(crate) chunk: ChunkSettings,
    /// Sentences for the user.
    pub(crate) notes: Vec<String>,
}

/// Checks the robots and control modes of the networks in `folder` against those of a run, and resolves how
/// their chunks are executed.
pub(crate) fn check_networks(
    folder: &Path,
    networks: Vec<NetworkCheck>,
    robots: &[(Morphology, ControlMode)],
    requested: QueryOptions,
) -> Result<PolicyCheck, CheckpointFolderError> {
    check_robots(folder, &networks, robots)?;
    let (mut executions, mut mappings, mut notes) = (Vec::new(), Vec::new(), Vec::new());
    let is_used =
        |network: &NetworkCheck| robots.iter().any(|(robot, _)| *robot == network.mapping.morphology);
    for network in networks.into_iter().filter(is_used) {
        let (execution, note) = network
            .chunk
            .resolve(requested)
            .map_err(|source| CheckpointFolderError::Rows { folder: folder.to_owned(), source })?;
        let robot = network.mapping.morphology.name();
        notes.extend(std::iter::once(note).chain(network.notes).map(|note| format!("{robot}: {note}")));
        executions.push(execution);
        mappings.push(network.mapping);
    }
    let longest = executions.iter().copied().max_by_key(|execution| execution.execute);
    // A shorter chunk is used up sooner, which the sim notices.
    let agrees = |execution: &Execution| Some(*execution) == longest || requested.execute.is_some();
    if executions.iter().all(agrees) {
        Ok(PolicyCheck { execution: longest, mappings, notes })
    } else {
        Err(CheckpointFolderError::Execution { folder: folder.to_owned(), notes })
    }
}

fn check_robots(
    folder: &Path,
    networks: &[NetworkCheck],
    robots: &[(Morphology, ControlMode)],
) -> Result<(), CheckpointFolderError> {
    for &(morphology, control_mode) in robots {
        let Some(network) = networks.iter().find(|network| network.mapping.morphology == morphology) else {
            let found: Vec<_> = networks.iter().map(|network| network.mapping.morphology.name()).collect();
            let (folder, found) = (folder.to_owned(), found.join(", "));
            return Err(CheckpointFolderError::Morphology { folder, found, expected: morphology.name() });
        };
        let (expected, found) = (control_mode.name(), network.mapping.control_mode.name());
        if expected != found {
            let (folder, robot) = (folder.to_owned(), morphology.name());
            return Err(CheckpointFolderError::ControlMode { folder, robot, expected, found });
        }
    }
    Ok(())
}
