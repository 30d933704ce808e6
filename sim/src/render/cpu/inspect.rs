//! The tools' view: how far away every pixel's surface is, and whose surface it is. Policies never see either.

use super::visibility::raster::{NO_ID, Visibility};
use super::visibility::tile::{Tile4x4, TileLayout};
use super::workspace::CameraContext;
use super::{CpuRenderer, TransformInstances};
use crate::render::scene::{Anchor, Fixture, RenderScene};
use crate::scene::Snapshot;

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Segment {
    /// Nothing: no surface, or none between the camera's near and far plane.
    Nothing,
    /// A body, by its index in the scene.
    Body(usize),
    /// An arm with its hand and fingers, by its index.
    Arm(usize),
    /// A table, its top or its legs.
    Table,
    /// The floor.
    Floor,
    /// A wall.
    Walls,
}

/// One camera's view as numbers, at the centres of the pixels of its image.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspection {
    /// `[side, side] f32`, row-major, top row first: distance along the camera's axis in m, infinite where nothing is.
    pub depth_m: Vec<f32>,
    /// `[side, side]`, in the same order.
    pub segments: Vec<Segment>,
}

impl CpuRenderer {
    /// Looks through one of the scene's cameras.
    ///
    /// # Panics
    /// If there is no such camera, or the snapshot is not of this scene.
    #[must_use]
    pub fn inspect(&mut self, scene: &RenderScene, snapshot: &Snapshot, camera_idx: usize) -> Inspection {
        assert!(scene.fits(snapshot), "a snapshot has the bodies and arms of its scene");
        let camera = &scene.cameras[camera_idx];
        self.with_workspace(|workspace| {
            let view_from_world = camera.view_from_world(snapshot);
            let context = CameraContext { isa: self.isa, scene, camera };
            self.isa.run(TransformInstances { scene, snapshot, view_from_world, maps: &mut workspace.maps });
            workspace.clear::<Tile4x4>(context);
            workspace.rasterize::<Tile4x4>(context, 0..scene.instances.len());
            read(&workspace.visibility, scene)
        })
    }
}

/// From tiles of pixels to rows.
fn read(visibility: &Visibility, scene: &RenderScene) -> Inspection {
    let side = visibility.side as usize;
    let pitch = side >> Tile4x4::WIDTH_BITS;
    let mut depth_m = vec![f32::INFINITY; side * side];
    let mut segments = vec![Segment::Nothing; side * side];
    for (tile, (depths, ids)) in visibility.depths.iter().zip(&visibility.ids).enumerate() {
        let (left, top) = ((tile % pitch) << Tile4x4::WIDTH_BITS, (tile / pitch) << Tile4x4::HEIGHT_BITS);
        for (lane, (&depth, &id)) in depths.0.iter().zip(&ids.0).enumerate() {
            if id != NO_ID {
                let pixel = (top + Tile4x4::Y.0[lane] as usize) * side + left + Tile4x4::X.0[lane] as usize;
                depth_m[pixel] = 1.0 / depth;
                segments[pixel] = segment(scene, id as u32);
            }
        }
    }
    Inspection { depth_m, segments }
}

/// Whose triangle this is.
fn segment(scene: &RenderScene, id: u32) -> Segment {
    let instance_idx = scene.first_id.partition_point(|first| *first <= id) - 1;
    match scene.instances[instance_idx].anchor {
        Anchor::World(Fixture::Table) => Segment::Table,
        Anchor::World(Fixture::Floor) => Segment::Floor,
        Anchor::World(Fixture::Walls) => Segment::Walls,
        Anchor::Body(body) => Segment::Body(body),
        Anchor::Link { arm, .. } => Segment::Arm(arm),
    }
}
