//! Where every instance of a scene is at the moment of a view.

use super::RenderScene;
use crate::render::math::affine::Affine3;
use crate::scene::Snapshot;

/// Fills `maps` with one map per instance, from its mesh to a view's or a light's frame.
#[inline(always)]
pub(in crate::render) fn write_instance_transforms(
    scene: &RenderScene,
    snapshot: &Snapshot,
    view_from_world: &Affine3,
    maps: &mut Vec<Affine3>,
) {
    maps.clear();
    for instance in &scene.instances {
        maps.push(view_from_world.compose(&instance.world_from_mesh(snapshot)));
    }
}
