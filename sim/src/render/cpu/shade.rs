//! From visible triangles to bytes: every pixel is looked at once, in groups along a row.

use core::f32::consts::FRAC_1_PI;

use super::lanes::{Lanes, Lanes3, N_LANES, dot, dot_all};
use super::raster::{NOTHING, Visibility};
use super::sample::sample;
use super::surface::{Surface, Surfaces};
use crate::render::View;
use crate::render::affine::{Affine, Vec3};
use crate::render::scene::{RenderScene, Sun, pattern};
use crate::render::srgb::Encoder;

/// Brightness of the highlight of a white sun on a surface of specular strength 1.
const GLOSS: f32 = 0.4;
/// What share of the ambient light comes from below, relative to that from above.
const GROUND: f32 = 0.55;

/// Writes the view's bytes.
#[inline(always)]
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
    let groups = view.out.chunks_exact_mut(N_LANES * 3).zip(visibility.ids.chunks_exact(N_LANES));
    for (group, (bytes, ids)) in groups.enumerate() {
        let ids: &[u32; N_LANES] = ids.try_into().expect("N_LANES long");
        if ids.iter().all(|id| *id == NOTHING) {
            bytes.fill(0);
            continue;
        }
        let column = Lanes::counting((group * N_LANES % side) as f32);
        let row = (group * N_LANES / side) as f32;
        let hits = Hits::new(&Group::gather(ids, surfaces), column, row);
        let light = Light::new(scene, &hits.normal, &rays.to_eye(column, row));
        let looks = Looks::new(scene, ids, surfaces, &hits);
        looks.write(&light, encoder, bytes);
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

    /// Unit vectors from what is seen to the eye.
    #[inline(always)]
    fn to_eye(&self, column: Lanes, row: f32) -> Lanes3 {
        let axis = |k: usize| -(column * self.right[k] + (self.first[k] + self.down[k] * row));
        unit([axis(0), axis(1), axis(2)])
    }
}

/// Where the rays of a group meet their surfaces.
struct Hits {
    /// Unit normal in the world.
    normal: Lanes3,
    /// Texture coordinates, in tiles.
    uv: [Lanes; 2],
    /// Greater of the squared lengths, in tiles², that a step right and a step down make on the texture.
    footprint: Lanes,
}

impl Hits {
    #[inline(always)]
    fn new(s: &Group, column: Lanes, row: f32) -> Self {
        let per_n = Lanes::all(1.0) / s.plane(Surface::N, column, row);
        // A pixel at a silhouette may belong to the snapped triangle and just miss the exact one.
        let a = (s.plane(Surface::A, column, row) * per_n).at_least(0.0).at_most(1.0);
        let b = (s.plane(Surface::B, column, row) * per_n).at_least(0.0).at_most(1.0);
        let [nx, ny, nz] = [Surface::NORMAL, Surface::NORMAL + 1, Surface::NORMAL + 2];
        let normal = [s.blend(nx, 3, a, b), s.blend(ny, 3, a, b), s.blend(nz, 3, a, b)];
        let (right, down) = (s.stretch(1, a, b, per_n), s.stretch(2, a, b, per_n));
        Self {
            normal: unit(normal),
            uv: [s.blend(Surface::UV, 2, a, b), s.blend(Surface::UV + 1, 2, a, b)],
            footprint: right.max(down),
        }
    }
}

/// Vectors at length 1.
#[inline(always)]
fn unit(v: Lanes3) -> Lanes3 {
    let per_length = Lanes::all(1.0) / dot(&v, &v).at_least(1e-12).sqrt();
    [v[0] * per_length, v[1] * per_length, v[2] * per_length]
}

/// The surfaces of a group's pixels, number by number.
struct Group([Lanes; Surface::N_NUMBERS]);

impl Group {
    /// Looks them up; where nothing is seen, a neighbour stands in.
    #[inline(always)]
    fn gather(ids: &[u32; N_LANES], surfaces: &Surfaces) -> Self {
        let mut group = Self([Lanes::ZERO; Surface::N_NUMBERS]);
        let any = ids.iter().copied().find(|id| *id != NOTHING).expect("a group with nothing is not shaded");
        if ids.iter().all(|id| *id == any) {
            let surface = &surfaces.seen[any as usize];
            for k in 0..Surface::N_NUMBERS {
                group.0[k] = Lanes::all(surface.0[k]);
            }
            return group;
        }
        for (i, &id) in ids.iter().enumerate() {
            let surface = &surfaces.seen[if id == NOTHING { any } else { id } as usize];
            for k in 0..Surface::N_NUMBERS {
                group.0[k].0[i] = surface.0[k];
            }
        }
        group
    }

    /// A linear function of the pixel.
    #[inline(always)]
    fn plane(&self, k: usize, column: Lanes, row: f32) -> Lanes {
        self.0[k] + self.0[k + 1] * column + self.0[k + 2] * row
    }

    /// An attribute at p + a e + b f.
    #[inline(always)]
    fn blend(&self, k: usize, step: usize, a: Lanes, b: Lanes) -> Lanes {
        self.0[k] + a * self.0[k + step] + b * self.0[k + 2 * step]
    }

    /// Squared length in tiles² of a step right (`k` = 1) or down (`k` = 2): d(a/n) = (da - (a/n) dn) / n.
    #[inline(always)]
    fn stretch(&self, k: usize, a: Lanes, b: Lanes, per_n: Lanes) -> Lanes {
        let s = &self.0;
        let da = (s[Surface::A + k] - a * s[Surface::N + k]) * per_n;
        let db = (s[Surface::B + k] - b * s[Surface::N + k]) * per_n;
        let du = da * s[Surface::UV + 2] + db * s[Surface::UV + 4];
        let dv = da * s[Surface::UV + 3] + db * s[Surface::UV + 5];
        du * du + dv * dv
    }
}

/// Light that a group's pixels send to the eye.
struct Light {
    /// From a white surface.
    diffuse: Lanes3,
    /// From a surface of specular strength 1, on top.
    highlight: Lanes3,
}

impl Light {
    #[inline(always)]
    fn new(scene: &RenderScene, normal: &Lanes3, to_eye: &Lanes3) -> Self {
        let sky = normal[2] * ((1.0 - GROUND) / 2.0) + (1.0 + GROUND) / 2.0;
        let [first, second] = &scene.suns;
        let (lambert, phong) = reflect(first, normal, to_eye);
        let (lambert_2, phong_2) = reflect(second, normal, to_eye);
        let mut light = Self { diffuse: [Lanes::ZERO; 3], highlight: [Lanes::ZERO; 3] };
        for c in 0..3 {
            light.diffuse[c] =
                sky * scene.ambient[c] + lambert * first.color[c] + lambert_2 * second.color[c];
            light.highlight[c] = phong * first.color[c] + phong_2 * second.color[c];
        }
        light
    }
}

/// Shares of a sun's light that are scattered and mirrored to the eye.
#[inline(always)]
fn reflect(sun: &Sun, normal: &Lanes3, to_eye: &Lanes3) -> (Lanes, Lanes) {
    let [x, y, z] = sun.towards;
    let facing = dot_all(normal, sun.towards).at_least(0.0);
    let half = [to_eye[0] + x, to_eye[1] + y, to_eye[2] + z];
    let aligned = dot(normal, &half).at_least(0.0);
    // (n·h)² / |h|², raised to the 16th: from 0.01 up, lest powers that nobody sees become slow subnormal numbers.
    let squared = (aligned * aligned / dot(&half, &half).at_least(1e-12)).at_least(0.01);
    let fourth = squared * squared;
    let eighth = fourth * fourth;
    let sixteenth = eighth * eighth;
    (facing * FRAC_1_PI, (sixteenth * sixteenth * GLOSS).where_positive(facing))
}

/// Reflectance of a group's pixels.
struct Looks {
    color: Lanes3,
    specular: Lanes,
}

impl Looks {
    #[inline(always)]
    fn new(scene: &RenderScene, ids: &[u32; N_LANES], surfaces: &Surfaces, hits: &Hits) -> Self {
        let material_of = |id: u32| &scene.instances[surfaces.instance[id as usize] as usize].material;
        if ids[0] != NOTHING && ids.iter().all(|id| *id == ids[0]) {
            let material = material_of(ids[0]);
            let [r, g, b] = material.color;
            let color = [Lanes::all(r), Lanes::all(g), Lanes::all(b)];
            let mut looks = Self { color, specular: Lanes::all(material.specular) };
            if let Some(texture) = material.texture {
                looks.tint(&[true; N_LANES], &sample(pattern(texture), &hits.uv, &hits.footprint));
            }
            return looks;
        }
        let mut looks = Self { color: [Lanes::ZERO; 3], specular: Lanes::ZERO };
        let mut textures = [None; N_LANES];
        for (i, &id) in ids.iter().enumerate().filter(|(_, id)| **id != NOTHING) {
            let material = material_of(id);
            for c in 0..3 {
                looks.color[c].0[i] = material.color[c];
            }
            looks.specular.0[i] = material.specular;
            textures[i] = material.texture;
        }
        // Whatever is sampled is sampled for the whole group: few groups see two textures.
        while let Some(texture) = textures.iter().copied().flatten().next() {
            let mut wears = [false; N_LANES];
            for (wears, worn) in wears.iter_mut().zip(&mut textures) {
                if *worn == Some(texture) {
                    (*wears, *worn) = (true, None);
                }
            }
            looks.tint(&wears, &sample(pattern(texture), &hits.uv, &hits.footprint));
        }
        looks
    }

    /// Multiplies the colours of some pixels.
    #[inline(always)]
    fn tint(&mut self, which: &[bool; N_LANES], factors: &Lanes3) {
        for (color, factors) in self.color.iter_mut().zip(factors) {
            for ((value, factor), tinted) in color.0.iter_mut().zip(factors.0).zip(which) {
                *value *= if *tinted { factor } else { 1.0 };
            }
        }
    }

    /// Writes the light that reaches the eye as bytes.
    #[inline(always)]
    fn write(&self, light: &Light, encoder: &Encoder, bytes: &mut [u8]) {
        let channel = |c: usize| self.color[c] * light.diffuse[c] + self.specular * light.highlight[c];
        let rgb = [channel(0), channel(1), channel(2)];
        for (i, pixel) in bytes.chunks_exact_mut(3).enumerate() {
            for c in 0..3 {
                pixel[c] = encoder.encode(rgb[c].0[i]);
            }
        }
    }
}
