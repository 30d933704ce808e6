//! Buffers whose size depends on the chunk.

use gpu::{GpuDevice, GrowableBuffer};

use crate::gpu::chunk::size::ChunkBytes;

/// One buffer for each size in [`ChunkBytes`].
pub(crate) struct ChunkBuffers {
    pub(crate) views: GrowableBuffer,
    pub(crate) poses: GrowableBuffer,
    /// Instances of all views, written by the placement kernel.
    pub(crate) instances: GrowableBuffer,
    /// Count and list of blocks of triangles in images, written by the placement kernel.
    pub(crate) image_blocks: GrowableBuffer,
    /// The same in shadow maps.
    pub(crate) map_blocks: GrowableBuffer,
    /// Count and list of large triangles, which whole workgroups rasterise.
    pub(crate) large_triangles: GrowableBuffer,
    /// Visibility per sample of the images.
    pub(crate) samples: GrowableBuffer,
    /// Heights of the shadow maps.
    pub(crate) heights: GrowableBuffer,
    /// sRGB bytes of all images, stored consecutively.
    pub(crate) images: GrowableBuffer,
}

impl ChunkBuffers {
    /// Creates minimal buffers, which grow up to the sizes for the largest chunk.
    pub(crate) fn new(gpu: &GpuDevice, full: &ChunkBytes) -> Self {
        let buffer = |label, full_size| GrowableBuffer::new(gpu, label, full_size);
        Self {
            views: buffer("views", full.views),
            poses: buffer("poses", full.poses),
            instances: buffer("instances", full.instances),
            image_blocks: buffer("image blocks", full.image_blocks),
            map_blocks: buffer("map blocks", full.map_blocks),
            large_triangles: buffer("large triangles", full.large_triangles),
            samples: buffer("samples", full.samples),
            heights: buffer("heights", full.heights),
            images: buffer("images", full.images),
        }
    }

    /// Reserves space for a chunk. Returns `true` if a buffer was reallocated.
    pub(crate) fn reserve(&mut self, gpu: &GpuDevice, bytes: &ChunkBytes) -> bool {
        let Self { views, poses, instances, image_blocks, map_blocks, .. } = self;
        let Self { large_triangles, samples, heights, images, .. } = self;
        let sizes = [
            (views, bytes.views),
            (poses, bytes.poses),
            (instances, bytes.instances),
            (image_blocks, bytes.image_blocks),
            (map_blocks, bytes.map_blocks),
            (large_triangles, bytes.large_triangles),
            (samples, bytes.samples),
            (heights, bytes.heights),
            (images, bytes.images),
        ];
        sizes.into_iter().fold(false, |reallocated, (buffer, n)| buffer.reserve(gpu, n) || reallocated)
    }

    /// Returns the memory of all buffers in bytes.
    pub(crate) fn n_bytes(&self) -> u64 {
        let Self { views, poses, instances, image_blocks, map_blocks, .. } = self;
        let Self { large_triangles, samples, heights, images, .. } = self;
        let lists = [image_blocks, map_blocks, large_triangles];
        let others = [views, poses, instances, samples, heights, images];
        lists.into_iter().chain(others).map(|buffer| buffer.buffer().size()).sum()
    }
}
