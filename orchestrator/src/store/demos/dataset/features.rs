//! The features of a dataset: their names, and the constants that readers must know.

use ipc_types::ImageSize;
use run_config::ProtocolName;

use crate::store::demos::dataset::settings::DatasetSettings;

/// Frames per second.
pub(crate) const FPS: u32 = 20;
/// Width of the instruction embedding.
pub(crate) const LANGUAGE_DIM: usize = 64;

pub(crate) const STATE: &str = "observation.state";
pub(crate) const LANGUAGE: &str = "observation.environment_state";
pub(crate) const ACTION: &str = "action";

impl DatasetSettings {
    /// Returns `true` if the dataset has the features of the evaluation through LeRobot: joint positions
    /// only, no embedding of the instruction, and cameras with their whole names.
    fn is_lerobot(&self) -> bool {
        self.protocol.protocol == ProtocolName::Lerobot
    }

    /// Returns the parts of the state that the dataset contains: (name, width).
    pub(crate) fn state_parts(&self) -> &'static [(&'static str, usize)] {
        let parts = self.morphology.state_parts();
        if self.is_lerobot() { &parts[..1] } else { parts }
    }

    /// Returns `true` if the dataset contains the embedding of the instruction.
    pub(crate) fn has_embedding(&self) -> bool {
        !self.is_lerobot()
    }

    /// Returns the features of the cameras: name, and size of their stored images.
    pub(crate) fn cameras(&self) -> impl Iterator<Item = (String, ImageSize)> {
        let names = self.morphology.camera_names().iter().enumerate();
        names.map(|(idx, camera)| {
            let short = if self.is_lerobot() { None } else { camera.strip_suffix("_camera") };
            let name = format!("observation.images.{}", short.unwrap_or(camera));
            (name, self.stored_size(self.protocol.image_size.of_camera(self.morphology, idx)))
        })
    }
}
