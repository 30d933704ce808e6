//! Where every instance of a scene is at the moment of a view.

use super::affine::Affine;
use super::scene::RenderScene;
use crate::scene::Snapshot;

/// Fills `maps` with one map per instance, from its mesh to a view's or a light's frame.
#[inline(always)]
pub(super) fn pose(
    scene: &RenderScene,
    snapshot: &Snapshot,
    view_from_world: &Affine,
    maps: &mut Vec<Affine>,
) {
    maps.clear();
    for instance in &scene.instances {
        maps.push(view_from_world.after(&instance.world_from_mesh(snapshot)));
    }
}
