//! From visible triangles to bytes: every pixel is looked at once, in groups along a row.

use core::f32::consts::FRAC_1_PI;

use super::raster::{NOTHING, Visibility};
use super::surface::{Surface, Surfaces};
use crate::render::View;
use crate::render::affine::{Affine, Vec3, dot};
use crate::render::scene::{N_SUNS, RenderScene, Sun};
use crate::render::srgb::Encoder;

/// Pixels of a row that are shaded together.
const LANES: usize = 16;
/// One number per pixel of a group.
type Lanes = [f32; LANES];
/// A surface as plain numbers: 3 planes, 3 normals, 3 texture coordinates.
const N_NUMBERS: usize = 24;
/// What share of the ambient light comes from below, relative to that from above.
const GROUND: f32 = 0.55;

/// Writes the view's bytes.
pub(super) fn shade(
    view: &mut View<'_>,
    view_from_world: &Affine,
    visibility: &Visibility,
    surfaces: &Surfaces,
    encoder: &Encoder,
) {
    let scene = view.scene;
    let side = scene.side(view.camera_idx);
    let rays = Rays::new(view, view_from_world);
    let groups = view.out.chunks_exact_mut(LANES * 3).zip(visibility.ids.chunks_exact(LANES));
    for (group, (bytes, ids)) in groups.enumerate() {
        let ids: &[u32; LANES] = ids.try_into().expect("LANES long");
        if ids.iter().all(|id| *id == NOTHING) {
            bytes.fill(0);
            continue;
        }
        let (column, row) = (group * LANES % side, group * LANES / side);
        let hits = Hits::new(ids, surfaces, column as f32, row as f32);
        let light = Light::new(scene, &hits, &rays, column as f32, row as f32);
        let rgb = Looks::new(scene, ids, surfaces, &hits).lit(&light);
        for (lane, pixel) in bytes.chunks_exact_mut(3).enumerate() {
            for (byte, channel) in pixel.iter_mut().zip(&rgb) {
                *byte = encoder.encode(channel[lane]);
            }
        }
    }
}

/// World directions of the rays through pixel centres, not normalised, from the eye outwards.
struct Rays {
    /// Through pixel (0, 0).
    first: Vec3,
    right: Vec3,
    down: Vec3,
}

impl Rays {
    fn new(view: &View<'_>, view_from_world: &Affine) -> Self {
        let camera = &view.scene.cameras[view.camera_idx];
        let world_from_view = view_from_world.rigid_inverse();
        let step = 1.0 / camera.focal_px;
        let corner = (0.5 - camera.side as f32 / 2.0) * step;
        Self {
            first: world_from_view.vector([corner, corner, 1.0]),
            right: world_from_view.vector([step, 0.0, 0.0]),
            down: world_from_view.vector([0.0, step, 0.0]),
        }
    }
}

/// Where the rays of a group meet their surfaces.
struct Hits {
    /// Unit normal in the world.
    normal: [Lanes; 3],
    /// Texture coordinates, in tiles.
    uv: [Lanes; 2],
    /// Greater of the squared lengths, in tiles², that a step right and a step down make on the texture.
    footprint: Lanes,
}

impl Hits {
    #[inline(always)]
    fn new(ids: &[u32; LANES], surfaces: &Surfaces, column: f32, row: f32) -> Self {
        let s = gather(ids, surfaces);
        let mut hits =
            Self { normal: [[0.0; LANES]; 3], uv: [[0.0; LANES]; 2], footprint: [0.0; LANES] };
        for i in 0..LANES {
            let x = column + i as f32;
            let plane = |k: usize| s[k][i] + s[k + 1][i] * x + s[k + 2][i] * row;
            let per_n = 1.0 / plane(6);
            let (exact_a, exact_b) = (plane(0) * per_n, plane(3) * per_n);
            // A pixel at a silhouette may belong to the snapped triangle and just miss the exact one.
            let a = exact_a.max(0.0).min(1.0);
            let b = exact_b.max(0.0).min(1.0);
            let blend = |k: usize, step: usize| s[k][i] + a * s[k + step][i] + b * s[k + 2 * step][i];
            let normal = [blend(9, 3), blend(10, 3), blend(11, 3)];
            let per_length = 1.0 / dot(normal, normal).max(1e-12).sqrt();
            for axis in 0..3 {
                hits.normal[axis][i] = normal[axis] * per_length;
            }
            hits.uv[0][i] = blend(18, 2);
            hits.uv[1][i] = blend(19, 2);
            // d(a/n) = (da - (a/n) dn) / n, for a step right (k = 1) and a step down (k = 2).
            let stretch = |k: usize| {
                let da = (s[k][i] - a * s[6 + k][i]) * per_n;
                let db = (s[3 + k][i] - b * s[6 + k][i]) * per_n;
                let du = da * s[20][i] + db * s[22][i];
                let dv = da * s[21][i] + db * s[23][i];
                du * du + dv * dv
            };
            hits.footprint[i] = stretch(1).max(stretch(2));
        }
        hits
    }
}

/// The surfaces of a group's pixels, number by number; where nothing is seen, a neighbour stands in.
#[inline(always)]
fn gather(ids: &[u32; LANES], surfaces: &Surfaces) -> [Lanes; N_NUMBERS] {
    let mut numbers = [[0.0; LANES]; N_NUMBERS];
    let any = ids.iter().copied().find(|id| *id != NOTHING).expect("a group with nothing is not shaded");
    if ids.iter().all(|id| *id == any) {
        let surface = surfaces.seen[any as usize].numbers();
        for (lanes, number) in numbers.iter_mut().zip(surface) {
            *lanes = [number; LANES];
        }
        return numbers;
    }
    for (lane, &id) in ids.iter().enumerate() {
        let surface = surfaces.seen[if id == NOTHING { any } else { id } as usize].numbers();
        for (lanes, number) in numbers.iter_mut().zip(surface) {
            lanes[lane] = number;
        }
    }
    numbers
}

impl Surface {
    #[inline(always)]
    fn numbers(&self) -> [f32; N_NUMBERS] {
        let Self { a, b, n, normal: [n0, n1, n2], uv: [t0, t1, t2] } = self;
        let mut numbers = [0.0; N_NUMBERS];
        for (k, triple) in [a, b, n, n0, n1, n2].into_iter().enumerate() {
            numbers[3 * k..3 * k + 3].copy_from_slice(triple);
        }
        for (k, pair) in [t0, t1, t2].into_iter().enumerate() {
            numbers[18 + 2 * k..20 + 2 * k].copy_from_slice(pair);
        }
        numbers
    }
}

/// Light that a group's pixels send to the eye.
struct Light {
    /// From a white surface.
    diffuse: [Lanes; 3],
    /// From a surface of specular strength 1, on top.
    highlight: [Lanes; 3],
}

impl Light {
    #[inline(always)]
    fn new(scene: &RenderScene, hits: &Hits, rays: &Rays, column: f32, row: f32) -> Self {
        let mut light = Self { diffuse: [[0.0; LANES]; 3], highlight: [[0.0; LANES]; 3] };
        for i in 0..LANES {
            let x = column + i as f32;
            let normal = hits.normal.map(|axis| axis[i]);
            let ray: Vec3 =
                core::array::from_fn(|k| rays.first[k] + rays.right[k] * x + rays.down[k] * row);
            let per_length = -1.0 / dot(ray, ray).sqrt();
            let to_eye = ray.map(|r| r * per_length);
            let sky = (1.0 + GROUND) / 2.0 + (1.0 - GROUND) / 2.0 * normal[2];
            let reflected: [[f32; 2]; N_SUNS] = scene.suns.map(|sun| reflect(&sun, normal, to_eye));
            for c in 0..3 {
                let mut diffuse = scene.ambient[c] * sky;
                let mut highlight = 0.0;
                for (sun, [lambert, phong]) in scene.suns.iter().zip(reflected) {
                    diffuse += sun.color[c] * lambert;
                    highlight += sun.color[c] * phong;
                }
                light.diffuse[c][i] = diffuse;
                light.highlight[c][i] = highlight;
            }
        }
        light
    }
}

/// Shares of a sun's light that are scattered and mirrored to the eye.
#[inline(always)]
fn reflect(sun: &Sun, normal: Vec3, to_eye: Vec3) -> [f32; 2] {
    let facing = dot(normal, sun.towards).max(0.0);
    let half: Vec3 = core::array::from_fn(|k| sun.towards[k] + to_eye[k]);
    let aligned = dot(normal, half).max(0.0);
    // (n·h)² / |h|², raised to the 16th.
    let mut power = aligned * aligned / dot(half, half).max(1e-12);
    for _ in 0..4 {
        power *= power;
    }
    [facing * FRAC_1_PI, if facing > 0.0 { power } else { 0.0 }]
}

/// Reflectance of a group's pixels.
struct Looks {
    color: [Lanes; 3],
    specular: Lanes,
}

impl Looks {
    #[inline(always)]
    fn new(scene: &RenderScene, ids: &[u32; LANES], surfaces: &Surfaces, hits: &Hits) -> Self {
        let mut looks = Self { color: [[0.0; LANES]; 3], specular: [0.0; LANES] };
        for (i, &id) in ids.iter().enumerate().filter(|(_, id)| **id != NOTHING) {
            let material = &scene.instances[surfaces.instance[id as usize] as usize].material;
            let pattern = material.pattern();
            let texel = pattern.map(|p| p.sample(hits.uv[0][i], hits.uv[1][i], hits.footprint[i]));
            for c in 0..3 {
                looks.color[c][i] = material.color[c] * texel.map_or(1.0, |texel| texel[c]);
            }
            looks.specular[i] = material.specular;
        }
        looks
    }

    /// Linear RGB that reaches the eye.
    #[inline(always)]
    fn lit(&self, light: &Light) -> [Lanes; 3] {
        core::array::from_fn(|c| {
            core::array::from_fn(|i| {
                self.color[c][i] * light.diffuse[c][i] + self.specular[i] * light.highlight[c][i]
            })
        })
    }
}
