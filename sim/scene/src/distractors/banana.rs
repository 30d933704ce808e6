//! A banana. Its centre line is a parabola; its underside is level, so that the thin ends rest on the table
//! too.

use nalgebra::{Isometry3, Vector3};

use super::Distractor;
use super::appearance::{PEEL_SPECULAR, pick, srgb, vary_brightness};
use super::builder::{DistractorBuilder, pose, z_axis_to};
use crate::stream::Stream;
use crate::{AppearanceSpec, Primitive};

/// Half of the centre line's length, in m.
const HALF_LENGTH: f64 = 0.078;
/// Sagitta of the centre line, in m.
const SAGITTA: f64 = 0.028;
/// Radius at the middle of the banana, in m.
const RADIUS: f64 = 0.0175;
/// Radius at the ends, in m.
const END_RADIUS: f64 = 0.009;
/// Overlap of a visual segment with its neighbours, whose axes differ slightly, in m.
const OVERLAP: f64 = 0.0008;
/// Number of collision segments.
const N_COLLIDERS: u32 = 6;
/// Number of visual segments.
const N_VISUALS: u32 = 14;

/// Samples a banana that lies along y, from unripe to overripe.
pub(crate) fn banana(stream: &mut Stream) -> Distractor {
    let skin = pick(stream, &[srgb([248, 212, 52]), srgb([222, 206, 74]), srgb([232, 184, 52])]);
    let skin =
        AppearanceSpec { specular: PEEL_SPECULAR, ..AppearanceSpec::plain(vary_brightness(stream, skin)) };
    let dark = AppearanceSpec::plain(srgb([84, 66, 32]));
    let mut builder = DistractorBuilder::new(600.0);
    for [from, to] in segments(N_COLLIDERS) {
        let radius = radius(f64::midpoint(from, to));
        let (half_height, pose) = between(centre_line(from, radius), centre_line(to, radius));
        builder.collider(Primitive::Capsule { radius, half_height }, pose);
    }
    for ends in segments(N_VISUALS) {
        let [low, high] = ends.map(radius);
        let (half, pose) = between(centre_line(ends[0], low), centre_line(ends[1], high));
        let (half_length, flare) = (half + OVERLAP, (high - low) / (2.0 * half) * OVERLAP);
        let frustum = [
            [0.0, -half_length],
            [low - flare, -half_length],
            [high + flare, half_length],
            [0.0, half_length],
        ];
        builder.lathe(&frustum, pose, skin);
    }
    // The stem and the remains of the blossom.
    for (end, length, [radius, tip_radius]) in
        [(1.0, 0.02, [0.0045, 0.0052]), (-1.0, 0.011, [0.0075, 0.0045])]
    {
        let (half, pose) =
            between(centre_line(end, END_RADIUS), centre_line(end * (1.0 + length / 0.095), END_RADIUS));
        let stub = [[0.0, -half], [END_RADIUS, -half], [radius, 0.3 * half], [tip_radius, half], [0.0, half]];
        builder.lathe(&stub, pose, skin);
        let scar =
            [[0.0, 0.85 * half], [tip_radius, 0.85 * half], [tip_radius, half + 0.001], [0.0, half + 0.001]];
        builder.lathe(&scar.map(|[r, z]| [r * 1.05, z]), pose, dark);
        if end > 0.0 {
            builder.collider(Primitive::Capsule { radius: 0.005, half_height: half - 0.004 }, pose);
        }
    }
    builder.build(stream)
}

/// Returns the curve parameters at both ends of each of `n` segments: −1 is one end of the banana and 1 the
/// other.
fn segments(n: u32) -> impl Iterator<Item = [f64; 2]> {
    (0..n).map(move |i| [i, i + 1].map(|i| 2.0 * f64::from(i) / f64::from(n) - 1.0))
}

fn radius(t: f64) -> f64 {
    RADIUS + (END_RADIUS - RADIUS) * t * t * t * t
}

/// Returns the point of the centre line at curve parameter `t`, at the given height above the table.
fn centre_line(t: f64, height: f64) -> Vector3<f64> {
    Vector3::new(SAGITTA * (0.5 - t * t), HALF_LENGTH * t, height)
}

/// Returns half of the distance between two points and the pose at their midpoint with z along their
/// connection.
fn between(from: Vector3<f64>, to: Vector3<f64>) -> (f64, Isometry3<f64>) {
    let offset = to - from;
    (offset.norm() / 2.0, pose(((from + to) / 2.0).into(), z_axis_to(offset.normalize().into())))
}
