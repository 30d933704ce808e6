//! Constants and the light frame of `SHADING.md`, shared by both renderers.

use super::math::affine::{Affine3, Vec3, cross, dot, normalised};

/// Falloff of the specular lobe: that of a surface of roughness 0.53 (GGX), like the benchmark's table.
pub(crate) const SPECULAR_FALLOFF: f32 = 6.0;
/// Fraction of the specular reflection that does not depend on the angle of incidence (Schlick's
/// approximation of Smith's visibility, for the same roughness).
pub(crate) const SPECULAR_VISIBILITY: f32 = 0.3;
/// Side of a shadow map, in texels.
pub(crate) const SHADOW_MAP_SIDE: u32 = 512;
/// Side of the square that a shadow map covers, in m.
pub(crate) const SHADOW_MAP_WIDTH_M: f32 = 2.8;
/// Half the depth range of a shadow map: the largest distance from its centre along the light that it
/// resolves, in m.
pub(crate) const SHADOW_HALF_DEPTH_M: f32 = 8.0;
/// Number of depth levels of a shadow map: a texel has 16 bits.
pub(crate) const SHADOW_DEPTH_LEVELS: f32 = 65536.0;
/// Normal offset that is applied before a shadow lookup, in m: one and a half texels.
pub(crate) const SHADOW_NORMAL_OFFSET_M: f32 = 0.008;

/// Returns the transform from the world to the light frame, whose origin is `centre`, the centre of the
/// shadow map. Its axes are right and down on the map and `towards`, the unit vector to the light.
pub(crate) fn light_from_world(towards: Vec3, centre: Vec3) -> Affine3 {
    let side = cross([0.0, 1.0, 0.0], towards);
    let right = if dot(side, side) > 1e-6 { normalised(side) } else { [1.0, 0.0, 0.0] };
    let linear = [right, cross(right, towards), towards];
    Affine3 { linear, offset: linear.map(|row| -dot(row, centre)) }
}

#[cfg(test)]
mod tests {
    use super::light_from_world;
    use crate::math::affine::normalised;

    #[test]
    fn light_frame_origin_is_map_centre() {
        let centre = [-0.1, 0.0, 0.35];
        for towards in [[0.3, -0.5, 1.0], [0.0, 1.0, 0.0]].map(normalised) {
            let light = light_from_world(towards, centre);
            assert!(light.transform_point(centre).iter().all(|x| x.abs() < 1e-6), "{towards:?}");
            let nearer = core::array::from_fn(|i| centre[i] + towards[i]);
            let [x, y, height] = light.transform_point(nearer);
            assert!(x.abs() < 1e-6 && y.abs() < 1e-6 && (height - 1.0).abs() < 1e-6, "{towards:?}");
        }
    }
}
