//! The lighting model of `SHADING.md`, generic over one normal or sixteen.

use core::f32::consts::FRAC_1_PI;

use crate::cpu::shading::rays::ViewRays;
use crate::cpu::simd::each::each;
use crate::cpu::simd::{Broadcast, FloatLike, Simd, SimdF32, SimdMask};
use crate::math::affine::{Affine3, Vec3, scaled};
use crate::prepared::{N_SUNS, RenderScene};
use crate::shading::{SPECULAR_FALLOFF, SPECULAR_VISIBILITY};

/// The lights of a scene, in the view frame.
pub(crate) struct ViewLights {
    ambient: Vec3,
    suns: [ViewSun; N_SUNS],
}

struct ViewSun {
    towards: Vec3,
    color: Vec3,
    /// Diffuse radiance of a white surface that faces the sun.
    diffuse: Vec3,
}

impl ViewLights {
    /// Transforms the lights of a scene into the view frame.
    pub(crate) fn new(scene: &RenderScene, view_from_world: &Affine3) -> Self {
        Self {
            ambient: scene.ambient,
            suns: each!(i in 2 => ViewSun {
                towards: view_from_world.transform_vector(scene.suns[i].towards),
                color: scene.suns[i].color,
                diffuse: scaled(scene.suns[i].color, FRAC_1_PI),
            }),
        }
    }
}

/// The geometric terms of the lighting model.
pub(crate) struct Lighting<N> {
    /// Unit normal in the view frame.
    pub(crate) normal: [N; 3],
    /// Per sun the cosine of the angle between the normal and the direction to it, 0 if it is below the
    /// horizon.
    facing: [N; N_SUNS],
    /// Per sun the reflected direction to it, negated: it points away from an eye that sees the highlight's
    /// centre.
    reflected: [[N; 3]; N_SUNS],
}

impl Lighting<f32> {
    /// Lighting without any light.
    pub(crate) const DARK: Self =
        Self { normal: [0.0; 3], facing: [0.0; N_SUNS], reflected: [[0.0; 3]; N_SUNS] };
}

/// The material at sixteen surface points.
pub(crate) struct Reflectance<S: Simd> {
    /// Reflectance, linear RGB.
    pub(crate) color: [S::F; 3],
    /// The square roots of the texture's linear factors.
    pub(crate) tint: [S::F; 3],
    /// Specular reflectance in white; 0 for a metal.
    pub(crate) specular: S::F,
    /// 1 for a metal, 0 for anything else.
    pub(crate) metallic: S::F,
}

impl Lighting<f32> {
    /// Returns the square roots of the radiance of an untextured surface that has neither shadows nor
    /// highlights. Performs the operations of [`radiance_roots`] on scalars.
    #[inline(always)]
    pub(crate) fn unshadowed_roots(&self, lights: &ViewLights, color: [f32; 3], metallic: f32) -> [f32; 3] {
        let [first, second] = &lights.suns;
        core::array::from_fn(|c| {
            let suns = self.facing[0].mul_add(first.diffuse[c], self.facing[1] * second.diffuse[c]);
            (color[c] * suns.mul_add(1.0 - metallic, lights.ambient[c])).sqrt()
        })
    }
}

impl<N: FloatLike> Lighting<N> {
    /// Computes the lighting of surfaces with the given view-frame normals, which need not be normalised.
    #[inline(always)]
    pub(crate) fn new(lights: &ViewLights, normal: [N; 3]) -> Self {
        let squared = dot(normal, normal).max(N::splat(1e-30));
        let inv_length = N::splat(1.0) / squared.sqrt();
        let n = each!(k in 3 => normal[k] * inv_length);
        let facing = each!(i in 2 => dot(n, splat3(lights.suns[i].towards)).max(N::splat(0.0)));
        Self {
            normal: n,
            facing,
            reflected: each!(i in 2 => {
                let twice = facing[i] * N::splat(-2.0);
                each!(k in 3 => twice.mul_add(n[k], N::splat(lights.suns[i].towards[k])))
            }),
        }
    }

    /// Returns the lanes whose surface faces the first sun. In the others, shadows of that sun have no
    /// effect.
    #[inline(always)]
    pub(crate) fn faces_first_sun<S: Simd>(&self) -> S::M
    where
        N: Broadcast<S>,
    {
        self.facing[0].broadcast().gt(S::F::splat(0.0))
    }
}

/// Returns the square roots of the radiance towards the eye, linear RGB. `sunlight` is the fraction of the
/// first sun's light that arrives, `None` for all of it.
#[inline(always)]
pub(crate) fn radiance_roots<S: Simd, N: Broadcast<S>>(
    lighting: &Lighting<N>,
    lights: &ViewLights,
    ray: &ViewRays<S>,
    sunlight: Option<S::F>,
    reflectance: &Reflectance<S>,
) -> [S::F; 3] {
    let Reflectance { color, tint, specular, metallic } = *reflectance;
    let [first, second] = &lights.suns;
    let facing: [S::F; 2] = each!(i in 2 => lighting.facing[i].broadcast());
    let lit = match sunlight {
        Some(fraction) => [facing[0] * fraction, facing[1]],
        None => facing,
    };
    let matt = S::F::splat(1.0) - metallic;
    let diffuse = each!(c in 3 => {
        let suns = lit[0].mul_add(S::F::splat(first.diffuse[c]), lit[1] * S::F::splat(second.diffuse[c]));
        color[c] * suns.mul_add(matt, S::F::splat(lights.ambient[c]))
    });
    // Most surfaces are matt. Only the texture may then vary between pixels; `Lighting::unshadowed_roots`
    // relies on this.
    let glossy = (specular + metallic).gt(S::F::splat(0.0));
    if !glossy.any() {
        return each!(c in 3 => diffuse[c].sqrt() * tint[c]);
    }
    let [dx, dy] = ray.d;
    let lobe = each!(i in 2 => {
        let [x, y, z] = each!(k in 3 => lighting.reflected[i][k].broadcast());
        let aligned = x.mul_add(dx, y.mul_add(dy, z)) * ray.inv_length;
        let width = aligned.mul_add(S::F::splat(-SPECULAR_FALLOFF), S::F::splat(1.0 + SPECULAR_FALLOFF));
        let visibility = facing[i]
            .mul_add(S::F::splat(1.0 - SPECULAR_VISIBILITY), S::F::splat(SPECULAR_VISIBILITY));
        lit[i] / (width * width * visibility)
    });
    each!(c in 3 => {
        let factor = tint[c] * tint[c];
        let highlight = lobe[0].mul_add(S::F::splat(first.color[c]), lobe[1] * S::F::splat(second.color[c]));
        let highlight_color = (color[c] * factor).mul_add(metallic, specular);
        let light = highlight.mul_add(highlight_color, diffuse[c] * factor);
        light.select_or(glossy, diffuse[c]).sqrt() * S::F::splat(1.0).select_or(glossy, tint[c])
    })
}

#[inline(always)]
fn splat3<N: FloatLike>(v: Vec3) -> [N; 3] {
    each!(k in 3 => N::splat(v[k]))
}

/// Returns the dot product, evaluated in a fixed order.
#[inline(always)]
pub(crate) fn dot<N: FloatLike>(a: [N; 3], b: [N; 3]) -> N {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}
