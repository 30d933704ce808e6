//! Shapes along curves: the seam of a ball and a tapered bow such as a banana.

use nalgebra::{Isometry3, Vector3};
use serde::Deserialize;

use super::builder::{DistractorBuilder, pose, z_axis_to};
use super::outline::{COS_SIN_STEP, FULL_CIRCLE, arc};
use crate::{AppearanceSpec, Primitive, VisualShape};

/// Strips along the seam of a ball sewn from two halves.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Seam {
    /// Distance of the strips from the ball's centre, in m.
    radius: f64,
    /// Half-extents of a strip along the seam, across it and outwards, in m.
    strip: [f64; 3],
}

impl Seam {
    pub(crate) fn add_to(
        &self,
        builder: &mut DistractorBuilder,
        at: Isometry3<f64>,
        appearance: AppearanceSpec,
    ) {
        // Seam curve on the sphere of radius a + b:
        // x = a cos t + b cos 3t, y = a sin t − b sin 3t, z = 2 √(a b) sin 2t.
        const A: f64 = 0.72;
        const B: f64 = 0.28;
        let seam_point = |[cos, sin]: [f64; 2]| {
            let (cos3, sin3) = (cos * (4.0 * cos * cos - 3.0), sin * (3.0 - 4.0 * sin * sin));
            [A * cos + B * cos3, A * sin - B * sin3, 2.0 * (A * B).sqrt() * 2.0 * sin * cos]
        };
        let [step_cos, step_sin] = COS_SIN_STEP;
        for [cos, sin] in arc(1.0, FULL_CIRCLE) {
            let next = seam_point([step_cos * cos - step_sin * sin, step_cos * sin + step_sin * cos]);
            let up = Vector3::from(seam_point([cos, sin]));
            let outwards = pose((up * self.radius).into(), z_axis_to(up.into()));
            let onwards = outwards.inverse_transform_vector(&(Vector3::from(next) - up));
            // The strip is symmetric, so its direction may be flipped towards +x, where the half-angle
            // quaternion below is well defined.
            let [x, y] = [onwards.x.abs(), onwards.y * onwards.x.signum()];
            let turn = [x + (x * x + y * y).sqrt(), 0.0, 0.0, y];
            let strip = VisualShape::Primitive(Primitive::Box { half: self.strip });
            builder.visual(strip, at * outwards * pose([0.0; 3], turn), appearance);
        }
    }
}

/// A solid that tapers towards both ends, along a parabola in the xy plane whose ends lie at ±y. Its
/// underside is level, so that the thin ends rest on the table too.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Bow {
    /// Half of the centre line's length along y, in m.
    half_length: f64,
    /// Sagitta of the centre line, in m.
    sagitta: f64,
    /// Radii at the middle and at the ends, in m.
    radii: [f64; 2],
    /// Overlap of a visual segment with its neighbours, whose axes differ slightly, in m.
    overlap: f64,
    /// Numbers of collision segments and of visual segments.
    segments: [u32; 2],
}

impl Bow {
    pub(crate) fn add_to(
        &self,
        builder: &mut DistractorBuilder,
        at: Isometry3<f64>,
        appearance: AppearanceSpec,
    ) {
        let [n_colliders, n_visuals] = self.segments;
        for [from, to] in segments(n_colliders) {
            let radius = self.radius(f64::midpoint(from, to));
            let (half_height, pose) = between(self.point(from, radius), self.point(to, radius));
            builder.collider(Primitive::Capsule { radius, half_height }, at * pose);
        }
        for ends in segments(n_visuals) {
            let [low, high] = ends.map(|t| self.radius(t));
            let (half, pose) = between(self.point(ends[0], low), self.point(ends[1], high));
            let (z, flare) = (half + self.overlap, (high - low) / (2.0 * half) * self.overlap);
            let profile = vec![[0.0, -z], [low - flare, -z], [high + flare, z], [0.0, z]];
            builder.visual(VisualShape::Lathe { profile }, at * pose, appearance);
        }
    }

    fn radius(&self, t: f64) -> f64 {
        let [middle, end] = self.radii;
        middle + (end - middle) * t * t * t * t
    }

    /// Returns the point of the centre line at `t` (−1 at one end and 1 at the other) and the given height.
    fn point(&self, t: f64, height: f64) -> Vector3<f64> {
        Vector3::new(self.sagitta * (0.5 - t * t), self.half_length * t, height)
    }
}

/// Returns the curve parameters at both ends of each of `n` segments.
fn segments(n: u32) -> impl Iterator<Item = [f64; 2]> {
    (0..n).map(move |i| [i, i + 1].map(|i| 2.0 * f64::from(i) / f64::from(n) - 1.0))
}

/// Returns half of the distance between two points and the pose at their midpoint with z along their
/// connection.
fn between(from: Vector3<f64>, to: Vector3<f64>) -> (f64, Isometry3<f64>) {
    let offset = to - from;
    (offset.norm() / 2.0, pose(((from + to) / 2.0).into(), z_axis_to(offset.normalize().into())))
}
