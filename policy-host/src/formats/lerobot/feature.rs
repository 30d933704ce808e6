//! Features of a network: kinds and shapes as LeRobot's configuration gives them, and the inputs.

use std::collections::BTreeMap;
use std::path::Path;

use ipc_types::ImageSize;
use serde::Deserialize;

use crate::formats::error::CheckpointError;

/// Kind of a feature, under LeRobot's names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub(crate) enum FeatureKind {
    Visual,
    State,
    Env,
    Action,
}

/// Kind and shape of a feature, as a configuration gives them.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FeatureShape {
    #[serde(rename = "type")]
    pub(crate) kind: FeatureKind,
    pub(crate) shape: Vec<usize>,
}

/// An input feature of a checkpoint.
#[derive(Debug)]
pub(crate) struct InputFeature {
    pub(crate) name: String,
    pub(crate) shape: Vec<usize>,
    pub(crate) kind: FeatureKind,
    /// Name of the environment's feature that the preprocessor renames to it; its own name without one.
    pub(crate) source: String,
}

impl FeatureKind {
    /// Returns LeRobot's name.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Visual => "VISUAL",
            Self::State => "STATE",
            Self::Env => "ENV",
            Self::Action => "ACTION",
        }
    }
}

impl InputFeature {
    pub(crate) fn new(name: String, shape: Vec<usize>, kind: FeatureKind) -> Self {
        Self { source: name.clone(), name, shape, kind }
    }

    /// Returns the size of a camera's images.
    pub(crate) fn image_size(&self) -> Option<ImageSize> {
        match self.shape[..] {
            [_, height, width] if self.kind == FeatureKind::Visual => Some(ImageSize { width, height }),
            _ => None,
        }
    }
}

/// Applies the names of a preprocessor, new ones by old ones, to the inputs.
///
/// # Errors
/// If an input has several sources, or none because its own name is given to another.
pub(crate) fn rename(
    inputs: &mut [InputFeature],
    renames: &BTreeMap<String, String>,
    path: &Path,
) -> Result<(), CheckpointError> {
    for input in inputs {
        let sources: Vec<&String> =
            renames.iter().filter(|(_, new)| **new == input.name).map(|(old, _)| old).collect();
        let found = match (&sources[..], renames.get(&input.name)) {
            ([source], _) => {
                input.source = (*source).clone();
                continue;
            }
            ([], None) => continue,
            ([], Some(new)) => format!("`{}` is renamed to `{new}` and nothing to it", input.name),
            (several, _) => format!("{} names for `{}`", several.len(), input.name),
        };
        return Err(CheckpointError::Value {
            path: path.to_owned(),
            key: "rename_map".to_owned(),
            found,
            expected: "one source of every input".to_owned(),
        });
    }
    Ok(())
}
