//! ACT on a GPU: the same network as [`super::model`], as a list of steps that is encoded for each batch.

mod backbone;
mod layers;
mod network;
mod policy;
mod transformer;

pub use policy::{GpuActPolicy, LoadGpuError};

use ipc_types::Morphology;

use super::IMAGE_SIZES;
use super::architecture::ImageSize;

/// Returns the size of the images of a robot's camera, by its index.
fn camera_size(camera: usize) -> ImageSize {
    let [external, hand] = IMAGE_SIZES;
    if camera < Morphology::Single.n_external_cameras() { external } else { hand }
}
