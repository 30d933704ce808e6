//! The needle and the ring on a tripod of DualArmThreading. The needle and the ring's hole are oriented along
//! x. See docs/benchmark.md, "Objects".

use core::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, UnitVector3, Vector3};

use crate::tasks::common::{BIMANUAL_TABLE_Z, box_part, movable, rgb};
use scene::{AppearanceSpec, BodySpec, Mass, PartSpec, Primitive, Role, ScaledBy};

/// Neither of the two bodies changes its size.
const NOT_SCALED: ScaledBy = ScaledBy::Nothing("the body that it fits keeps its size");

/// Length of the needle from its origin along x, in m.
pub(crate) const NEEDLE_LENGTH: f64 = 0.125;
/// Length of the needle's shaft, in m.
const SHAFT_LENGTH: f64 = 0.075;

/// Height of the ring's centre above the tripod's origin, in m. Its hole is along x.
pub(crate) const RING_Z: f64 = 0.215;
/// Distance from the ring's centre to the centres of its bars, in m.
const RING_RADIUS: f64 = 0.05;
/// Radius and half-length of the bars, in m.
const BAR: [f64; 2] = [0.005, 0.00785];
/// Number of bars of the ring, all parallel to the hole, with gaps between them.
const N_BARS: u32 = 20;
/// Distance of the centres of legs and feet from the tripod's axis, in m.
const LEG_DISTANCE: f64 = 0.0625;
/// Angle between a leg and the vertical in rad: its lower end is farther from the tripod's axis.
const LEG_SPLAY: f64 = 0.876;
const BROWN: AppearanceSpec = AppearanceSpec::plain(rgb([110, 38, 14]));

/// Creates the needle: a shaft with a thinner end.
pub(crate) fn needle(region: usize) -> BodySpec {
    let metal = AppearanceSpec { specular: 0.6, ..AppearanceSpec::plain([0.3; 3]) };
    let bar = |half: f64, from: f64, to: f64| {
        box_part([(to - from) / 2.0, half, half], [(from + to) / 2.0, 0.0, 0.0], metal)
    };
    let parts = vec![bar(0.02, 0.0, SHAFT_LENGTH), bar(0.012, SHAFT_LENGTH, NEEDLE_LENGTH)];
    BodySpec {
        mass: Mass::Density(8000.0),
        scaled_by: NOT_SCALED,
        ..movable("needle", parts, region, BIMANUAL_TABLE_Z)
    }
}

/// Creates the tripod: three splayed legs with feet, a plate, and a pole that carries the ring.
pub(crate) fn tripod(region: usize) -> BodySpec {
    let about_y = |angle| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
    let rod = |radius, half_height, at: [f64; 3], turn: f64| PartSpec {
        shape: Primitive::Cylinder { radius, half_height },
        pose: Isometry3::from_parts(Translation3::from(at), about_y(turn)),
        appearance: BROWN,
    };
    let leg = rod(0.005, 0.0375, [LEG_DISTANCE, 0.0, -0.0275], -LEG_SPLAY);
    let foot = PartSpec::at(Primitive::Ball { radius: 0.0075 }, [LEG_DISTANCE, 0.0, -0.0526], BROWN);
    let plate = box_part([0.0625, 0.0625, 0.005], [0.0, 0.0, 0.005], BROWN);
    let pole = rod(0.01, 0.075, [0.0, 0.0, 0.085], 0.0);
    let bar = rod(BAR[0], BAR[1], [0.0, RING_RADIUS, 0.0], FRAC_PI_2);

    let mut parts = vec![plate, pole];
    for turn in rotations(Vector3::z_axis(), 3) {
        parts.extend([&leg, &foot].map(|part| transformed(turn, part)));
    }
    let centre = Translation3::new(0.0, 0.0, RING_Z);
    parts.extend(rotations(Vector3::x_axis(), N_BARS).map(|turn| transformed(centre * turn, &bar)));
    BodySpec {
        role: Role::ReceiverObject,
        friction: 0.6,
        scaled_by: NOT_SCALED,
        ..movable("tripod", parts, region, BIMANUAL_TABLE_Z)
    }
}

/// Returns the part with its pose transformed by `frame`.
fn transformed(frame: Isometry3<f64>, part: &PartSpec) -> PartSpec {
    PartSpec { pose: frame * part.pose, ..part.clone() }
}

/// Returns `n` evenly spaced rotations about an axis, starting with the identity.
fn rotations(axis: UnitVector3<f64>, n: u32) -> impl Iterator<Item = Isometry3<f64>> {
    let turn = move |k| UnitQuaternion::from_axis_angle(&axis, f64::from(k) * TAU / f64::from(n));
    (0..n).map(move |k| Isometry3::from_parts(Translation3::identity(), turn(k)))
}
