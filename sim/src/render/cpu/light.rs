//! Light on a surface: the same steps for one normal and for sixteen.

use core::f32::consts::FRAC_1_PI;

use super::each::each;
use super::rays::Gaze;
use super::simd::{Broadcast, FloatLike, Simd, SimdF32, SimdMask};
use crate::render::math::affine::{Affine3, Vec3, scaled};
use crate::render::scene::{N_SUNS, RenderScene};
use crate::render::shading::{GROUND_AMBIENT, SPECULAR_FALLOFF, SPECULAR_GAIN};

/// The lights of a scene in the view frame.
pub(super) struct Lamps {
    up: Vec3,
    ambient: Vec3,
    suns: [Sun; N_SUNS],
}

struct Sun {
    towards: Vec3,
    /// Light that a white surface scatters when it faces the sun.
    scattered: Vec3,
    /// Brightness of the highlight's middle.
    gleam: Vec3,
}

impl Lamps {
    /// As a camera sees them.
    pub(super) fn new(scene: &RenderScene, view_from_world: &Affine3) -> Self {
        Self {
            up: view_from_world.transform_vector([0.0, 0.0, 1.0]),
            ambient: scene.ambient,
            suns: each!(i in 2 => Sun {
                towards: view_from_world.transform_vector(scene.suns[i].towards),
                scattered: scaled(scene.suns[i].color, FRAC_1_PI),
                gleam: scaled(scene.suns[i].color, SPECULAR_GAIN),
            }),
        }
    }
}

/// Light that reaches a surface, by where it goes.
pub(super) struct Lit<N> {
    /// Unit normal.
    pub(super) normal: [N; 3],
    /// Scattered by a white surface, but for the first sun's share.
    scattered: [N; 3],
    /// The first sun's share.
    first_sun: [N; 3],
    /// Per sun the direction to it, mirrored: it points away from where the highlight is seen.
    mirrored: [[N; 3]; N_SUNS],
}

impl Lit<f32> {
    /// No light.
    pub(super) const DARK: Self =
        Self { normal: [0.0; 3], scattered: [0.0; 3], first_sun: [0.0; 3], mirrored: [[0.0; 3]; N_SUNS] };
}

/// What a surface is painted with.
pub(super) struct Paint<S: Simd> {
    /// Linear RGB.
    pub(super) color: [S::F; 3],
    /// Square roots of a texture's factors.
    pub(super) tint: [S::F; 3],
    /// Strength of the highlights.
    pub(super) specular: S::F,
}

impl Lit<f32> {
    /// Square roots of the light that reaches the eye from a surface without a texture where there is neither a shadow
    /// nor a highlight: the steps of [`seen`] for one number.
    #[inline(always)]
    pub(super) fn plain_roots(&self, color: [f32; 3]) -> [f32; 3] {
        core::array::from_fn(|c| (color[c] * (self.first_sun[c] + self.scattered[c])).sqrt())
    }

    /// Whether a highlight may be seen within the four corners of a part of the image, given the rays d there: upper left,
    /// upper right, lower left, lower right.
    #[inline(always)]
    pub(super) fn gleams(&self, corners: &[[f32; 2]; 4]) -> bool {
        // Some slack for rounding.
        const LEAST: f32 = 1.0 - 1.0 / SPECULAR_FALLOFF - 0.001;
        let nearest = |a: f32, b: f32| if a * b > 0.0 { a.abs().min(b.abs()) } else { 0.0 };
        let [[left, top], _, _, [right, bottom]] = *corners;
        let (dx, dy) = (nearest(left, right), nearest(top, bottom));
        let least = LEAST * (dx * dx + dy * dy + 1.0).sqrt();
        // What is linear is greatest at a corner.
        let aligned = |[x, y, z]: &[f32; 3], [dx, dy]: &[f32; 2]| x * dx + y * dy + z > least;
        self.mirrored.iter().any(|mirrored| corners.iter().any(|d| aligned(mirrored, d)))
    }
}

impl<N: FloatLike> Lit<N> {
    /// On surfaces with these normals, of any length.
    #[inline(always)]
    pub(super) fn new(lamps: &Lamps, normal: [N; 3]) -> Self {
        let squared = dot(normal, normal).max(N::splat(1e-30));
        let per_length = N::splat(1.0) / squared.sqrt();
        let n = each!(k in 3 => normal[k] * per_length);
        let sky = dot(n, all(lamps.up))
            .mul_add(N::splat((1.0 - GROUND_AMBIENT) / 2.0), N::splat((1.0 + GROUND_AMBIENT) / 2.0));
        let facing = each!(i in 2 => dot(n, all(lamps.suns[i].towards)).max(N::splat(0.0)));
        let [first, second] = &lamps.suns;
        Self {
            normal: n,
            scattered: each!(c in 3 =>
                facing[1].mul_add(N::splat(second.scattered[c]), sky * N::splat(lamps.ambient[c]))),
            first_sun: each!(c in 3 => facing[0] * N::splat(first.scattered[c])),
            mirrored: each!(i in 2 => {
                let twice = facing[i] * N::splat(-2.0);
                let towards = lamps.suns[i].towards;
                each!(k in 3 => twice.mul_add(n[k], N::splat(towards[k])).zero_unless_positive(facing[i]))
            }),
        }
    }

    /// Where the first sun is in front of the surface. Elsewhere it makes no difference what share of its light arrives.
    #[inline(always)]
    pub(super) fn faces_first_sun<S: Simd>(&self) -> S::M
    where
        N: Broadcast<S>,
    {
        let [r, g, b] = each!(c in 3 => self.first_sun[c].broadcast());
        r.max(g.max(b)).gt(S::F::splat(0.0))
    }
}

/// Square roots of the light that reaches the eye, linear RGB, given what share of the first sun's light arrives (`None`
/// for all), the surface's colour, the square roots of its texture's factors and the strength of its highlights; `gleams` if there may
/// be any.
#[inline(always)]
pub(super) fn seen<S: Simd, N: Broadcast<S>>(
    lit: &Lit<N>,
    lamps: &Lamps,
    gleams: bool,
    gaze: &Gaze<S>,
    sunlight: Option<S::F>,
    paint: &Paint<S>,
) -> [S::F; 3] {
    let Paint { color, tint, specular } = *paint;
    let sunlight = match sunlight {
        Some(share) => share,
        None => S::F::splat(1.0),
    };
    let plain = each!(c in 3 =>
        color[c] * sunlight.mul_add(lit.first_sun[c].broadcast(), lit.scattered[c].broadcast()));
    // Without a highlight all but the texture may be the same for many pixels: see `Lit::plain_roots`.
    if !gleams {
        return each!(c in 3 => plain[c].sqrt() * tint[c]);
    }
    let (zero, [dx, dy]) = (S::F::splat(0.0), gaze.d);
    let gleam = each!(i in 2 => {
        let [x, y, z] = each!(k in 3 => lit.mirrored[i][k].broadcast());
        let aligned = x.mul_add(dx, y.mul_add(dy, z)) * gaze.per_length;
        aligned.mul_add(S::F::splat(SPECULAR_FALLOFF), S::F::splat(1.0 - SPECULAR_FALLOFF)).max(zero)
    });
    let gleaming = ((gleam[0] + gleam[1]) * specular).gt(zero);
    // Most of a picture is away from highlights.
    if !gleaming.any() {
        return each!(c in 3 => plain[c].sqrt() * tint[c]);
    }
    let [first, second] = each!(i in 2 => gleam[i] * gleam[i] * specular);
    let first = first * sunlight;
    each!(c in 3 => {
        let light = plain[c] * (tint[c] * tint[c]);
        let light = first.mul_add(S::F::splat(lamps.suns[0].gleam[c]), light);
        let light = second.mul_add(S::F::splat(lamps.suns[1].gleam[c]), light);
        light.select_or(gleaming, plain[c]).sqrt() * S::F::splat(1.0).select_or(gleaming, tint[c])
    })
}

/// The same vector everywhere.
#[inline(always)]
fn all<N: FloatLike>(v: Vec3) -> [N; 3] {
    each!(k in 3 => N::splat(v[k]))
}

/// Dot product, in a fixed order.
#[inline(always)]
pub(super) fn dot<N: FloatLike>(a: [N; 3], b: [N; 3]) -> N {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}
