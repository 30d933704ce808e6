//! Rendering of a dataset's images.

use std::sync::atomic::{AtomicBool, Ordering};

use policy_host::models::act::image::Resizer;
use sim::demo::Recording;
use sim::render::{CpuRenderer, RenderScene};

use crate::store::demos::dataset::{CameraImages, DatasetSettings};

/// Episodes per thread that are being rendered or wait to be written.
pub(crate) const EPISODES_PER_THREAD: usize = 3;

/// Renders the frames of a recording for all cameras. Returns `None` once `stopped` is set.
///
/// # Errors
/// If an image cannot be encoded.
pub(crate) fn render(
    recording: &Recording,
    settings: &DatasetSettings,
    stopped: &AtomicBool,
) -> anyhow::Result<Option<Vec<CameraImages>>> {
    let (morphology, image_size) = (settings.morphology, settings.protocol.image_size);
    let mut renderer = CpuRenderer::new(rayon::current_num_threads());
    let view = RenderScene::new(recording.scene(), image_size);
    let n_cameras = morphology.camera_names().len();
    let sizes = (0..n_cameras).map(|idx| image_size.of_camera(morphology, idx));
    let resizers: Vec<Resizer> = sizes.map(|size| Resizer::new(size, settings.stored_size(size))).collect();
    let mut images = vec![CameraImages::default(); n_cameras];
    for frame in 0..recording.n_frames() {
        if stopped.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let drawn = renderer.render_cameras(&view, recording.snapshot(frame));
        for ((of_camera, resizer), (size, mut pixels)) in images.iter_mut().zip(&resizers).zip(drawn) {
            let stored = settings.stored_size(size);
            if stored != size {
                pixels = resizer.resize(&pixels);
            }
            of_camera.push(&pixels, settings.images.encode(&pixels, stored)?);
        }
    }
    Ok(Some(images))
}
