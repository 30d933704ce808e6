//! Clipping of the few triangles that cross the near plane or extend far beyond the image.

use crate::cpu::simd::Simd;
use crate::cpu::simd::each::each;
use crate::cpu::visibility::projection::PinholeProjection;
use crate::cpu::visibility::raster::Visibility;
use crate::cpu::visibility::tile::TileLayout;
use crate::math::affine::{Vec3, add, scaled, sub};

/// Maximum number of corners of a triangle clipped by five planes.
const MAX_CORNERS: usize = 8;

/// A convex polygon of up to eight corners.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [Vec3; MAX_CORNERS],
    n: usize,
}

/// Rasterises the part of a triangle, given in the view frame, that lies in front of the near plane and
/// inside the guard band.
#[inline(always)]
pub(crate) fn draw<S: Simd, B: TileLayout>(
    triangle: [Vec3; 3],
    projection: &PinholeProjection,
    id: i32,
    visibility: &mut Visibility,
) {
    if is_outside(&triangle, projection.slopes) {
        return;
    }
    let polygon = clip_to_guard_band(triangle, projection);
    for i in 2..polygon.n {
        let fan = [polygon.corners[0], polygon.corners[i], polygon.corners[i - 1]];
        visibility.rasterize_large::<S, B>(&each!(k in 3 => projection.corner(fan[k])), id);
    }
}

/// Returns `true` if all of a triangle lies beyond one edge of an image with these slopes. This rejects most
/// triangles that would need clipping.
fn is_outside(triangle: &[Vec3; 3], slopes: [f32; 2]) -> bool {
    [0, 1].into_iter().any(|axis| {
        let slope = slopes[axis];
        triangle.iter().all(|p| p[axis] > slope * p[2]) || triangle.iter().all(|p| -p[axis] > slope * p[2])
    })
}

#[inline(never)]
fn clip_to_guard_band(triangle: [Vec3; 3], projection: &PinholeProjection) -> Polygon {
    let mut polygon = Polygon { corners: [[0.0; 3]; MAX_CORNERS], n: 3 };
    polygon.corners[..3].copy_from_slice(&triangle);
    let [right, down] = projection.guard_slopes;
    polygon
        .clip_plane(|p| p[2] - projection.near_m)
        .clip_plane(|p| right * p[2] - p[0])
        .clip_plane(|p| right * p[2] + p[0])
        .clip_plane(|p| down * p[2] - p[1])
        .clip_plane(|p| down * p[2] + p[1])
}

impl Polygon {
    /// Returns the part on which `height` is not negative. An edge is always intersected from its inner to
    /// its outer corner, so that two triangles that share the edge are cut at the same point.
    fn clip_plane(&self, height: impl Fn(Vec3) -> f32) -> Self {
        if self.corners[..self.n].iter().all(|p| height(*p) >= 0.0) {
            return *self;
        }
        let mut clipped = Self { corners: [[0.0; 3]; MAX_CORNERS], n: 0 };
        for i in 0..self.n {
            let (p, q) = (self.corners[i], self.corners[(i + 1) % self.n]);
            let (p_height, q_height) = (height(p), height(q));
            if p_height >= 0.0 {
                clipped.push(p);
            }
            if (p_height >= 0.0) != (q_height >= 0.0) {
                let (inside, outside, above, below) =
                    if p_height >= 0.0 { (p, q, p_height, q_height) } else { (q, p, q_height, p_height) };
                clipped.push(add(inside, scaled(sub(outside, inside), above / (above - below))));
            }
        }
        clipped
    }

    fn push(&mut self, corner: Vec3) {
        self.corners[self.n] = corner;
        self.n += 1;
    }
}
