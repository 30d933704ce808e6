//! Chunks of views: how many are rendered at a time, and the device memory that they take.

use bytemuck::{Pod, Zeroable};
use ipc_types::{ImageSize, ImageSizes};

use gpu::{AdapterKind, GpuDevice};

use super::records::{INSTANCE_BYTES, PoseRecord, ViewRecord};
use crate::View;
use crate::renderer::OpenRendererError;
use crate::shading::SHADOW_MAP_SIDE;
use run_config::Samples;

/// Device memory that a chunk may take on a GPU; the rest is left to the policies. Not yet tuned on a GPU.
const MAX_CHUNK_BYTES: u64 = 1 << 30;
/// Number of envs of a batch that is not split. Not yet tuned on a GPU.
const MIN_CHUNK_ENVS: u64 = 32;
/// Number of chunks into which larger batches are split at least, so that the device renders one while the
/// host copies another.
const MIN_CHUNKS: u64 = 4;
/// Number of envs per chunk on a software driver. From 64 on, Mesa's lavapipe takes ten times as long for
/// each.
const SOFTWARE_ENVS: u64 = 32;

/// Number of views that one dispatch can take: the limit that every device guarantees.
const MAX_VIEWS: u64 = 65_535;
/// Size of a block of triangles, or of a large triangle, in bytes.
pub(crate) const LIST_ENTRY_BYTES: u64 = 8;
/// Bytes before a list, for its length.
const LIST_HEADER_BYTES: u64 = 8;
/// Number of large triangles per view for which there is room, twice as many with four samples per pixel. Of
/// the suite's scenes, DualArmDrawerOpen and DualArmDrawerPlace have the most: 480 per view, and 900. Single
/// threads rasterise those beyond, slowly, and not entirely on a software driver that limits loops.
const LARGE_PER_VIEW: u64 = 1024;
/// Number of samples for each large triangle for which there is room in larger images.
const SAMPLES_PER_LARGE: u64 = 64;
/// Side of the pixel tile that a workgroup shades.
pub(crate) const TILE: u32 = 8;

/// Number of counts in a [`ChunkSize`].
const N_COUNTS: usize = size_of::<ChunkSize>() / size_of::<u64>();

/// Upper bounds of what a chunk of views takes up.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct ChunkSize {
    /// Number of images.
    pub(crate) images: u64,
    /// Number of pixels of all images, in whole tiles.
    pub(crate) pixels: u64,
    /// Number of shadow maps.
    pub(crate) shadow_maps: u64,
    /// Number of instances in all images and shadow maps.
    pub(crate) instances: u64,
    /// Number of blocks of triangles in all images.
    pub(crate) image_blocks: u64,
    /// Number of blocks of triangles in all shadow maps.
    pub(crate) map_blocks: u64,
    /// Number of poses of bodies and links.
    pub(crate) poses: u64,
}

/// Sizes of the buffers of a chunk in bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct ChunkBytes {
    pub(crate) views: u64,
    pub(crate) poses: u64,
    pub(crate) instances: u64,
    /// Packed images, on the device and, twice, in readback buffers.
    pub(crate) images: u64,
    pub(crate) image_blocks: u64,
    pub(crate) map_blocks: u64,
    pub(crate) large_triangles: u64,
    /// Visibility per sample of the images.
    pub(crate) samples: u64,
    /// Heights of the shadow maps.
    pub(crate) heights: u64,
}

/// The largest chunks that a device renders.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChunkLimits {
    /// Size of the largest env.
    env: ChunkSize,
    /// Number of envs in the largest chunk.
    pub(crate) n_envs: u64,
    /// Size of the largest chunk.
    pub(crate) largest: ChunkSize,
    /// Sizes of its buffers.
    pub(crate) bytes: ChunkBytes,
    /// Sum of all of them.
    pub(crate) total_bytes: u64,
}

impl ChunkLimits {
    /// Determines the limits from those of the device and from the memory that an env takes.
    ///
    /// # Errors
    /// If the device has no room for an env with images of these `sizes`.
    pub(crate) fn new(
        gpu: &GpuDevice,
        kind: AdapterKind,
        samples_per_axis: u32,
        sizes: ImageSizes,
    ) -> Result<Self, OpenRendererError> {
        let env = ChunkSize::of_env(sizes);
        let (bytes, most) = (env.bytes(samples_per_axis), gpu.max_buffer_bytes());
        if bytes.largest() > most {
            let [needed, most] = [bytes.largest(), most].map(|n| n.div_ceil(1 << 20));
            let message = format!(
                "the images of one env, {sizes}, need a buffer of {needed} MiB, but the device allows {most} MiB; choose smaller images"
            );
            return Err(OpenRendererError::Device { name: gpu.name().to_owned(), message });
        }
        let wanted = match kind {
            AdapterKind::Hardware => u64::MAX,
            AdapterKind::Software => SOFTWARE_ENVS,
        };
        let wanted = wanted.min(MAX_CHUNK_BYTES / bytes.total()).min(most / bytes.largest());
        let n_envs = wanted.min(MAX_VIEWS / env.n_views()).max(1);
        let largest = env.times(n_envs);
        let bytes = largest.bytes(samples_per_axis);
        Ok(Self { env, n_envs, largest, bytes, total_bytes: bytes.total() })
    }

    /// Returns the limit for the chunks of a batch with this many pixels.
    pub(crate) fn for_batch(&self, n_pixels: u64) -> ChunkSize {
        let share = n_pixels.div_ceil(MIN_CHUNKS).max(MIN_CHUNK_ENVS * self.env.pixels);
        ChunkSize { pixels: self.largest.pixels.min(share), ..self.largest }
    }
}

impl ChunkSize {
    /// Returns the size of the largest env of the benchmark: two external cameras, two hand cameras and a
    /// shadow map.
    fn of_env(sizes: ImageSizes) -> Self {
        Self {
            images: 4,
            pixels: 2 * n_pixels(sizes.external) + 2 * n_pixels(sizes.hand),
            shadow_maps: 1,
            instances: 5 * 160,
            image_blocks: 4 * 1200,
            map_blocks: 1200,
            poses: 48,
        }
    }

    /// Returns the sum of two sizes.
    pub(crate) fn plus(self, other: Self) -> Self {
        let (size, other) = (self.counts(), other.counts());
        bytemuck::cast(core::array::from_fn::<_, N_COUNTS, _>(|i| size[i] + other[i]))
    }

    /// Returns `true` if nothing exceeds the limit.
    pub(crate) fn fits(self, limit: Self) -> bool {
        self.counts().iter().zip(limit.counts()).all(|(size, limit)| *size <= limit)
    }

    /// Returns the sizes of the buffers, for `samples_per_axis` samples per pixel along each axis.
    pub(crate) fn bytes(self, samples_per_axis: u32) -> ChunkBytes {
        let samples = self.pixels * u64::from(samples_per_axis * samples_per_axis);
        let n_large = self.n_views() * LARGE_PER_VIEW * u64::from(samples_per_axis);
        let list = |n: u64| LIST_HEADER_BYTES + n * LIST_ENTRY_BYTES;
        ChunkBytes {
            views: self.n_views() * size_of::<ViewRecord>() as u64,
            poses: self.poses * size_of::<PoseRecord>() as u64,
            instances: self.instances * INSTANCE_BYTES,
            images: self.pixels * 3,
            image_blocks: list(self.image_blocks),
            map_blocks: list(self.map_blocks),
            large_triangles: list(n_large.max(samples / SAMPLES_PER_LARGE)),
            samples: samples * 8,
            heights: self.shadow_maps * u64::from(SHADOW_MAP_SIDE.pow(2)) * 4,
        }
    }

    const fn n_views(self) -> u64 {
        self.images + self.shadow_maps
    }

    fn times(self, n: u64) -> Self {
        bytemuck::cast(self.counts().map(|count| count * n))
    }

    fn counts(self) -> [u64; N_COUNTS] {
        bytemuck::cast(self)
    }
}

impl ChunkBytes {
    /// Returns the size of all buffers, with the images three times.
    fn total(self) -> u64 {
        self.sizes().iter().sum::<u64>() + 2 * self.images
    }

    /// Returns the size of the largest buffer.
    fn largest(self) -> u64 {
        self.sizes().into_iter().fold(0, u64::max)
    }

    fn sizes(self) -> [u64; size_of::<Self>() / size_of::<u64>()] {
        bytemuck::cast(self)
    }
}

/// Returns the number of samples per pixel along each axis.
pub(crate) const fn samples_per_axis(samples: Samples) -> u32 {
    match samples {
        Samples::One => 1,
        Samples::Four => 2,
    }
}

/// Returns the numbers of columns and rows of the tiles that cover an image.
pub(crate) fn whole_tiles(size: ImageSize) -> [u32; 2] {
    [size.width, size.height].map(|n_px| (n_px as u32).next_multiple_of(TILE))
}

/// Returns the number of pixels that the image of a view takes on the device.
pub(crate) fn n_device_pixels(view: &View<'_>) -> u64 {
    n_pixels(view.scene.size(view.camera_idx))
}

fn n_pixels(size: ImageSize) -> u64 {
    whole_tiles(size).map(u64::from).iter().product()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RenderScene;
    use scene::N_LINKS;
    use scene::stream::episode_seed;
    use sim::perturb::{Composition, Strength};
    use sim::{Perturbation, Profile, TaskId};

    #[test]
    fn large_batches_are_split() {
        let env = ChunkSize::of_env(ImageSizes::BENCHMARK);
        let largest = env.times(300);
        let bytes = largest.bytes(1);
        let limits = ChunkLimits { env, n_envs: 300, largest, bytes, total_bytes: 0 };
        let envs_of = |n_envs: u64| {
            let limit = limits.for_batch(n_envs * env.pixels);
            assert_eq!(ChunkSize { pixels: largest.pixels, ..limit }, largest);
            limit.pixels as f64 / env.pixels as f64
        };
        assert_eq!([1, 32, 128, 800, 5000].map(envs_of), [32.0, 32.0, 32.0, 200.0, 300.0]);
    }

    #[test]
    fn env_size_covers_every_task() {
        let sizes = ImageSizes::BENCHMARK;
        for task in TaskId::ALL {
            let nominal = (task.task().nominal)(Profile::Strict);
            let applies = |p: &Perturbation| p.applies_to(&nominal).is_ok();
            for perturbation in Perturbation::ALL.iter().copied().filter(applies) {
                let spec = Composition::from(perturbation).spec(task.task(), Profile::Strict, Strength::FULL);
                let scene = spec.draw(episode_seed(0, task.name(), 1));
                let poses = (scene.bodies.len() + scene.robots.len() * N_LINKS) as u64;
                let scene = RenderScene::new(&scene, sizes);
                let (images, instances) = (scene.n_cameras() as u64, scene.instances.len() as u64);
                let blocks =
                    scene.instances.iter().map(|instance| instance.mesh().triangles.len().div_ceil(64));
                let blocks = blocks.sum::<usize>() as u64;
                let size = ChunkSize {
                    images,
                    pixels: (0..scene.n_cameras()).map(|camera| n_pixels(scene.size(camera))).sum(),
                    shadow_maps: 1,
                    instances: (images + 1) * instances,
                    image_blocks: images * blocks,
                    map_blocks: blocks,
                    poses,
                };
                assert!(
                    size.fits(ChunkSize::of_env(sizes)),
                    "{} under {}: {size:?}",
                    task.name(),
                    perturbation.name()
                );
            }
        }
    }
}
