//! Numbers and frames of `SHADING.md` that both renderers follow, each stated once.

use super::math::affine::{Affine3, Vec3, cross, dot, normalised};

/// Brightness of the highlight of a white sun on a surface of specular strength 1.
pub(super) const SPECULAR_GAIN: f32 = 0.4;
/// How fast a highlight fades: it reaches as far as the cosine of the angle to its middle is above 1 − 1/`SPECULAR_FALLOFF`.
pub(super) const SPECULAR_FALLOFF: f32 = 8.0;
/// What share of the ambient light comes from below, relative to that from above.
pub(super) const GROUND_AMBIENT: f32 = 0.55;
/// Texels along each edge of a shadow map.
pub(super) const SHADOW_MAP_SIDE: u32 = 512;
/// Width of a shadow map, in m.
pub(super) const SHADOW_MAP_WIDTH_M: f32 = 2.8;
/// Heights in a shadow map are told apart within this distance of its centre, in m.
pub(super) const SHADOW_HALF_DEPTH_M: f32 = 8.0;
/// Steps of height in a shadow map.
pub(super) const SHADOW_DEPTH_LEVELS: f32 = 65536.0;
/// How far a point is moved along its normal before it is looked up in a map, in m: a texel and a half.
pub(super) const SHADOW_NORMAL_OFFSET_M: f32 = 0.008;

/// From the world to the light's frame, in m from a map's middle: right and down on the map, and the height along the
/// light.
pub(super) fn light_from_world(towards: Vec3, centre: Vec3) -> Affine3 {
    let side = cross([0.0, 1.0, 0.0], towards);
    let right = if dot(side, side) > 1e-6 { normalised(side) } else { [1.0, 0.0, 0.0] };
    let linear = [right, cross(right, towards), towards];
    Affine3 { linear, offset: linear.map(|row| -dot(row, centre)) }
}

#[cfg(test)]
mod tests {
    use super::light_from_world;
    use crate::render::math::affine::normalised;

    #[test]
    fn the_centre_is_the_origin_and_what_is_nearer_to_the_light_is_higher() {
        let centre = [-0.1, 0.0, 0.35];
        for towards in [[0.3, -0.5, 1.0], [0.0, 1.0, 0.0]].map(normalised) {
            let light = light_from_world(towards, centre);
            assert!(light.point(centre).iter().all(|x| x.abs() < 1e-6), "{towards:?}");
            let nearer = core::array::from_fn(|i| centre[i] + towards[i]);
            let [x, y, height] = light.point(nearer);
            assert!(x.abs() < 1e-6 && y.abs() < 1e-6 && (height - 1.0).abs() < 1e-6, "{towards:?}");
        }
    }
}
