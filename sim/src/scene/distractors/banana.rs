//! A banana. Its middle line is a parabola and its underside is level, so that the thin ends lie on the table too.

use nalgebra::{Isometry3, Vector3};

use super::Distractor;
use super::appearance::{PEEL_SPECULAR, pick, rgb, vary_brightness};
use super::builder::{DistractorBuilder, pose, z_axis_to};
use crate::scene::{AppearanceSpec, Primitive};
use crate::stream::Stream;

/// How far the middle line reaches to both sides, and how deep it is bent, in m.
const HALF_LENGTH: f64 = 0.078;
const DEPTH: f64 = 0.028;
/// Radius in the middle and at the ends, in m.
const RADIUS: f64 = 0.0175;
const END_RADIUS: f64 = 0.009;
/// How far what is seen of a link reaches into its neighbours, whose axes point elsewhere, in m.
const OVERLAP: f64 = 0.0008;
/// Links that collide, and that are seen.
const N_SOLIDS: u32 = 6;
const N_SEEN: u32 = 14;

/// A banana that lies along y, as yellow as it is ripe.
pub(super) fn banana(stream: &mut Stream) -> Distractor {
    let skin = pick(stream, &[rgb([248, 212, 52]), rgb([222, 206, 74]), rgb([232, 184, 52])]);
    let skin =
        AppearanceSpec { specular: PEEL_SPECULAR, ..AppearanceSpec::plain(vary_brightness(stream, skin)) };
    let dark = AppearanceSpec::plain(rgb([84, 66, 32]));
    let mut builder = DistractorBuilder::new(600.0);
    for [from, to] in links(N_SOLIDS) {
        let radius = radius(f64::midpoint(from, to));
        let (half_height, pose) = between(place(from, radius), place(to, radius));
        builder.collider(Primitive::Capsule { radius, half_height }, pose);
    }
    for stations in links(N_SEEN) {
        let [low, high] = stations.map(radius);
        let (half, pose) = between(place(stations[0], low), place(stations[1], high));
        let (reach, more) = (half + OVERLAP, (high - low) / (2.0 * half) * OVERLAP);
        let frustum = [[0.0, -reach], [low - more, -reach], [high + more, reach], [0.0, reach]];
        builder.lathe(&frustum, pose, skin);
    }
    // The stalk, and what is left of the blossom.
    for (end, length, [radius, tip_radius]) in
        [(1.0, 0.02, [0.0045, 0.0052]), (-1.0, 0.011, [0.0075, 0.0045])]
    {
        let (half, pose) = between(place(end, END_RADIUS), place(end * (1.0 + length / 0.095), END_RADIUS));
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

/// Stations of the links' ends, −1 at one end and 1 at the other.
fn links(n: u32) -> impl Iterator<Item = [f64; 2]> {
    (0..n).map(move |i| [i, i + 1].map(|i| 2.0 * f64::from(i) / f64::from(n) - 1.0))
}

fn radius(station: f64) -> f64 {
    RADIUS + (END_RADIUS - RADIUS) * station * station * station * station
}

/// The middle line at a station, so far above the table.
fn place(station: f64, height: f64) -> Vector3<f64> {
    Vector3::new(DEPTH * (0.5 - station * station), HALF_LENGTH * station, height)
}

/// Half the way between two points, and the pose halfway with z along it.
fn between(from: Vector3<f64>, to: Vector3<f64>) -> (f64, Isometry3<f64>) {
    let way = to - from;
    (way.norm() / 2.0, pose(((from + to) / 2.0).into(), z_axis_to(way.normalize().into())))
}
