//! Signed distance fields: solids that melt into one another, as cast housings do. Negative inside, lengths in m.
//!
//! Formulas follow Inigo Quilez, "Distance functions" and "Smooth minimum". Distances are exact near flat and round
//! faces and only of the right sign and slope elsewhere, which is all that meshing needs.

pub(super) mod panda;
mod surface_nets;

use crate::render::math::affine::{Vec3, add, dot, scaled, sub};

/// A simple solid.
#[derive(Clone, Copy)]
pub(super) enum Solid {
    /// Cylinder or cone frustum with flat ends at `a` and `b`, its radius going from `radii[0]` to `radii[1]`, edges
    /// rounded by `round`.
    Rod { a: Vec3, b: Vec3, radii: [f32; 2], round: f32 },
    /// Segment from `a` to `b` with a ball at every point, its radius going from `radii[0]` to `radii[1]`.
    Sausage { a: Vec3, b: Vec3, radii: [f32; 2] },
    /// Box with edges rounded by `round`.
    Block { centre: Vec3, half: Vec3, round: f32 },
}

impl Solid {
    fn distance(&self, p: Vec3) -> f32 {
        match *self {
            Self::Rod { a, b, radii, round } => {
                let (axis, from) = (sub(b, a), sub(p, a));
                let length = dot(axis, axis).sqrt();
                let along = dot(from, axis) / length;
                let across = sub(from, scaled(axis, along / length));
                let t = (along / length).clamp(0.0, 1.0);
                let side = dot(across, across).sqrt() - (radii[0] + (radii[1] - radii[0]) * t);
                rounded(&[side, (along - length / 2.0).abs() - length / 2.0], round)
            }
            Self::Sausage { a, b, radii } => {
                let (axis, from) = (sub(b, a), sub(p, a));
                let t = (dot(from, axis) / dot(axis, axis)).clamp(0.0, 1.0);
                let off = sub(from, scaled(axis, t));
                dot(off, off).sqrt() - (radii[0] + (radii[1] - radii[0]) * t)
            }
            Self::Block { centre, half, round } => {
                let off = sub(p, centre);
                let sides: Vec3 = core::array::from_fn(|i| off[i].abs() - half[i]);
                rounded(&sides, round)
            }
        }
    }
}

/// Distance to the meeting of half spaces at right angles, the edge between them rounded.
fn rounded(sides: &[f32], round: f32) -> f32 {
    let inside = sides.iter().fold(f32::MIN, |m, s| m.max(s + round)).min(0.0);
    let outside = sides.iter().map(|s| (s + round).max(0.0)).map(|s| s * s).sum::<f32>().sqrt();
    inside + outside - round
}

/// What to do with the next solid.
#[derive(Clone, Copy)]
pub(super) enum Step {
    /// Add it, with a fillet of about this radius.
    Add(Solid, f32),
    /// Take it away, with an edge rounded by about this radius.
    Cut(Solid, f32),
}

/// Solids added and cut in order; the first is added to nothing.
pub(super) struct Field<'a>(pub(super) &'a [Step]);

impl Field<'_> {
    /// Signed distance at `p`, roughly.
    pub(super) fn distance(&self, p: Vec3) -> f32 {
        self.0.iter().fold(f32::MAX, |d, step| match step {
            Step::Add(solid, fillet) => smooth_min(d, solid.distance(p), *fillet),
            Step::Cut(solid, fillet) => -smooth_min(-d, solid.distance(p), *fillet),
        })
    }

    /// Gradient of the distance by central differences.
    pub(super) fn gradient(&self, p: Vec3) -> Vec3 {
        const STEP: f32 = 5e-4;
        core::array::from_fn(|axis| {
            let mut off = [0.0; 3];
            off[axis] = STEP;
            (self.distance(add(p, off)) - self.distance(sub(p, off))) / (2.0 * STEP)
        })
    }
}

fn smooth_min(a: f32, b: f32, radius: f32) -> f32 {
    if radius == 0.0 || (a - b).abs() >= radius {
        return a.min(b);
    }
    let h = radius - (a - b).abs();
    a.min(b) - h * h / (4.0 * radius)
}
