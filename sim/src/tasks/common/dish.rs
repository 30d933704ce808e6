//! The plate and the drying rack of PickDishFromRack and PlaceDishInRack. See docs/benchmark.md, "Scenes and
//! objects".

use core::f64::consts::{FRAC_PI_2, FRAC_PI_6, PI, TAU};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::{SINGLE_TABLE_Z, box_part, fixed, movable};
use crate::expert::grasp;
use crate::scene::{
    AppearanceSpec, Body, BodySpec, Mass, PartSpec, Primitive, ScaledBy, VisualShape, VisualSpec,
};

/// Initial joint positions in rad: TCP at world (−0.088, 0.038, 0.318) m, pointing down.
pub(in crate::tasks) const QPOS: [f64; 7] = [0.0380, -0.0558, 0.0235, -2.1654, 0.0421, 2.1272, -0.7544];

/// Radius of the plate's rim, in m.
const RIM_RADIUS: f64 = 0.09;
/// Half of the plate's depth, in m.
const HALF_DEPTH: f64 = 0.02245;
/// Thickness of the plate's wall and floor, in m.
const THICKNESS: f64 = 0.006;
/// Outward lean of the plate's wall from its axis, in rad.
const FLARE: f64 = FRAC_PI_6;
/// Sine of `FLARE`.
const SIN_FLARE: f64 = 0.5;
/// Cosine of `FLARE`.
const COS_FLARE: f64 = 0.866_025_403_784_438_6;
/// Length of the plate's wall from the foot to the rim, in m.
const WALL_LENGTH: f64 = (2.0 * HALF_DEPTH - THICKNESS * SIN_FLARE) / COS_FLARE;
/// Radius of the plate's foot, in m.
const FOOT_RADIUS: f64 = RIM_RADIUS - WALL_LENGTH * SIN_FLARE;
/// Number of flat segments that the plate's wall consists of for collision. A plate on edge rests on one of
/// them and does not roll.
const N_SEGMENTS: u32 = 12;

/// Creates the plate, open at the top, about its z axis and centred at half of its depth. By default it lies
/// on the table in the first region. Its friction coefficient is 1 instead of the benchmark's 20, so that it
/// slides into a slot without jamming.
pub(in crate::tasks) fn plate() -> BodySpec {
    let white = AppearanceSpec { specular: 0.4, ..AppearanceSpec::plain([0.93; 3]) };
    let half = [
        THICKNESS / 2.0,
        (RIM_RADIUS + FOOT_RADIUS) / 2.0 * libm::tan(PI / f64::from(N_SEGMENTS)),
        WALL_LENGTH / 2.0,
    ];
    let segment =
        |i: u32| PartSpec { shape: Primitive::Box { half }, pose: wall_pose(azimuth(i)), appearance: white };
    let floor = Primitive::Cylinder { radius: FOOT_RADIUS, half_height: THICKNESS / 2.0 };
    let floor = PartSpec::at(floor, [0.0, 0.0, THICKNESS / 2.0 - HALF_DEPTH], white);
    BodySpec {
        visuals: vec![VisualSpec::at(VisualShape::Lathe { profile: profile() }, [0.0; 3], white)],
        scaled_by: ScaledBy::Nothing("the slots of the rack are made for it"),
        mass: Mass::Density(300.0),
        friction: 1.0,
        ..movable("plate", (0..N_SEGMENTS).map(segment).chain([floor]).collect(), 0, SINGLE_TABLE_Z)
    }
}

/// Returns the lathe profile of the plate's wall and floor, with rounded edges.
fn profile() -> Vec<[f64; 2]> {
    // Point at distance `along` from the foot's outer edge along the wall and `inwards` through it.
    let wall = |along: f64, inwards: f64| {
        let (out, up) = (SIN_FLARE * along - COS_FLARE * inwards, COS_FLARE * along + SIN_FLARE * inwards);
        [FOOT_RADIUS + out, up - HALF_DEPTH]
    };
    let round = THICKNESS / 3.0;
    vec![
        [0.0, -HALF_DEPTH],
        [FOOT_RADIUS - round, -HALF_DEPTH],
        wall(round, 0.0),
        wall(WALL_LENGTH - round, 0.0),
        wall(WALL_LENGTH, round),
        wall(WALL_LENGTH, THICKNESS - round),
        wall(WALL_LENGTH - round, THICKNESS),
        wall(THICKNESS + round, THICKNESS),
        [FOOT_RADIUS - THICKNESS - round, THICKNESS - HALF_DEPTH],
        [0.0, THICKNESS - HALF_DEPTH],
    ]
}

/// Returns the azimuth of a wall segment's centre about the plate's axis, in rad.
fn azimuth(segment: u32) -> f64 {
    TAU * f64::from(segment) / f64::from(N_SEGMENTS)
}

/// Returns the pose of the plate's wall at an azimuth, in the plate's frame: x points outwards through the
/// wall and z along it to the rim.
fn wall_pose(azimuth_rad: f64) -> Isometry3<f64> {
    let middle = Vector3::new(
        FOOT_RADIUS + (WALL_LENGTH * SIN_FLARE - THICKNESS * COS_FLARE) / 2.0,
        0.0,
        (WALL_LENGTH * COS_FLARE + THICKNESS * SIN_FLARE) / 2.0 - HALF_DEPTH,
    );
    let around = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), azimuth_rad);
    let leaning = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FLARE);
    Isometry3::from_parts((around * middle).into(), around * leaning)
}

/// World z of the rack's origin, in m.
const RACK_Z: f64 = 0.085;
/// Height of the rack's underside in its frame, in m.
const UNDERSIDE_Z: f64 = -0.06375;
/// Height of the rack's floor in its frame, in m.
const FLOOR_Z: f64 = -0.0527;
/// Height of the top of the inner dividers in the rack's frame, in m.
const DIVIDER_TOP_Z: f64 = 0.05915;
/// Half-extents of the rack's floor, in m.
const FLOOR_HALF: [f64; 3] = [0.09045, 0.12585, 0.005];
/// Centre of the rack's floor in the rack's frame, in m.
const FLOOR_CENTRE: [f64; 3] = [0.0043, 0.0078, FLOOR_Z - 0.005];
/// Half-width and half-thickness of a divider, in m.
const DIVIDER_HALF: [f64; 2] = [0.0603, 0.003];

/// Creates the rack: four dividers at the given y on a floor. Its visuals show the object that the boxes
/// approximate, a rack of bent wire on four feet.
pub(in crate::tasks) fn rack(region: usize, dividers_y: [f64; 4]) -> BodySpec {
    let steel = AppearanceSpec { specular: 0.6, ..AppearanceSpec::plain([0.62, 0.64, 0.67]) };
    let [half_x, half_y] = DIVIDER_HALF;
    // Half-height and centre z of the outer and of the inner dividers.
    let upright = |i: usize| if i == 0 || i == 3 { [0.06265, -0.0011] } else { [0.06145, -0.0023] };
    let dividers = dividers_y.into_iter().enumerate().map(|(i, y)| (y, upright(i)));
    let parts = dividers
        .clone()
        .map(|(y, [half_z, z])| box_part([half_x, half_y, half_z], [0.0, y, z], steel))
        .chain([box_part(FLOOR_HALF, FLOOR_CENTRE, steel)]);
    let visuals = dividers
        .flat_map(|(y, [half_z, z])| divider_visuals(y, z + half_z, steel))
        .chain(floor_visuals(steel));
    BodySpec {
        visuals: visuals.collect(),
        ..fixed("rack", parts.collect(), region, RACK_Z + UNDERSIDE_Z, "the released code keeps its size")
    }
}

/// Creates the visuals of a divider: a wire hoop with bars.
fn divider_visuals(y: f64, top_z: f64, appearance: AppearanceSpec) -> impl Iterator<Item = VisualSpec> {
    const BARS: i32 = 5;
    let [half_x, radius] = DIVIDER_HALF;
    let max_x = half_x - radius;
    let [low_z, high_z] = [FLOOR_Z - radius, top_z - radius];
    let half_height = (high_z - low_z) / 2.0;
    let bar = VisualShape::Primitive(Primitive::Cylinder { radius, half_height });
    let bars = (0..BARS).map(move |i| {
        let x = max_x * f64::from(2 * i - (BARS - 1)) / f64::from(BARS - 1);
        VisualSpec::at(bar.clone(), [x, y, low_z + half_height], appearance)
    });
    let across = [low_z, high_z].map(|z| rod(radius, [-max_x, y, z], [max_x, y, z], appearance));
    bars.chain(across)
}

/// Creates the visuals of the rack's floor: a wire frame with crossbars and feet that reach the table.
fn floor_visuals(appearance: AppearanceSpec) -> impl Iterator<Item = VisualSpec> {
    const BARS: i32 = 5;
    let [x, y, z] = FLOOR_CENTRE;
    let radius = FLOOR_HALF[2];
    let [reach_x, reach_y] = [FLOOR_HALF[0] - radius, FLOOR_HALF[1] - radius];
    let corner = move |i: usize| {
        let [side_x, side_y] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]][i % 4];
        [x + side_x * reach_x, y + side_y * reach_y, z]
    };
    let edges = (0..4).map(move |i| rod(radius, corner(i), corner(i + 1), appearance));
    let feet = (0..4).map(move |i| {
        let [x, y, _] = corner(i);
        rod(radius, [x, y, radius - RACK_Z], corner(i), appearance)
    });
    let bars = (0..BARS).map(move |i| {
        let x = x + reach_x * f64::from(2 * i - (BARS - 1)) / f64::from(BARS + 1);
        rod(DIVIDER_HALF[1], [x, y - reach_y, z], [x, y + reach_y, z], appearance)
    });
    edges.chain(feet).chain(bars)
}

/// Creates a capsule between two points; `to` must not lie vertically below `from`.
fn rod(radius: f64, from: [f64; 3], to: [f64; 3], appearance: AppearanceSpec) -> VisualSpec {
    let [from, to] = [from, to].map(Vector3::from);
    let half_height = (to - from).norm() / 2.0;
    let along = UnitQuaternion::rotation_between(&Vector3::z(), &(to - from)).expect("no rod points down");
    VisualSpec {
        shape: VisualShape::Primitive(Primitive::Capsule { radius, half_height }),
        pose: Isometry3::from_parts(((from + to) / 2.0).into(), along),
        appearance,
    }
}

/// Returns the pose of the plate in the rack's frame when it stands on the rack's floor, opens towards −y and
/// leans back by `lean_rad` against the top of the inner divider at `divider_y` (m). The plate's y axis
/// points up.
pub(in crate::tasks) fn leaning_pose(divider_y: f64, lean_rad: f64) -> Isometry3<f64> {
    let (sin, cos) = libm::sincos(lean_rad);
    let rim_z = HALF_DEPTH - THICKNESS * SIN_FLARE;
    let z = FLOOR_Z + RIM_RADIUS * cos - rim_z * sin;
    let y = divider_y - DIVIDER_HALF[1] - (HALF_DEPTH + (DIVIDER_TOP_Z - z) * sin) / cos;
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2 - lean_rad);
    Isometry3::from_parts(Translation3::new(0.0, y, z), upright)
}

/// Distance of the grasp below the rim, along the wall, in m.
const GRASP_DEPTH: f64 = 0.01;

/// Returns the azimuth about the plate's axis (rad) of the wall segment that lies farthest in a world
/// direction.
pub(in crate::tasks) fn farthest_azimuth(plate: &Body, direction: &Vector3<f64>) -> f64 {
    let towards = |segment: &u32| {
        let out = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), azimuth(*segment)) * Vector3::x();
        (plate.pose.rotation * out).dot(direction)
    };
    let farthest = (0..N_SEGMENTS).max_by(|a, b| towards(a).total_cmp(&towards(b)));
    azimuth(farthest.unwrap_or(0))
}

/// Returns the two TCP poses that grasp the plate's wall at an azimuth with the hand in line with the wall.
/// The first is the one whose closing direction is nearer to `closing_now`.
pub(in crate::tasks) fn rim_grasps(
    plate: &Body,
    azimuth_rad: f64,
    closing_now: &Vector3<f64>,
) -> [Isometry3<f64>; 2] {
    let wall = plate.pose * wall_pose(azimuth_rad);
    let position = wall * Point3::new(0.0, 0.0, WALL_LENGTH / 2.0 - GRASP_DEPTH);
    let closing = grasp::closest_closing(wall.rotation * Vector3::x(), closing_now);
    [closing, -closing]
        .map(|closing| grasp::pose(&position.coords, &(wall.rotation * -Vector3::z()), &closing))
}
