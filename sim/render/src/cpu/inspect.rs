//! Depth and segmentation images for tools. Policies never receive either.

use ipc_types::ImageSize;

use super::renderer::CpuRenderer;
use super::transform::TransformInstances;
use super::visibility::raster::{NO_ID, Visibility};
use super::visibility::tile::{Tile4x4, TileLayout};
use super::workspace::CameraContext;
use crate::prepared::{Anchor, Fixture, RenderScene};
use scene::Snapshot;

/// The scene object that is visible at a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Segment {
    /// No surface between the near and far planes of the camera.
    Nothing,
    /// A body, given its index in the scene.
    Body(usize),
    /// An arm with its hand and fingers, given its index.
    Arm(usize),
    /// A table, including its legs.
    Table,
    /// The floor of the room.
    Floor,
    /// Any wall of the room.
    Walls,
}

/// Depth and segmentation images of one camera, sampled at the pixel centres.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspection {
    /// `[height, width] f32`, row-major, top row first: depth along the optical axis in m, infinite at
    /// background pixels.
    pub depth_m: Vec<f32>,
    /// `[height, width]`, in the order of `depth_m`: the visible object of each pixel.
    pub segments: Vec<Segment>,
}

impl CpuRenderer {
    /// Returns the depth and segmentation images of one camera.
    ///
    /// # Panics
    /// If the camera does not exist, or if the snapshot does not belong to the scene.
    #[must_use]
    pub fn inspect(&mut self, scene: &RenderScene, snapshot: &Snapshot, camera_idx: usize) -> Inspection {
        assert!(scene.fits(snapshot), "a snapshot must have the bodies and arms of its scene");
        let camera = &scene.cameras[camera_idx];
        self.with_workspace(|workspace| {
            let view_from_world = camera.view_from_world(snapshot);
            let context = CameraContext { isa: self.settings.isa, scene, camera };
            self.settings.isa.run(TransformInstances {
                scene,
                snapshot,
                view_from_world,
                transforms: &mut workspace.view_from_mesh,
            });
            workspace.clear::<Tile4x4>(context);
            workspace.rasterize::<Tile4x4>(context, 0..scene.instances.len());
            untile(&workspace.visibility, scene, camera.size)
        })
    }
}

/// Converts the tiles of a visibility buffer to row-major images.
fn untile(visibility: &Visibility, scene: &RenderScene, size: ImageSize) -> Inspection {
    let [pitch, _] = visibility.pixel_tiles(1);
    let mut depth_m = vec![f32::INFINITY; size.n_pixels()];
    let mut segments = vec![Segment::Nothing; size.n_pixels()];
    for (tile, (depths, ids)) in visibility.depths.iter().zip(&visibility.ids).enumerate() {
        let (left, top) = ((tile % pitch) << Tile4x4::WIDTH_BITS, (tile / pitch) << Tile4x4::HEIGHT_BITS);
        for (lane, (&depth, &id)) in depths.0.iter().zip(&ids.0).enumerate() {
            let (x, y) = (left + Tile4x4::X.0[lane] as usize, top + Tile4x4::Y.0[lane] as usize);
            if id != NO_ID && x < size.width && y < size.height {
                let pixel = y * size.width + x;
                depth_m[pixel] = 1.0 / depth;
                segments[pixel] = segment_of(scene, id as u32);
            }
        }
    }
    Inspection { depth_m, segments }
}

/// Returns the object to which the triangle `id` belongs.
fn segment_of(scene: &RenderScene, id: u32) -> Segment {
    let instance_idx = scene.first_id.partition_point(|first| *first <= id) - 1;
    match scene.instances[instance_idx].anchor {
        Anchor::World(Fixture::Table) => Segment::Table,
        Anchor::World(Fixture::Floor) => Segment::Floor,
        Anchor::World(Fixture::Walls) => Segment::Walls,
        Anchor::Body(body) => Segment::Body(body),
        Anchor::Link { arm, .. } => Segment::Arm(arm),
    }
}
