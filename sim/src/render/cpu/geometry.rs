//! From instances to triangles on the image: transforms vertices, leaves out what the image cannot show.

use super::clip;
use super::posed::Posed;
use super::raster::{Corner, Visibility};
use crate::render::View;
use crate::render::affine::{Affine, Vec3};
use crate::render::camera::Camera;
use crate::render::mesh::Mesh;

/// A vertex lies beyond one of the planes that bound what the image shows.
const LEFT: u8 = 1;
const RIGHT: u8 = 2;
const ABOVE: u8 = 4;
const BELOW: u8 = 8;
const FAR: u8 = 16;
const NEAR: u8 = 32;
/// Its triangle must be clipped before it can be projected or drawn.
const CLIP: u8 = 64;

/// Transformed vertices of one instance, one array per quantity.
pub(super) struct Geometry {
    /// Image coordinates in 1/256 pixel.
    x: Vec<i32>,
    y: Vec<i32>,
    /// 1/depth, in 1/m.
    inverse_z: Vec<f32>,
    outcode: Vec<u8>,
}

impl Geometry {
    /// Room for meshes of a few thousand vertices.
    pub(super) fn new() -> Self {
        const N: usize = 4096;
        Self {
            x: Vec::with_capacity(N),
            y: Vec::with_capacity(N),
            inverse_z: Vec::with_capacity(N),
            outcode: Vec::with_capacity(N),
        }
    }

    /// Draws every instance of the view's scene.
    #[inline(always)]
    pub(super) fn draw(&mut self, view: &View<'_>, posed: &[Posed], visibility: &mut Visibility) {
        let camera = &view.scene.cameras[view.camera_idx];
        let frustum = Frustum::new(camera);
        let instances = view.scene.instances.iter().zip(posed).zip(&view.scene.first_triangle);
        for ((instance, Posed { view_from_mesh, .. }), &first_id) in instances {
            let mesh = instance.mesh();
            if frustum.misses(view_from_mesh.point(mesh.centre), mesh.radius * view_from_mesh.stretch()) {
                continue;
            }
            self.transform(mesh, view_from_mesh, &frustum);
            self.assemble(mesh, view_from_mesh, &frustum, first_id, visibility);
        }
    }

    #[inline(always)]
    fn transform(&mut self, mesh: &Mesh, view_from_mesh: &Affine, frustum: &Frustum) {
        let n = mesh.n_vertices();
        self.x.resize(n, 0);
        self.y.resize(n, 0);
        self.inverse_z.resize(n, 0.0);
        self.outcode.resize(n, 0);
        let [xs, ys, zs] = &mesh.positions;
        let (xs, ys, zs) = (&xs[..n], &ys[..n], &zs[..n]);
        let (out_x, out_y) = (&mut self.x[..n], &mut self.y[..n]);
        let (out_z, out_code) = (&mut self.inverse_z[..n], &mut self.outcode[..n]);
        for i in 0..n {
            let p = view_from_mesh.point([xs[i], ys[i], zs[i]]);
            let corner = frustum.project(p);
            out_x[i] = corner.x;
            out_y[i] = corner.y;
            out_z[i] = corner.inverse_z;
            out_code[i] = frustum.outcode(p);
        }
    }

    #[inline(always)]
    fn assemble(
        &self,
        mesh: &Mesh,
        view_from_mesh: &Affine,
        frustum: &Frustum,
        first_id: u32,
        visibility: &mut Visibility,
    ) {
        for (id, triangle) in (first_id..).zip(&mesh.triangles) {
            let [a, b, c] = triangle.map(|i| self.outcode[i as usize]);
            if a & b & c & !CLIP != 0 {
                continue;
            }
            if (a | b | c) & CLIP != 0 {
                clip::draw(triangle.map(|i| view_from_mesh.point(mesh.position(i))), frustum, id, visibility);
                continue;
            }
            let corners = triangle.map(|i| {
                let i = i as usize;
                Corner { x: self.x[i], y: self.y[i], inverse_z: self.inverse_z[i] }
            });
            visibility.draw(id, corners);
        }
    }
}

/// What a camera shows, in its view frame.
pub(super) struct Frustum {
    focal_px: f32,
    /// Half the image's side, in px.
    half_px: f32,
    pub(super) near_m: f32,
    far_m: f32,
    /// Greatest |x/z| and |y/z| of the image.
    slope: f32,
    /// Greatest |x/z| and |y/z| that fit the rasteriser's numbers.
    pub(super) guard_slope: f32,
}

/// Pixels beyond the image's edges to which triangles are drawn unclipped.
const GUARD_PX: f32 = 448.0;

impl Frustum {
    fn new(camera: &Camera) -> Self {
        let half_px = camera.side as f32 / 2.0;
        let [near_m, far_m] = camera.clip_m;
        Self {
            focal_px: camera.focal_px,
            half_px,
            near_m,
            far_m,
            slope: half_px / camera.focal_px,
            guard_slope: (half_px + GUARD_PX) / camera.focal_px,
        }
    }

    /// Whether a ball lies beyond one of the planes.
    #[inline(always)]
    fn misses(&self, [x, y, z]: Vec3, radius: f32) -> bool {
        let slack = radius * (1.0 + self.slope * self.slope).sqrt();
        z + radius < self.near_m
            || z - radius > self.far_m
            || x.abs() - self.slope * z > slack
            || y.abs() - self.slope * z > slack
    }

    /// Where a point of the view frame appears; meaningless unless it is in front of the near plane and within the guard.
    #[inline(always)]
    pub(super) fn project(&self, [x, y, z]: Vec3) -> Corner {
        let inverse_z = 1.0 / z;
        let on_image = |t: f32| snap(self.half_px + t * self.focal_px * inverse_z);
        Corner { x: on_image(x), y: on_image(y), inverse_z }
    }

    #[inline(always)]
    fn outcode(&self, [x, y, z]: Vec3) -> u8 {
        let (edge, guard) = (self.slope * z, self.guard_slope * z);
        let bit = |yes: bool, bit: u8| if yes { bit } else { 0 };
        bit(x < -edge, LEFT)
            | bit(x > edge, RIGHT)
            | bit(y < -edge, ABOVE)
            | bit(y > edge, BELOW)
            | bit(z > self.far_m, FAR)
            | bit(z < self.near_m, NEAR)
            | bit(z < self.near_m || x.abs() > guard || y.abs() > guard, CLIP)
    }
}

/// Pixels to 1/256 pixel, to the nearest, ties to even, for |px| below 8192: adding 1.5 · 2²³ leaves the integer in the
/// lower bits of the sum.
#[inline(always)]
fn snap(px: f32) -> i32 {
    const SHIFT: f32 = 12_582_912.0;
    (px * 256.0 + SHIFT).to_bits().wrapping_sub(SHIFT.to_bits()).cast_signed()
}
