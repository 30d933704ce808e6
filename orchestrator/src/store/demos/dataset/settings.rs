//! The settings of a dataset, which `meta/hypogeum.json` stores.

use ipc_types::{ControlMode, ImageSize, Morphology};
use run_config::Protocol;
use serde::{Deserialize, Serialize};
use sim::Profile;
use sim::perturb::{Composition, Strength};

use crate::store::demos::image::ImageFormat;

/// The settings that all episodes of a dataset share.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DatasetSettings {
    /// Hash of the code that the episodes depend on. Datasets of earlier versions do not say.
    #[serde(default)]
    pub(crate) code: String,
    pub(crate) morphology: Morphology,
    pub(crate) control_mode: ControlMode,
    pub(crate) perturbation: Composition,
    pub(crate) strength: Strength,
    pub(crate) profile: Profile,
    /// Suite seed of the episodes.
    pub(crate) seed: u64,
    pub(crate) images: ImageFormat,
    /// Factor by which images are downscaled.
    #[serde(default = "no_shrink")]
    pub(crate) shrink: usize,
    /// Protocol for which policies are trained.
    #[serde(default)]
    pub(crate) protocol: Protocol,
}

fn no_shrink() -> usize {
    1
}

impl DatasetSettings {
    /// Returns the size in which images of this size are stored.
    pub(crate) fn stored_size(&self, size: ImageSize) -> ImageSize {
        ImageSize { height: size.height / self.shrink, width: size.width / self.shrink }
    }
}
