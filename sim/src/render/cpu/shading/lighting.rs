//! The lighting model of `SHADING.md`, generic over one normal or sixteen.

use core::f32::consts::FRAC_1_PI;

use crate::render::cpu::shading::rays::ViewRays;
use crate::render::cpu::simd::each::each;
use crate::render::cpu::simd::{Broadcast, FloatLike, Simd, SimdF32, SimdMask};
use crate::render::math::affine::{Affine3, Vec3, scaled};
use crate::render::scene::{N_SUNS, RenderScene};
use crate::render::shading::{GROUND_AMBIENT, SPECULAR_FALLOFF, SPECULAR_GAIN};

/// The lights of a scene, in the view frame.
pub(in crate::render::cpu) struct ViewLights {
    up: Vec3,
    ambient: Vec3,
    suns: [ViewSun; N_SUNS],
}

struct ViewSun {
    towards: Vec3,
    /// Diffuse radiance of a white surface that faces the sun.
    diffuse: Vec3,
    /// Radiance at the centre of a specular highlight of strength 1.
    specular_light: Vec3,
}

impl ViewLights {
    /// Transforms the lights of a scene into the view frame.
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

/// The light that a surface reflects, split into the terms of the lighting model.
pub(in crate::render::cpu) struct Lighting<N> {
    /// Unit normal in the view frame.
    pub(in crate::render::cpu) normal: [N; 3],
    /// Diffuse radiance of a white surface, without the contribution of the first sun.
    diffuse: [N; 3],
    /// Diffuse contribution of the first sun, unshadowed.
    first_sun: [N; 3],
    /// Per sun the reflected direction to it, negated: it points away from an eye that sees the highlight's
    /// centre.
    reflected: [[N; 3]; N_SUNS],
}

impl Lighting<f32> {
    /// Lighting without any light.
    pub(in crate::render::cpu) const DARK: Self =
        Self { normal: [0.0; 3], diffuse: [0.0; 3], first_sun: [0.0; 3], reflected: [[0.0; 3]; N_SUNS] };
}

/// The material at sixteen surface points.
pub(in crate::render::cpu) struct Reflectance<S: Simd> {
    /// Diffuse reflectance, linear RGB.
    pub(in crate::render::cpu) color: [S::F; 3],
    /// The square roots of the texture's linear factors.
    pub(in crate::render::cpu) tint: [S::F; 3],
    /// Strength of the specular highlights, in [0, 1].
    pub(in crate::render::cpu) specular: S::F,
}

impl Lighting<f32> {
    /// Returns the square roots of the radiance of an untextured surface that has neither shadows nor
    /// highlights. Performs the operations of [`radiance_roots`] on scalars.
    #[inline(always)]
    pub(in crate::render::cpu) fn unshadowed_roots(&self, color: [f32; 3]) -> [f32; 3] {
        core::array::from_fn(|c| (color[c] * (self.first_sun[c] + self.diffuse[c])).sqrt())
    }

    /// Returns `true` if a highlight may be visible within a rectangle of the image, given the ray
    /// directions d at its corners: upper left, upper right, lower left, lower right.
    #[inline(always)]
    pub(in crate::render::cpu) fn may_highlight(&self, corners: &[[f32; 2]; 4]) -> bool {
        // Cosine at which a highlight begins, with slack for rounding.
        const MIN_COSINE: f32 = 1.0 - 1.0 / SPECULAR_FALLOFF - 0.001;
        let nearest = |a: f32, b: f32| if a * b > 0.0 { a.abs().min(b.abs()) } else { 0.0 };
        let [[left, top], _, _, [right, bottom]] = *corners;
        let (dx, dy) = (nearest(left, right), nearest(top, bottom));
        let min_aligned = MIN_COSINE * (dx * dx + dy * dy + 1.0).sqrt();
        // A linear function attains its maximum at a corner.
        let aligned = |[x, y, z]: &[f32; 3], [dx, dy]: &[f32; 2]| x * dx + y * dy + z > min_aligned;
        self.reflected.iter().any(|reflected| corners.iter().any(|d| aligned(reflected, d)))
    }
}

impl<N: FloatLike> Lighting<N> {
    /// Computes the lighting of surfaces with the given view-frame normals, which need not be normalised.
    #[inline(always)]
    pub(in crate::render::cpu) fn new(lights: &ViewLights, normal: [N; 3]) -> Self {
        let squared = dot(normal, normal).max(N::splat(1e-30));
        let inv_length = N::splat(1.0) / squared.sqrt();
        let n = each!(k in 3 => normal[k] * inv_length);
        let sky = dot(n, splat3(lights.up))
            .mul_add(N::splat((1.0 - GROUND_AMBIENT) / 2.0), N::splat((1.0 + GROUND_AMBIENT) / 2.0));
        let facing = each!(i in 2 => dot(n, splat3(lights.suns[i].towards)).max(N::splat(0.0)));
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

    /// Returns the lanes whose surface faces the first sun. In the others, shadows of that sun have no
    /// effect.
    #[inline(always)]
    pub(in crate::render::cpu) fn faces_first_sun<S: Simd>(&self) -> S::M
    where
        N: Broadcast<S>,
    {
        let [r, g, b] = each!(c in 3 => self.first_sun[c].broadcast());
        r.max(g.max(b)).gt(S::F::splat(0.0))
    }
}

/// Returns the square roots of the radiance towards the eye, linear RGB. `sunlight` is the fraction of the
/// first sun's light that arrives, `None` for all of it. `may_highlight` is `false` if no highlight can be
/// visible.
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
        Some(fraction) => fraction,
        None => S::F::splat(1.0),
    };
    let diffuse = each!(c in 3 =>
        color[c] * sunlight.mul_add(lighting.first_sun[c].broadcast(), lighting.diffuse[c].broadcast()));
    // Without highlights, only the texture may vary between pixels; `Lighting::unshadowed_roots` relies on
    // this.
    if !may_highlight {
        return each!(c in 3 => diffuse[c].sqrt() * tint[c]);
    }
    let (zero, [dx, dy]) = (S::F::splat(0.0), ray.d);
    let specular_light = each!(i in 2 => {
        let [x, y, z] = each!(k in 3 => lighting.reflected[i][k].broadcast());
        let aligned = x.mul_add(dx, y.mul_add(dy, z)) * ray.inv_length;
        aligned.mul_add(S::F::splat(SPECULAR_FALLOFF), S::F::splat(1.0 - SPECULAR_FALLOFF)).max(zero)
    });
    let highlighted = ((specular_light[0] + specular_light[1]) * specular).gt(zero);
    // Most of an image has no highlights.
    if !highlighted.any() {
        return each!(c in 3 => diffuse[c].sqrt() * tint[c]);
    }
    let [first, second] = each!(i in 2 => specular_light[i] * specular_light[i] * specular);
    let first = first * sunlight;
    each!(c in 3 => {
        let light = diffuse[c] * (tint[c] * tint[c]);
        let light = first.mul_add(S::F::splat(lights.suns[0].specular_light[c]), light);
        let light = second.mul_add(S::F::splat(lights.suns[1].specular_light[c]), light);
        light.select_or(highlighted, diffuse[c]).sqrt() * S::F::splat(1.0).select_or(highlighted, tint[c])
    })
}

#[inline(always)]
fn splat3<N: FloatLike>(v: Vec3) -> [N; 3] {
    each!(k in 3 => N::splat(v[k]))
}

/// Returns the dot product, evaluated in a fixed order.
#[inline(always)]
pub(in crate::render::cpu) fn dot<N: FloatLike>(a: [N; 3], b: [N; 3]) -> N {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}
