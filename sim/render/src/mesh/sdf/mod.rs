//! Signed distance fields with smooth blends, for shapes like cast housings. Distances are negative inside
//! and in m.
//!
//! Formulas follow Inigo Quilez, "Distance functions" and "Smooth minimum". Distances are exact near flat and
//! round faces; elsewhere only their sign and slope are right, which suffices for meshing.

pub(crate) mod panda;
mod panda_trim;
mod surface_nets;

use crate::math::affine::{Vec3, add, dot, scaled, sub};

/// A primitive solid.
#[derive(Clone, Copy)]
pub(crate) enum SdfPrimitive {
    /// Cylinder or cone frustum with flat ends at `a` and `b`, radii `radii[0]` and `radii[1]` there, and
    /// edges rounded by `round`.
    Frustum { a: Vec3, b: Vec3, radii: [f32; 2], round: f32 },
    /// Union of spheres along the segment from `a` to `b`, whose radius goes from `radii[0]` to `radii[1]`.
    RoundCone { a: Vec3, b: Vec3, radii: [f32; 2] },
    /// Box with edges rounded by `round`.
    RoundedBox { centre: Vec3, half: Vec3, round: f32 },
    /// The same, but with the half-extent along x going from `half[0]` at the lower z to `upper_half_x` at
    /// the upper z.
    TaperedBox { centre: Vec3, half: Vec3, upper_half_x: f32, round: f32 },
}

impl SdfPrimitive {
    fn distance(&self, p: Vec3) -> f32 {
        match *self {
            Self::Frustum { a, b, radii, round } => {
                let (axis, from) = (sub(b, a), sub(p, a));
                let length = dot(axis, axis).sqrt();
                let along = dot(from, axis) / length;
                let across = sub(from, scaled(axis, along / length));
                let t = (along / length).clamp(0.0, 1.0);
                let side = dot(across, across).sqrt() - (radii[0] + (radii[1] - radii[0]) * t);
                rounded_intersection(&[side, (along - length / 2.0).abs() - length / 2.0], round)
            }
            Self::RoundCone { a, b, radii } => {
                let (axis, from) = (sub(b, a), sub(p, a));
                let t = (dot(from, axis) / dot(axis, axis)).clamp(0.0, 1.0);
                let off = sub(from, scaled(axis, t));
                dot(off, off).sqrt() - (radii[0] + (radii[1] - radii[0]) * t)
            }
            Self::RoundedBox { centre, half, round } => {
                let off = sub(p, centre);
                let sides: Vec3 = core::array::from_fn(|i| off[i].abs() - half[i]);
                rounded_intersection(&sides, round)
            }
            Self::TaperedBox { centre, half, upper_half_x, round } => {
                let off = sub(p, centre);
                let t = ((off[2] / half[2] + 1.0) / 2.0).clamp(0.0, 1.0);
                let half = [half[0] + (upper_half_x - half[0]) * t, half[1], half[2]];
                let sides: Vec3 = core::array::from_fn(|i| off[i].abs() - half[i]);
                rounded_intersection(&sides, round)
            }
        }
    }
}

/// Returns the distance to the intersection of perpendicular half spaces whose common edge is rounded.
fn rounded_intersection(sides: &[f32], round: f32) -> f32 {
    let inside = sides.iter().fold(f32::MIN, |m, s| m.max(s + round)).min(0.0);
    let outside = sides.iter().map(|s| (s + round).max(0.0)).map(|s| s * s).sum::<f32>().sqrt();
    inside + outside - round
}

/// A smooth CSG operation.
#[derive(Clone, Copy)]
pub(crate) enum CsgOp {
    /// Union with a fillet of about this radius, in m.
    Union(SdfPrimitive, f32),
    /// Subtraction with an edge rounded by about this radius, in m.
    Subtract(SdfPrimitive, f32),
    /// Intersection with an edge rounded by about this radius, in m.
    Intersect(SdfPrimitive, f32),
}

/// Solids combined by CSG operations in order, starting from empty space.
pub(crate) struct SignedDistanceField<'a>(pub(crate) &'a [CsgOp]);

impl SignedDistanceField<'_> {
    /// Returns the approximate signed distance at `p`.
    pub(crate) fn distance(&self, p: Vec3) -> f32 {
        self.0.iter().fold(f32::MAX, |d, op| match op {
            CsgOp::Union(solid, fillet) => smooth_min(d, solid.distance(p), *fillet),
            CsgOp::Subtract(solid, fillet) => -smooth_min(-d, solid.distance(p), *fillet),
            CsgOp::Intersect(solid, fillet) => -smooth_min(-d, -solid.distance(p), *fillet),
        })
    }

    /// Returns the gradient of the distance, by central differences.
    pub(crate) fn gradient(&self, p: Vec3) -> Vec3 {
        const STEP: f32 = 5e-4;
        core::array::from_fn(|axis| {
            let mut off = [0.0; 3];
            off[axis] = STEP;
            (self.distance(add(p, off)) - self.distance(sub(p, off))) / (2.0 * STEP)
        })
    }
}

/// Quadratic smooth minimum, which differs from the minimum where |a − b| < `radius`.
fn smooth_min(a: f32, b: f32, radius: f32) -> f32 {
    if radius == 0.0 || (a - b).abs() >= radius {
        return a.min(b);
    }
    let h = radius - (a - b).abs();
    a.min(b) - h * h / (4.0 * radius)
}
