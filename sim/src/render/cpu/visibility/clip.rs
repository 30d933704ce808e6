//! The few triangles that reach behind the near plane or far beyond the image: cut to what can be projected.

use crate::render::cpu::simd::Simd;
use crate::render::cpu::simd::each::each;
use crate::render::cpu::visibility::projection::PinholeProjection;
use crate::render::cpu::visibility::raster::Visibility;
use crate::render::cpu::visibility::tile::TileLayout;
use crate::render::math::affine::{Vec3, add, scaled, sub};

/// A triangle cut by five planes has at most eight corners.
const MAX_CORNERS: usize = 8;

/// A convex polygon.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [Vec3; MAX_CORNERS],
    n: usize,
}

/// Draws the part of a triangle, given in the view frame, that lies in front of the near plane and within the guard.
#[inline(always)]
pub(in crate::render::cpu) fn draw<S: Simd, B: TileLayout>(
    triangle: [Vec3; 3],
    projection: &PinholeProjection<'_>,
    id: i32,
    visibility: &mut Visibility,
) {
    if is_outside(&triangle, projection.slope) {
        return;
    }
    let polygon = cut_to_fit(triangle, projection);
    for i in 2..polygon.n {
        let fan = [polygon.corners[0], polygon.corners[i], polygon.corners[i - 1]];
        visibility.rasterize_large::<S, B>(&each!(k in 3 => projection.corner(fan[k])), id);
    }
}

/// Whether all of a triangle lies beyond one edge of an image of this slope: most of those that do not fit do.
fn is_outside(triangle: &[Vec3; 3], slope: f32) -> bool {
    [0, 1].iter().any(|&axis| {
        triangle.iter().all(|p| p[axis] > slope * p[2]) || triangle.iter().all(|p| -p[axis] > slope * p[2])
    })
}

#[inline(never)]
fn cut_to_fit(triangle: [Vec3; 3], projection: &PinholeProjection<'_>) -> Polygon {
    let mut polygon = Polygon { corners: [[0.0; 3]; MAX_CORNERS], n: 3 };
    polygon.corners[..3].copy_from_slice(&triangle);
    let guard = projection.guard_slope;
    polygon
        .cut(|p| p[2] - projection.near_m)
        .cut(|p| guard * p[2] - p[0])
        .cut(|p| guard * p[2] + p[0])
        .cut(|p| guard * p[2] - p[1])
        .cut(|p| guard * p[2] + p[1])
}

impl Polygon {
    /// The part on which `height` is not negative. Each cut runs from the corner inside to the one outside, so that two
    /// triangles that share the edge cut it at the same point.
    fn cut(&self, height: impl Fn(Vec3) -> f32) -> Self {
        if self.corners[..self.n].iter().all(|p| height(*p) >= 0.0) {
            return *self;
        }
        let mut kept = Self { corners: [[0.0; 3]; MAX_CORNERS], n: 0 };
        for i in 0..self.n {
            let (p, q) = (self.corners[i], self.corners[(i + 1) % self.n]);
            let (p_height, q_height) = (height(p), height(q));
            if p_height >= 0.0 {
                kept.push(p);
            }
            if (p_height >= 0.0) != (q_height >= 0.0) {
                let (inside, outside, above, below) =
                    if p_height >= 0.0 { (p, q, p_height, q_height) } else { (q, p, q_height, p_height) };
                kept.push(add(inside, scaled(sub(outside, inside), above / (above - below))));
            }
        }
        kept
    }

    fn push(&mut self, corner: Vec3) {
        self.corners[self.n] = corner;
        self.n += 1;
    }
}
