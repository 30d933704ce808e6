//! The kernel that places all instances in a view.

use super::simd::Simd;
use super::simd::isa::Kernel;
use crate::math::affine::Affine3;
use crate::prepared::{RenderScene, transforms};
use scene::Snapshot;

/// Computes the transforms of all instances into the view (or light) frame.
pub(crate) struct TransformInstances<'a> {
    pub(crate) scene: &'a RenderScene,
    pub(crate) snapshot: &'a Snapshot,
    pub(crate) view_from_world: Affine3,
    pub(crate) transforms: &'a mut Vec<Affine3>,
}

impl Kernel for TransformInstances<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        transforms::write_instance_transforms(
            self.scene,
            self.snapshot,
            &self.view_from_world,
            self.transforms,
        );
    }
}
