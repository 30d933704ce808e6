//! Batches of observations: their size, and their assembly in a loaned message, one record per env, with
//! images rendered in place.

use std::time::Instant;

use ipc_types::frame::EnvBlockMut;
use ipc_types::layout::Page;
use ipc_types::{ImageSizes, Morphology};
use run_config::trace::{self, Activity, CpuTime};

use super::envs::{Envs, LaneTally};
use render::{RenderError, Renderer, View};

/// The cost of rendering one batch.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RenderCost {
    /// Number of images rendered.
    pub(crate) images: u64,
    /// Core-seconds spent rendering.
    pub(crate) core_s: f64,
    /// Wall seconds of rendering on a device; 0 on the CPU.
    pub(crate) device_s: f64,
}

/// Fills batches. It keeps its allocations from one batch to the next.
pub(crate) struct BatchWriter {
    renderer: Box<dyn Renderer>,
    views: Vec<View<'static>>,
}

impl BatchWriter {
    /// Creates a writer for batches of up to `max_envs` envs.
    pub(crate) fn new(renderer: Box<dyn Renderer>, max_envs: usize) -> Self {
        let max_cameras = Morphology::Bimanual.n_external_cameras() + Morphology::Bimanual.n_hand_cameras();
        Self { renderer, views: Vec::with_capacity(max_envs * max_cameras) }
    }

    /// Writes one block per env of `batch` into `pages`. Each env must hold an episode of `morphology`
    /// whose next query is due.
    ///
    /// # Errors
    /// If the renderer fails.
    pub(crate) fn write(
        &mut self,
        envs: &mut Envs,
        batch: &[u32],
        (morphology, sizes): (Morphology, Option<ImageSizes>),
        pages: &mut [Page],
    ) -> Result<RenderCost, RenderError> {
        for slot in batch {
            envs.episode_mut(*slot).expect("a ready env runs an episode").take_snapshot();
        }
        let mut views = recycle(std::mem::take(&mut self.views));
        let block_pages = pages.len() / batch.len();
        for (slot, block) in batch.iter().zip(pages.chunks_exact_mut(block_pages)) {
            let episode = envs.episode(*slot).expect("a ready env runs an episode");
            let Some(scene) = &episode.view else { continue };
            let images = EnvBlockMut::new(morphology, sizes, block).images();
            views.extend(images.enumerate().map(|(camera_idx, out)| View {
                scene,
                snapshot: &episode.snapshot,
                camera_idx,
                out,
            }));
        }
        let (start, cpu_start) = (Instant::now(), CpuTime::of_process());
        let images = views.len();
        if images > 0 {
            let rendering = trace::span(Activity::Render);
            self.renderer.render(&mut views)?;
            rendering.finish(images as u64);
        }
        let core_s = cpu_start.elapsed().as_secs_f64();
        let is_on_device = images > 0 && self.renderer.is_on_device();
        let device_s = if is_on_device { start.elapsed().as_secs_f64() } else { 0.0 };
        self.views = recycle(views);
        // Records come last: a checksum covers what is written from here on, and rendering takes its time.
        for (slot, block) in batch.iter().zip(pages.chunks_exact_mut(block_pages)) {
            let episode = envs.episode_mut(*slot).expect("a ready env runs an episode");
            episode.write_record(*slot, EnvBlockMut::new(morphology, sizes, block).record);
            episode.add_render_time(core_s / batch.len() as f64);
        }
        Ok(RenderCost { images: images as u64, core_s, device_s })
    }
}

/// Clears `views` and returns its allocation for views of another lifetime.
fn recycle<'a>(mut views: Vec<View<'_>>) -> Vec<View<'a>> {
    views.clear();
    views.into_iter().map(|_| unreachable!("the vector was cleared")).collect()
}

/// Returns the number of envs in a lane's next batch; `None` if it is better to wait.
///
/// A query costs less in a large batch, and least if the host's threads divide the batch evenly. So a batch
/// waits until half of the lane's envs are ready, while the host has the other half. It takes no more than
/// half, so that stepping and inference overlap, and leaves the remainder of the division to the next batch.
/// It waits only for envs that are acting: they get ready without an answer.
pub(crate) fn batch_size(tally: LaneTally, max_envs: usize, n_threads: usize) -> Option<usize> {
    let LaneTally { n_used, n_ready, n_acting } = tally;
    let whole = |n: usize| if n > n_threads { n - n % n_threads } else { n };
    let half = n_used.div_ceil(2);
    let limit = n_ready.min(max_envs).min(half.next_multiple_of(n_threads));
    if n_ready == 0 {
        None
    } else if n_acting == 0 {
        Some(limit)
    } else {
        (n_ready >= whole(half.min(max_envs))).then(|| whole(limit))
    }
}
