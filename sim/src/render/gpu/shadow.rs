//! The light's view of a scene: where shadow maps lie.

use crate::render::affine::{Affine, Vec3, cross, dot, normalised, scaled};

/// Texels along each edge of a map.
pub(super) const MAP_SIDE: u32 = 512;
/// Length of that edge in the world, in m.
const MAP_M: f32 = 2.8;
/// Heights within this distance of the map's centre are told apart, in m.
const REACH_M: f32 = 8.0;

/// From the world to a map: texels to the right and down, and the height along the light, which is 0 at the map's lower
/// end and 1 at its upper one.
pub(super) fn map_from_world(towards: Vec3, centre: Vec3) -> Affine {
    let side = cross([0.0, 1.0, 0.0], towards);
    let right = if dot(side, side) > 1e-6 { normalised(side) } else { [1.0, 0.0, 0.0] };
    let down = cross(right, towards);
    let per_m = MAP_SIDE as f32 / MAP_M;
    let rows = [scaled(right, per_m), scaled(down, per_m), scaled(towards, 0.5 / REACH_M)];
    let middle = [MAP_SIDE as f32 / 2.0, MAP_SIDE as f32 / 2.0, 0.5];
    let offset = core::array::from_fn(|i| middle[i] - dot(rows[i], centre));
    Affine { linear: rows, offset }
}

#[cfg(test)]
mod tests {
    use super::{MAP_SIDE, map_from_world};
    use crate::render::affine::normalised;

    #[test]
    fn the_centre_is_in_the_middle_and_what_is_nearer_to_the_light_is_higher() {
        let towards = normalised([0.3, -0.5, 1.0]);
        let centre = [-0.1, 0.0, 0.35];
        let map = map_from_world(towards, centre);
        let middle = MAP_SIDE as f32 / 2.0;
        for (a, b) in map.point(centre).into_iter().zip([middle, middle, 0.5]) {
            assert!((a - b).abs() < 1e-3, "{a} for {b}");
        }
        let nearer = core::array::from_fn(|i| centre[i] + towards[i]);
        let [x, y, height] = map.point(nearer);
        assert!((x - middle).abs() < 1e-2 && (y - middle).abs() < 1e-2 && (height - 0.5625).abs() < 1e-5);
    }
}
