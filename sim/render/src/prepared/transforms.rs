//! Transforms of a scene's instances into a view or light frame.

use super::RenderScene;
use crate::math::affine::Affine3;
use scene::Snapshot;

/// Replaces the contents of `out` with one transform per instance, from its mesh to the view (or light)
/// frame.
#[inline(always)]
pub(crate) fn write_instance_transforms(
    scene: &RenderScene,
    snapshot: &Snapshot,
    view_from_world: &Affine3,
    out: &mut Vec<Affine3>,
) {
    out.clear();
    for instance in &scene.instances {
        out.push(view_from_world.compose(&instance.world_from_mesh(snapshot)));
    }
}
