//! Light on a surface: the same steps for one normal and for sixteen.

use core::f32::consts::FRAC_1_PI;

use crate::render::cpu::shading::rays::ViewRays;
use crate::render::cpu::simd::each::each;
use crate::render::cpu::simd::{Broadcast, FloatLike, Simd, SimdF32, SimdMask};
use crate::render::math::affine::{Affine3, Vec3, scaled};
use crate::render::scene::{N_SUNS, RenderScene};
use crate::render::shading::{GROUND_AMBIENT, SPECULAR_FALLOFF, SPECULAR_GAIN};

/// The lights of a scene in the view frame.
pub(in crate::render::cpu) struct ViewLights {
    up: Vec3,
    ambient: Vec3,
    suns: [ViewSun; N_SUNS],
}

struct ViewSun {
    towards: Vec3,
    /// Light that a white surface scatters when it faces the sun.
    diffuse: Vec3,
    /// Brightness of the highlight's middle.
    specular_light: Vec3,
}

impl ViewLights {
    /// As a camera sees them.
    pub(in crate::render::cpu) fn new(scene: &RenderScene, view_from_world: &Affine3) -> Self {
        Self {
            up: view_from_world.transform_vector([0.0, 0.0, 1.0]),
            ambient: scene.ambient,
            suns: each!(i in 2 => ViewSun {
                towards: view_from_world.transform_vector(scene.suns[i].towards),
                diffuse: scaled(scene.suns[i].color, FRAC_1_PI),
                specular_light: scaled(scene.suns[i].color, SPECULAR_GAIN),
            }),
        }
    }
}

/// Light that light_bounds a surface, by where it goes.
pub(in crate::render::cpu) struct Lighting<N> {
    /// Unit normal.
    pub(in crate::render::cpu) normal: [N; 3],
    /// Scattered by a white surface, but for the first sun's share.
    diffuse: [N; 3],
    /// The first sun's share.
    first_sun: [N; 3],
    /// Per sun the direction to it, reflected: it points away from where the highlight is seen.
    reflected: [[N; 3]; N_SUNS],
}

impl Lighting<f32> {
    /// No light.
    pub(in crate::render::cpu) const DARK: Self =
        Self { normal: [0.0; 3], diffuse: [0.0; 3], first_sun: [0.0; 3], reflected: [[0.0; 3]; N_SUNS] };
}

/// What a surface is painted with.
pub(in crate::render::cpu) struct Reflectance<S: Simd> {
    /// Linear RGB.
    pub(in crate::render::cpu) color: [S::F; 3],
    /// Tile4x4 roots of a texture's factors.
    pub(in crate::render::cpu) tint: [S::F; 3],
    /// Strength of the highlights.
    pub(in crate::render::cpu) specular: S::F,
}

impl Lighting<f32> {
    /// Tile4x4 roots of the light that light_bounds the eye from a surface without a texture where there is neither a shadow
    /// nor a highlight: the steps of [`seen`] for one number.
    #[inline(always)]
    pub(in crate::render::cpu) fn unshadowed_roots(&self, color: [f32; 3]) -> [f32; 3] {
        core::array::from_fn(|c| (color[c] * (self.first_sun[c] + self.diffuse[c])).sqrt())
    }

    /// Whether a highlight may be seen within the four corners of a part of the image, given the rays d there: upper left,
    /// upper right, lower left, lower right.
    #[inline(always)]
    pub(in crate::render::cpu) fn may_highlight(&self, corners: &[[f32; 2]; 4]) -> bool {
        // Some slack for rounding.
        const LEAST: f32 = 1.0 - 1.0 / SPECULAR_FALLOFF - 0.001;
        let nearest = |a: f32, b: f32| if a * b > 0.0 { a.abs().min(b.abs()) } else { 0.0 };
        let [[left, top], _, _, [right, bottom]] = *corners;
        let (dx, dy) = (nearest(left, right), nearest(top, bottom));
        let least = LEAST * (dx * dx + dy * dy + 1.0).sqrt();
        // What is linear is greatest at a corner.
        let aligned = |[x, y, z]: &[f32; 3], [dx, dy]: &[f32; 2]| x * dx + y * dy + z > least;
        self.reflected.iter().any(|reflected| corners.iter().any(|d| aligned(reflected, d)))
    }
}

impl<N: FloatLike> Lighting<N> {
    /// On surfaces with these normals, of any length.
    #[inline(always)]
    pub(in crate::render::cpu) fn new(lights: &ViewLights, normal: [N; 3]) -> Self {
        let squared = dot(normal, normal).max(N::splat(1e-30));
        let inv_length = N::splat(1.0) / squared.sqrt();
        let n = each!(k in 3 => normal[k] * inv_length);
        let sky = dot(n, all(lights.up))
            .mul_add(N::splat((1.0 - GROUND_AMBIENT) / 2.0), N::splat((1.0 + GROUND_AMBIENT) / 2.0));
        let facing = each!(i in 2 => dot(n, all(lights.suns[i].towards)).max(N::splat(0.0)));
        let [first, second] = &lights.suns;
        Self {
            normal: n,
            diffuse: each!(c in 3 =>
                facing[1].mul_add(N::splat(second.diffuse[c]), sky * N::splat(lights.ambient[c]))),
            first_sun: each!(c in 3 => facing[0] * N::splat(first.diffuse[c])),
            reflected: each!(i in 2 => {
                let twice = facing[i] * N::splat(-2.0);
                let towards = lights.suns[i].towards;
                each!(k in 3 => twice.mul_add(n[k], N::splat(towards[k])).zero_unless_positive(facing[i]))
            }),
        }
    }

    /// Where the first sun is in front of the surface. Elsewhere it makes no difference what share of its light arrives.
    #[inline(always)]
    pub(in crate::render::cpu) fn faces_first_sun<S: Simd>(&self) -> S::M
    where
        N: Broadcast<S>,
    {
        let [r, g, b] = each!(c in 3 => self.first_sun[c].broadcast());
        r.max(g.max(b)).gt(S::F::splat(0.0))
    }
}

/// Tile4x4 roots of the light that light_bounds the eye, linear RGB, given what share of the first sun's light arrives (`None`
/// for all), the surface's colour, the square roots of its texture's factors and the strength of its highlights; `may_highlight` if there may
/// be any.
#[inline(always)]
pub(in crate::render::cpu) fn radiance_roots<S: Simd, N: Broadcast<S>>(
    lighting: &Lighting<N>,
    lights: &ViewLights,
    may_highlight: bool,
    ray: &ViewRays<S>,
    sunlight: Option<S::F>,
    reflectance: &Reflectance<S>,
) -> [S::F; 3] {
    let Reflectance { color, tint, specular } = *reflectance;
    let sunlight = match sunlight {
        Some(share) => share,
        None => S::F::splat(1.0),
    };
    let plain = each!(c in 3 =>
        color[c] * sunlight.mul_add(lighting.first_sun[c].broadcast(), lighting.diffuse[c].broadcast()));
    // Without a highlight all but the texture may be the same for many pixels: see `Lighting::unshadowed_roots`.
    if !may_highlight {
        return each!(c in 3 => plain[c].sqrt() * tint[c]);
    }
    let (zero, [dx, dy]) = (S::F::splat(0.0), ray.d);
    let specular_light = each!(i in 2 => {
        let [x, y, z] = each!(k in 3 => lighting.reflected[i][k].broadcast());
        let aligned = x.mul_add(dx, y.mul_add(dy, z)) * ray.inv_length;
        aligned.mul_add(S::F::splat(SPECULAR_FALLOFF), S::F::splat(1.0 - SPECULAR_FALLOFF)).max(zero)
    });
    let highlighted = ((specular_light[0] + specular_light[1]) * specular).gt(zero);
    // Most of a picture is away from highlights.
    if !highlighted.any() {
        return each!(c in 3 => plain[c].sqrt() * tint[c]);
    }
    let [first, second] = each!(i in 2 => specular_light[i] * specular_light[i] * specular);
    let first = first * sunlight;
    each!(c in 3 => {
        let light = plain[c] * (tint[c] * tint[c]);
        let light = first.mul_add(S::F::splat(lights.suns[0].specular_light[c]), light);
        let light = second.mul_add(S::F::splat(lights.suns[1].specular_light[c]), light);
        light.select_or(highlighted, plain[c]).sqrt() * S::F::splat(1.0).select_or(highlighted, tint[c])
    })
}

/// The same vector everywhere.
#[inline(always)]
fn all<N: FloatLike>(v: Vec3) -> [N; 3] {
    each!(k in 3 => N::splat(v[k]))
}

/// Dot product, in a fixed order.
#[inline(always)]
pub(in crate::render::cpu) fn dot<N: FloatLike>(a: [N; 3], b: [N; 3]) -> N {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}
