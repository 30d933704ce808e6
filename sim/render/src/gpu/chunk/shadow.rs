//! Light-space transform of shadow maps in device units: texels, and heights in [0, 1].

use crate::math::affine::{Affine3, Vec3, scaled};
use crate::shading::{SHADOW_HALF_DEPTH_M, SHADOW_MAP_SIDE, SHADOW_MAP_WIDTH_M, light_from_world};

/// Returns the transform from the world to a shadow map: texels to the right and down, and the height along
/// the light, which is 0 at the far end of the map's depth range and 1 at the end nearest to the light.
pub(crate) fn map_from_world(towards: Vec3, centre: Vec3) -> Affine3 {
    let Affine3 { linear, offset } = light_from_world(towards, centre);
    let per_m = SHADOW_MAP_SIDE as f32 / SHADOW_MAP_WIDTH_M;
    let (scales, middle) = (
        [per_m, per_m, 0.5 / SHADOW_HALF_DEPTH_M],
        [SHADOW_MAP_SIDE as f32 / 2.0, SHADOW_MAP_SIDE as f32 / 2.0, 0.5],
    );
    Affine3 {
        linear: core::array::from_fn(|i| scaled(linear[i], scales[i])),
        offset: core::array::from_fn(|i| offset[i] * scales[i] + middle[i]),
    }
}

#[cfg(test)]
mod tests {
    use super::{SHADOW_MAP_SIDE, map_from_world};
    use crate::math::affine::normalised;

    #[test]
    fn shadow_map_is_centered_and_height_faces_light() {
        let towards = normalised([0.3, -0.5, 1.0]);
        let centre = [-0.1, 0.0, 0.35];
        let map = map_from_world(towards, centre);
        let middle = SHADOW_MAP_SIDE as f32 / 2.0;
        for (a, b) in map.transform_point(centre).into_iter().zip([middle, middle, 0.5]) {
            assert!((a - b).abs() < 1e-3, "{a}, expected {b}");
        }
        let nearer = core::array::from_fn(|i| centre[i] + towards[i]);
        let [x, y, height] = map.transform_point(nearer);
        assert!((x - middle).abs() < 1e-2 && (y - middle).abs() < 1e-2 && (height - 0.5625).abs() < 1e-5);
    }
}
