//! Where every instance of a scene is at the moment of a view.

use super::View;
use super::affine::Affine;

/// An instance's map.
#[derive(Clone, Copy)]
pub(super) struct Posed {
    /// From the mesh to the view frame.
    pub(super) view_from_mesh: Affine,
}

/// Fills `posed` with one entry per instance of the view's scene.
pub(super) fn pose(view: &View<'_>, view_from_world: &Affine, posed: &mut Vec<Posed>) {
    posed.clear();
    posed.extend(view.scene.instances.iter().map(|instance| {
        let world_from_mesh = instance.world_from_mesh(view.snapshot);
        Posed { view_from_mesh: view_from_world.after(&world_from_mesh) }
    }));
}
