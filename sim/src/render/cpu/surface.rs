//! The triangles that are seen, made ready for shading: rays through pixels meet their planes here.

use super::posed::Posed;
use super::raster::{NOTHING, Visibility};
use crate::render::View;
use crate::render::affine::{Vec3, cross, dot, normalised, scaled, sub};
use crate::render::camera::Camera;
use crate::render::scene::{Instance, pattern};

/// A linear function of a pixel's column and row: value at pixel (0, 0), step to the right, step down.
type Plane = [f32; 3];

/// One visible triangle. With the corners at p, p + e and p + f in the view frame, the ray along d through a pixel's
/// centre meets the triangle's plane at p + (a/n) e + (b/n) f, where a = d·(p×f), b = d·(e×p), n = d·(f×e)
/// (Möller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997).
///
/// Plain numbers, so that those of neighbouring pixels are easily laid side by side.
#[derive(Clone, Copy)]
pub(super) struct Surface(pub(super) [f32; Self::N_NUMBERS]);

impl Surface {
    /// Where a, b and n begin: each a [`Plane`].
    pub(super) const A: usize = 0;
    pub(super) const B: usize = 3;
    pub(super) const N: usize = 6;
    /// Where the world normal at p and its changes along e and f begin.
    pub(super) const NORMAL: usize = 9;
    /// Where the texture coordinates at p, in tiles, and their changes along e and f begin.
    pub(super) const UV: usize = 18;
    /// How many there are.
    pub(super) const N_NUMBERS: usize = 24;

    #[inline(always)]
    fn new(planes: [Plane; 3], normals: [Vec3; 3], uv: [[f32; 2]; 3]) -> Self {
        let mut numbers = [0.0; Self::N_NUMBERS];
        numbers[..Self::NORMAL].copy_from_slice(planes.as_flattened());
        numbers[Self::NORMAL..Self::UV].copy_from_slice(normals.as_flattened());
        numbers[Self::UV..].copy_from_slice(uv.as_flattened());
        Self(numbers)
    }
}

/// All visible triangles of one view, in the order in which their first pixels come.
pub(super) struct Surfaces {
    /// Index into `seen` by triangle, or [`NOTHING`].
    index: Vec<u32>,
    /// The triangles.
    pub(super) seen: Vec<Surface>,
    /// Instance of each.
    pub(super) instance: Vec<u32>,
}

impl Surfaces {
    /// Room for what a scene usually shows.
    pub(super) fn new() -> Self {
        const N: usize = 1 << 16;
        Self {
            index: Vec::with_capacity(N),
            seen: Vec::with_capacity(N / 4),
            instance: Vec::with_capacity(N / 4),
        }
    }

    /// Finds the triangles that `visibility` shows and renames them there to their index in `seen`.
    #[inline(always)]
    pub(super) fn collect(&mut self, view: &View<'_>, posed: &[Posed], visibility: &mut Visibility) {
        let scene = view.scene;
        self.index.clear();
        self.index.resize(scene.n_triangles(), NOTHING);
        self.seen.clear();
        self.instance.clear();
        let lens = Lens::new(&scene.cameras[view.camera_idx]);
        let n_pixels = view.out.len() / 3;
        for id in visibility.ids[..n_pixels].iter_mut().filter(|id| **id != NOTHING) {
            let known = self.index[*id as usize];
            if known != NOTHING {
                *id = known;
                continue;
            }
            let instance_idx = scene.first_triangle.partition_point(|first| first <= id) - 1;
            let triangle = (*id - scene.first_triangle[instance_idx]) as usize;
            let new = self.seen.len() as u32;
            self.index[*id as usize] = new;
            self.seen.push(lens.surface(&scene.instances[instance_idx], &posed[instance_idx], triangle));
            self.instance.push(instance_idx as u32);
            *id = new;
        }
    }
}

/// How pixels and rays belong together.
struct Lens {
    focal_px: f32,
    /// Column and row of the principal point, counted in pixel centres.
    principal_px: f32,
}

impl Lens {
    fn new(camera: &Camera) -> Self {
        Self { focal_px: camera.focal_px, principal_px: camera.side as f32 / 2.0 - 0.5 }
    }

    #[inline(always)]
    fn surface(&self, instance: &Instance, posed: &Posed, triangle: usize) -> Surface {
        let mesh = instance.mesh();
        let corners = mesh.triangles[triangle];
        let positions = corners.map(|i| mesh.position(i));
        let [p, q, r] = positions.map(|p| posed.view_from_mesh.point(p));
        let (e, f) = (sub(q, p), sub(r, p));
        let rows = posed.world_from_mesh.normals();
        let [n0, n1, n2] = corners.map(|i| normalised(rows.map(|row| dot(row, mesh.normals[i as usize]))));
        let tile_m = instance.material.texture.map_or(1.0, |texture| pattern(texture).tile_m);
        let tiles = scaled(instance.scale, 1.0 / tile_m);
        let facing = mesh.facing[triangle];
        let [t0, t1, t2] =
            positions.map(|p| facing.project([p[0] * tiles[0], p[1] * tiles[1], p[2] * tiles[2]]));
        let change = |to: [f32; 2], from: [f32; 2]| [to[0] - from[0], to[1] - from[1]];
        Surface::new(
            [cross(p, f), cross(e, p), cross(f, e)].map(|v| self.over_pixels(v)),
            [n0, sub(n1, n0), sub(n2, n0)],
            [t0, change(t1, t0), change(t2, t0)],
        )
    }

    /// d·v as a function of the pixel, where d = (x/z, y/z, 1) is the ray through its centre.
    #[inline(always)]
    fn over_pixels(&self, v: Vec3) -> Plane {
        let (right, down) = (v[0] / self.focal_px, v[1] / self.focal_px);
        [v[2] - (right + down) * self.principal_px, right, down]
    }
}
