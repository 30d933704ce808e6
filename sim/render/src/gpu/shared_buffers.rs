//! Buffers that several passes use.

use gpu::GrowableBuffer;

use super::assets::Assets;
use super::scenes::ResidentScenes;

/// Buffers that several passes use.
pub(crate) struct SharedBuffers {
    pub(crate) views: GrowableBuffer,
    pub(crate) poses: GrowableBuffer,
    /// Instances of all views, written by the placement pass.
    pub(crate) instances: GrowableBuffer,
    pub(crate) scenes: ResidentScenes,
    pub(crate) assets: Assets,
}
