//! Chunks of views: how many are rendered at a time, and the device memory that they take.

use bytemuck::{Pod, Zeroable};
use ipc_types::{EXTERNAL_SIDE, HAND_SIDE};

use gpu::{AdapterKind, GpuDevice};

use super::options::VisibilityMethod;
use super::records::{INSTANCE_BYTES, PoseRecord, ViewRecord};
use super::texture_layers::LAYER_STEP;
use crate::shading::SHADOW_MAP_SIDE;

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
/// Bytes per sample of the rasteriser's ids.
const ID_BYTES: u64 = 4;
/// Bytes per sample of the rasteriser's depths and heights.
const DEPTH_BYTES: u64 = 4;
/// Size of a draw call's arguments in bytes.
pub(crate) const DRAW_BYTES: u64 = 20;
/// Size of a block of triangles, or of a large triangle, in bytes.
const LIST_ENTRY_BYTES: u64 = 8;
/// Bytes before a list, for its length.
const LIST_HEADER_BYTES: u64 = 8;
/// Number of large triangles per view for which there is room. Single threads rasterise those beyond, with
/// the same result.
const LARGE_PER_VIEW: u64 = 512;

/// Number of counts in a [`ChunkSize`].
const N_COUNTS: usize = size_of::<ChunkSize>() / size_of::<u64>();

/// Upper bounds of what a chunk of views takes up.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct ChunkSize {
    /// Number of images.
    pub(crate) images: u64,
    /// Number of pixels of all images.
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
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChunkBytes {
    pub(crate) views: u64,
    pub(crate) poses: u64,
    pub(crate) instances: u64,
    /// Packed images, on the device and, twice, in readback buffers.
    pub(crate) images: u64,
    /// Blocks of triangles in images and in shadow maps.
    pub(crate) blocks: [u64; 2],
    pub(crate) large_triangles: u64,
    /// Results of the compute kernels per sample and per texel of a shadow map.
    pub(crate) visibility: [u64; 2],
    /// Arguments of draw calls.
    pub(crate) draws: u64,
    /// Layers of the rasteriser for images and for shadow maps.
    layers: [u64; 2],
}

/// The largest chunks that a device renders.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChunkLimits {
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
    pub(crate) fn new(
        gpu: &GpuDevice,
        kind: AdapterKind,
        visibility: VisibilityMethod,
        samples_per_axis: u32,
    ) -> Self {
        let env = ChunkSize::ENV.bytes(samples_per_axis);
        let (env_bytes, largest_buffer) = (env.total(visibility), env.largest(visibility));
        let wanted = match kind {
            AdapterKind::Hardware => MAX_CHUNK_BYTES / env_bytes,
            AdapterKind::Software => SOFTWARE_ENVS,
        };
        let mut n =
            wanted.min(gpu.max_buffer_bytes() / largest_buffer).min(MAX_VIEWS / ChunkSize::ENV.n_views());
        if visibility == VisibilityMethod::Raster {
            n = n.min(u64::from(gpu.device.limits().max_texture_array_layers) / ChunkSize::ENV.images);
            // The number of layers grows in steps.
            n -= n % u64::from(LAYER_STEP);
        }
        let n_envs = n.max(1);
        let largest = ChunkSize::of_envs(n_envs);
        let bytes = largest.bytes(samples_per_axis);
        Self { n_envs, largest, bytes, total_bytes: bytes.total(visibility) }
    }

    /// Returns the limit for the chunks of a batch with this many pixels.
    pub(crate) fn for_batch(&self, n_pixels: u64) -> ChunkSize {
        let share = n_pixels.div_ceil(MIN_CHUNKS).max(MIN_CHUNK_ENVS * ChunkSize::ENV.pixels);
        ChunkSize { pixels: self.largest.pixels.min(share), ..self.largest }
    }
}

impl ChunkSize {
    /// The largest env of the benchmark: two external cameras, two hand cameras and a shadow map.
    const ENV: Self = Self {
        images: 4,
        pixels: 2 * square(EXTERNAL_SIDE) + 2 * square(HAND_SIDE),
        shadow_maps: 1,
        instances: 5 * 160,
        image_blocks: 4 * 1200,
        map_blocks: 1200,
        poses: 48,
    };

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
        let list = |n: u64| LIST_HEADER_BYTES + n * LIST_ENTRY_BYTES;
        ChunkBytes {
            views: self.n_views() * size_of::<ViewRecord>() as u64,
            poses: self.poses * size_of::<PoseRecord>() as u64,
            instances: self.instances * INSTANCE_BYTES,
            images: self.pixels * 3,
            blocks: [self.image_blocks, self.map_blocks].map(list),
            large_triangles: list(self.n_views() * LARGE_PER_VIEW),
            visibility: [samples * 8, self.shadow_maps * u64::from(SHADOW_MAP_SIDE.pow(2)) * 4],
            draws: self.instances * DRAW_BYTES,
            layers: [
                self.images
                    * square(EXTERNAL_SIDE)
                    * u64::from(samples_per_axis.pow(2))
                    * (ID_BYTES + DEPTH_BYTES),
                self.shadow_maps * u64::from(SHADOW_MAP_SIDE.pow(2)) * DEPTH_BYTES,
            ],
        }
    }

    const fn n_views(self) -> u64 {
        self.images + self.shadow_maps
    }

    fn of_envs(n: u64) -> Self {
        bytemuck::cast(Self::ENV.counts().map(|count| count * n))
    }

    fn counts(self) -> [u64; N_COUNTS] {
        bytemuck::cast(self)
    }
}

impl ChunkBytes {
    /// Returns the sizes of the buffers that differ between the methods.
    fn of_method(self, visibility: VisibilityMethod) -> [u64; 5] {
        let Self { blocks: [image_blocks, map_blocks], visibility: [samples, texels], .. } = self;
        match visibility {
            VisibilityMethod::Compute => [samples, texels, image_blocks, map_blocks, self.large_triangles],
            VisibilityMethod::Raster => [self.layers[0], self.layers[1], self.draws, 0, 0],
        }
    }

    /// Returns the size of all buffers, with the images three times.
    fn total(self, visibility: VisibilityMethod) -> u64 {
        let of_method: u64 = self.of_method(visibility).iter().sum();
        self.views + self.poses + self.instances + 3 * self.images + of_method
    }

    /// Returns the size of the largest buffer that is bound to a kernel.
    fn largest(self, visibility: VisibilityMethod) -> u64 {
        let of_method = match visibility {
            VisibilityMethod::Compute => self.of_method(visibility).into_iter().fold(0, u64::max),
            VisibilityMethod::Raster => self.draws,
        };
        of_method.max(self.views).max(self.poses).max(self.instances).max(self.images)
    }
}

const fn square(side: usize) -> u64 {
    (side * side) as u64
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
        let largest = ChunkSize::of_envs(300);
        let bytes = largest.bytes(1);
        let limits = ChunkLimits { n_envs: 300, largest, bytes, total_bytes: 0 };
        let envs_of = |n_envs: u64| {
            let limit = limits.for_batch(n_envs * ChunkSize::ENV.pixels);
            assert_eq!(ChunkSize { pixels: largest.pixels, ..limit }, largest);
            limit.pixels as f64 / ChunkSize::ENV.pixels as f64
        };
        assert_eq!([1, 32, 128, 800, 5000].map(envs_of), [32.0, 32.0, 32.0, 200.0, 300.0]);
    }

    #[test]
    fn env_size_covers_every_task() {
        for task in TaskId::ALL {
            let nominal = (task.task().nominal)(Profile::Strict);
            let applies = |p: &Perturbation| p.applies_to(&nominal).is_ok();
            for perturbation in Perturbation::ALL.iter().copied().filter(applies) {
                let spec = Composition::from(perturbation).spec(task.task(), Profile::Strict, Strength::FULL);
                let scene = spec.draw(episode_seed(0, task.name(), 1));
                let poses = (scene.bodies.len() + scene.robots.len() * N_LINKS) as u64;
                let scene = RenderScene::new(&scene);
                let (images, instances) = (scene.n_cameras() as u64, scene.instances.len() as u64);
                let blocks =
                    scene.instances.iter().map(|instance| instance.mesh().triangles.len().div_ceil(64));
                let blocks = blocks.sum::<usize>() as u64;
                let size = ChunkSize {
                    images,
                    pixels: (0..scene.n_cameras()).map(|camera| square(scene.side(camera))).sum(),
                    shadow_maps: 1,
                    instances: (images + 1) * instances,
                    image_blocks: images * blocks,
                    map_blocks: blocks,
                    poses,
                };
                assert!(size.fits(ChunkSize::ENV), "{} under {}: {size:?}", task.name(), perturbation.name());
            }
        }
    }
}
