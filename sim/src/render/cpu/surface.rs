//! The triangles that are seen, made ready for shading: rays through pixels meet their planes here.

use super::raster::{NOTHING, Visibility};
use crate::render::View;
use crate::render::affine::{Affine, Vec3, cross, normalised, scaled, sub};
use crate::render::mesh::Mesh;

/// A linear function of a pixel's column and row: value at pixel (0, 0), step to the right, step down.
pub(super) type Plane = [f32; 3];

/// One visible triangle. With the corners at p, p + e and p + f in the view frame, the ray along d through a pixel's
/// centre meets the triangle's plane at p + (a/n) e + (b/n) f, where a = d·(p×f), b = d·(e×p), n = d·(f×e)
/// (Möller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997).
#[derive(Clone, Copy)]
#[repr(C)]
pub(super) struct Surface {
    pub(super) a: Plane,
    pub(super) b: Plane,
    pub(super) n: Plane,
    /// World normal at p and its change along e and f.
    pub(super) normal: [Vec3; 3],
    /// Texture coordinates at p in tiles and their change along e and f.
    pub(super) uv: [[f32; 2]; 3],
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
    pub(super) fn collect(&mut self, view: &View<'_>, view_from_world: &Affine, visibility: &mut Visibility) {
        let scene = view.scene;
        self.index.clear();
        self.index.resize(scene.n_triangles(), NOTHING);
        self.seen.clear();
        self.instance.clear();
        let mut posed: Option<Posed> = None;
        let n_pixels = view.out.len() / 3;
        for id in visibility.ids[..n_pixels].iter_mut().filter(|id| **id != NOTHING) {
            let known = self.index[*id as usize];
            if known != NOTHING {
                *id = known;
                continue;
            }
            let instance_idx = scene.first_triangle.partition_point(|first| first <= id) - 1;
            let posed = match &mut posed {
                Some(posed) if posed.instance_idx == instance_idx => posed,
                other => other.insert(Posed::new(view, view_from_world, instance_idx)),
            };
            let triangle = (*id - scene.first_triangle[instance_idx]) as usize;
            let new = self.seen.len() as u32;
            self.index[*id as usize] = new;
            self.seen.push(posed.surface(triangle));
            self.instance.push(instance_idx as u32);
            *id = new;
        }
    }
}

/// An instance with all its maps.
struct Posed {
    instance_idx: usize,
    mesh: &'static Mesh,
    view_from_mesh: Affine,
    /// Rows of the map of normals to the world, up to a positive factor.
    normals: [Vec3; 3],
    /// Mesh units to tiles.
    tiles: Vec3,
    focal_px: f32,
    /// Column and row of the principal point, counted in pixel centres.
    principal_px: f32,
}

impl Posed {
    fn new(view: &View<'_>, view_from_world: &Affine, instance_idx: usize) -> Self {
        let instance = &view.scene.instances[instance_idx];
        let camera = &view.scene.cameras[view.camera_idx];
        let world_from_mesh = instance.world_from_mesh(view.snapshot);
        let tile_m = instance.material.pattern().map_or(1.0, |pattern| pattern.tile_m);
        Self {
            instance_idx,
            mesh: instance.mesh(),
            view_from_mesh: view_from_world.after(&world_from_mesh),
            normals: world_from_mesh.normals(),
            tiles: scaled(instance.scale, 1.0 / tile_m),
            focal_px: camera.focal_px,
            principal_px: camera.side as f32 / 2.0 - 0.5,
        }
    }

    fn surface(&self, triangle: usize) -> Surface {
        let corners = self.mesh.triangles[triangle];
        let positions = corners.map(|i| self.mesh.position(i));
        let [p, q, r] = positions.map(|p| self.view_from_mesh.point(p));
        let (e, f) = (sub(q, p), sub(r, p));
        let [n0, n1, n2] = corners.map(|i| {
            let normal = self.mesh.normals[i as usize];
            normalised(self.normals.map(|row| crate::render::affine::dot(row, normal)))
        });
        let facing = self.mesh.facing[triangle];
        let [t0, t1, t2] =
            positions.map(|p| facing.project(core::array::from_fn(|axis| p[axis] * self.tiles[axis])));
        let change = |to: [f32; 2], from: [f32; 2]| [to[0] - from[0], to[1] - from[1]];
        Surface {
            a: self.over_pixels(cross(p, f)),
            b: self.over_pixels(cross(e, p)),
            n: self.over_pixels(cross(f, e)),
            normal: [n0, sub(n1, n0), sub(n2, n0)],
            uv: [t0, change(t1, t0), change(t2, t0)],
        }
    }

    /// d·v as a function of the pixel, where d = (x/z, y/z, 1) is the ray through its centre.
    fn over_pixels(&self, v: Vec3) -> Plane {
        let (right, down) = (v[0] / self.focal_px, v[1] / self.focal_px);
        [v[2] - (right + down) * self.principal_px, right, down]
    }
}
