//! The needle and ring of DualArmThreading and the pen and cap of DualArmPenCap. The needle and the ring's
//! hole are oriented along x, pen and cap along z. See docs/benchmark.md, "Scenes and objects".

use core::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_8, PI, TAU};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, UnitVector3, Vector3};

use super::{BIMANUAL_TABLE_Z, box_part, movable, rgb, visual_of};
use crate::scene::{
    AppearanceSpec, BodySpec, Mass, PartSpec, Primitive, Role, ScaledBy, VisualShape, VisualSpec,
};

/// Neither of two mating bodies changes its size.
const NOT_SCALED: ScaledBy = ScaledBy::Nothing("the body that it fits keeps its size");

/// Length of the needle from its origin along x, in m.
pub(in crate::tasks) const NEEDLE_LENGTH: f64 = 0.125;
/// Length of the needle's shaft, in m.
const SHAFT_LENGTH: f64 = 0.075;

/// Height of the ring's centre above the tripod's origin, in m. Its hole is along x.
pub(in crate::tasks) const RING_Z: f64 = 0.215;
/// Distance from the ring's centre to the centre line of its tube, in m.
const RING_RADIUS: f64 = 0.05;
/// Radius of the ring's tube, in m.
const TUBE_RADIUS: f64 = 0.005;
/// Radius of the ring's pole, in m.
const POLE_RADIUS: f64 = 0.01;
/// z of both ends of the ring's pole, in m.
const POLE_Z: [f64; 2] = [0.01, 0.16];
const BROWN: AppearanceSpec = AppearanceSpec::plain(rgb([110, 38, 14]));

/// z of the pen's tip and of its other end, in m.
pub(in crate::tasks) const PEN_Z: [f64; 2] = [-0.168, 0.224];
/// Radius of the pen's barrel, in m.
const PEN_RADIUS: f64 = 0.0163;
/// Radius of the grip section behind the tip, in m.
const SECTION_RADIUS: f64 = 0.015;
/// z of both ends of the grip section, in m. The tip below it is a cone.
const SECTION_Z: [f64; 2] = [-0.15, -0.03];

/// x of the cap's axis, which is parallel to z, in m.
pub(in crate::tasks) const CAP_X: f64 = 0.02;
/// z of the cap's closed end, of the bottom of its cavity and of its opening, in m.
pub(in crate::tasks) const CAP_Z: [f64; 3] = [-0.061, -0.055, 0.123];
/// Outer radius of the cap and radius of its cavity, in m.
const CAP_RADII: [f64; 2] = [0.0255, 0.0205];
/// Distance of the clip's outer face from the cap's axis, in m.
const CLIP_RADIUS: f64 = 0.04;
/// z of both ends of the clip, in m.
const CLIP_Z: [f64; 2] = [-0.053, 0.045];
const BLUE: AppearanceSpec = AppearanceSpec::plain(rgb([24, 58, 140]));
const WHITE: AppearanceSpec = AppearanceSpec::plain(rgb([225, 225, 220]));
const STEEL: AppearanceSpec = AppearanceSpec { specular: 0.6, ..AppearanceSpec::plain(rgb([150, 152, 156])) };

/// Creates the needle: a shaft with a thinner end.
pub(in crate::tasks) fn needle(region: usize) -> BodySpec {
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

/// Creates the tripod: three legs, a plate, and a pole that carries the ring.
pub(in crate::tasks) fn tripod(region: usize) -> BodySpec {
    let leg =
        |turn| transformed(turn * Translation3::new(0.0625, 0.0, 0.0), &rod(0.005, [-0.075, 0.0], BROWN));
    let mut stand: Vec<PartSpec> = rotations(Vector3::z_axis(), 3).map(leg).collect();
    stand.push(box_part([0.0625, 0.0625, 0.005], [0.0, 0.0, 0.005], BROWN));
    let middle = Translation3::new(0.0, 0.0, RING_Z);
    let ring = VisualSpec {
        shape: VisualShape::Torus { major_radius: RING_RADIUS, minor_radius: TUBE_RADIUS },
        pose: middle * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2),
        appearance: BROWN,
    };
    let pole = rod(POLE_RADIUS, POLE_Z, BROWN);
    let visuals = stand.iter().chain([&pole]).map(visual_of).chain([ring]).collect();
    // The pole's collision shape is square, since a round one slips out of the fingers.
    let [foot, top] = POLE_Z;
    stand.push(box_part(
        [POLE_RADIUS, POLE_RADIUS, (top - foot) / 2.0],
        [0.0, 0.0, (foot + top) / 2.0],
        BROWN,
    ));
    let side = Primitive::Capsule { radius: TUBE_RADIUS, half_height: RING_RADIUS * libm::tan(PI / 12.0) };
    stand.extend(rotations(Vector3::x_axis(), 12).map(|turn| {
        transformed(
            middle * turn * Translation3::new(0.0, RING_RADIUS, 0.0),
            &PartSpec::at(side.clone(), [0.0; 3], BROWN),
        )
    }));
    BodySpec {
        role: Role::ReceiverObject,
        friction: 0.6,
        scaled_by: NOT_SCALED,
        visuals,
        ..movable("tripod", stand, region, BIMANUAL_TABLE_Z)
    }
}

/// Creates the pen. The collision shape of its barrel is two crossed flat bars, since a cylinder would roll
/// away.
pub(in crate::tasks) fn pen(region: usize) -> BodySpec {
    let ([tip, end], [front, back]) = (PEN_Z, SECTION_Z);
    let (r, narrow) = (PEN_RADIUS, SECTION_RADIUS);
    let bar = |x, y| box_part([x, y, (end - back) / 2.0], [0.0, 0.0, (end + back) / 2.0], BLUE);
    let section = rod(narrow, SECTION_Z, WHITE);
    let cone = rod(narrow / 2.0, [tip, front], STEEL);
    BodySpec {
        scaled_by: NOT_SCALED,
        visuals: vec![
            lathe(&[[0.0, back], [r, back], [r, end - 0.01], [0.7 * r, end], [0.0, end]], 0.0, BLUE),
            visual_of(&section),
            lathe(&[[0.0, tip], [0.002, tip], [narrow, front], [0.0, front]], 0.0, STEEL),
        ],
        ..lying("pen", vec![bar(r, 0.6 * r), bar(0.6 * r, r), section, cone], region)
    }
}

/// Creates the cap: eight walls around the cavity, its bottom, and a clip on one side.
pub(in crate::tasks) fn cap(region: usize) -> BodySpec {
    let ([closed, bottom, open], [r, inside]) = (CAP_Z, CAP_RADII);
    let axis = Translation3::new(CAP_X, 0.0, 0.0);
    let half = [(r - inside) / 2.0, r * libm::tan(FRAC_PI_8), (open - closed) / 2.0];
    let wall = box_part(half, [(r + inside) / 2.0, 0.0, (open + closed) / 2.0], BLUE);
    let clip = |[from, to]: [f64; 2], [low, high]: [f64; 2]| {
        let half = [(to - from) / 2.0, 0.005, (high - low) / 2.0];
        box_part(half, [CAP_X + (from + to) / 2.0, 0.0, (low + high) / 2.0], STEEL)
    };
    let mut parts: Vec<PartSpec> =
        rotations(Vector3::z_axis(), 8).map(|turn| transformed(axis * turn, &wall)).collect();
    parts.extend([transformed(axis.into(), &rod(r, [closed, bottom], BLUE)), clip([r, CLIP_RADIUS], CLIP_Z)]);
    let outside = [[0.0, closed], [0.8 * r, closed], [r, closed + 0.01], [r, open]];
    let cavity = [[inside, open], [inside, bottom], [0.0, bottom]];
    let [low, high] = CLIP_Z;
    BodySpec {
        role: Role::ReceiverObject,
        scaled_by: NOT_SCALED,
        visuals: vec![
            lathe(&[&outside[..], &cavity[..]].concat(), CAP_X, BLUE),
            visual_of(&clip([CLIP_RADIUS - 0.005, CLIP_RADIUS], CLIP_Z)),
            visual_of(&clip([inside, CLIP_RADIUS], [low, low + 0.015])),
            visual_of(&clip([r, CLIP_RADIUS], [high - 0.008, high])),
        ],
        ..lying("cap", parts, region)
    }
}

/// Creates a body that lies with its z axis along world y and its y axis up.
fn lying(name: &'static str, parts: Vec<PartSpec>, region: usize) -> BodySpec {
    let along_y = Quaternion::new(0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2);
    movable(name, parts, region, BIMANUAL_TABLE_Z).with_orientation(UnitQuaternion::from_quaternion(along_y))
}

/// Creates a cylinder about z between two heights, in m.
fn rod(radius: f64, [from, to]: [f64; 2], appearance: AppearanceSpec) -> PartSpec {
    let shape = Primitive::Cylinder { radius, half_height: (to - from) / 2.0 };
    PartSpec::at(shape, [0.0, 0.0, (from + to) / 2.0], appearance)
}

/// Creates a surface of revolution about the line parallel to z at `x`, in m.
fn lathe(profile: &[[f64; 2]], x: f64, appearance: AppearanceSpec) -> VisualSpec {
    VisualSpec::at(VisualShape::Lathe { profile: profile.to_vec() }, [x, 0.0, 0.0], appearance)
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
