//! Pictures of worlds: a [`Scene`](crate::scene::Scene) once, a [`Snapshot`] per picture, sRGB bytes out.
//!
//! Owns the meshes, textures and shading rules; never steps a world and never draws a random number. A picture depends
//! on its scene, snapshot and camera alone: not on the batch, the threads or the machine, for it is made of IEEE
//! additions, multiplications, divisions and square roots in a fixed order.
//!
//! Shading rules, which every backend follows:
//! - Vertices are snapped to 1/256 pixel; a pixel belongs to a triangle if its centre is inside, by the top-left rule;
//!   triangles seen from behind are not drawn; the greater 1/depth wins, the earlier triangle on a tie.
//! - Attributes are those of the exact triangle where the ray through the pixel's centre meets its plane.
//! - Light is linear: colour × texture × (ambient + Σ light · max(0, n·l) / π) + highlight, where the ambient light from
//!   below is weaker than the one from above and the highlight is Blinn and Phong's with exponent 32, weighed by the
//!   paint's specular strength. The brightness is clamped, then coded as sRGB to the nearest code.
//! - Textures are projected along the mesh axis that a triangle faces; they are filtered bilinearly in the two nearest
//!   mip levels and linearly between them. What nothing covers is black (spec/perturbations.md §7).
//! - `Lights::shadows` asks for nothing yet: no task or perturbation of today sets it.

mod affine;
mod camera;
mod cpu;
mod line;
mod material;
mod mesh;
mod noise;
mod posed;
mod robot;
mod room;
mod scene;
pub mod sheet;
mod srgb;
mod texture;
mod trig;

pub use cpu::{CpuRenderer, Inspection, Segment};
pub use scene::RenderScene;

use crate::scene::Snapshot;

/// One picture to make.
pub struct View<'a> {
    /// What does not move.
    pub scene: &'a RenderScene,
    /// Where everything is; as many bodies and arms as the scene has.
    pub snapshot: &'a Snapshot,
    /// Which of the scene's cameras.
    pub camera_idx: usize,
    /// `[side, side, 3] u8` sRGB, row-major, top row first; every byte is written exactly once and none is read.
    pub out: &'a mut [u8],
}

/// A way to make pictures.
pub trait Renderer: Send {
    /// Name for people, with what it runs on.
    fn name(&self) -> String;

    /// Fills every view's `out`, one work item per view on rayon's current pool.
    ///
    /// # Panics
    /// If a view's camera does not exist, its `out` is not of its camera's size, or its snapshot is not of its scene.
    fn render(&mut self, views: &mut [View<'_>]);
}
