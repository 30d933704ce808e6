//! The plate and the drying rack of PickDishFromRack and PlaceDishInRack. See docs/benchmark.md, "Scenes and
//! objects".

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::tasks::common::{SINGLE_TABLE_Z, box_part, fixed, movable};
use scene::{AppearanceSpec, BodySpec, Mass, PartSpec, Primitive, ScaledBy, VisualShape, VisualSpec};

/// Initial joint positions in rad: TCP at world (−0.088, 0.038, 0.318) m, pointing down.
pub(crate) const QPOS: [f64; 7] = [0.0380, -0.0558, 0.0235, -2.1654, 0.0421, 2.1272, -0.7544];

/// Radius and z of the circles between which the plate is a solid of revolution: the foot, the underside of
/// the base, and the base up to the floor of the dish. In m.
const SOLID: [[[f64; 2]; 2]; 3] = [
    [[0.0535, -0.019], [0.058, -0.012]],
    [[0.058, -0.012], [0.0775, -0.008]],
    [[0.0775, -0.008], [0.0873, 0.0015]],
];
/// Height of the plate's underside in its frame, in m.
const FOOT_Z: f64 = -0.0232;
/// Radius of the plate's foot, in m.
const FOOT_RADIUS: f64 = 0.0505;
/// Profile (r, z) of the plate as it is seen, in m. It is thinner than the solid that collides.
const PROFILE: [[f64; 2]; 26] = [
    [0.0, -0.0175],
    [0.0395, -0.0175],
    [0.0415, -0.0215],
    [0.0430, -0.02245],
    [0.0490, -0.02245],
    [0.0507, -0.0220],
    [0.0530, -0.0188],
    [0.0570, -0.0160],
    [0.0730, -0.0133],
    [0.0780, -0.0118],
    [0.0796, -0.0080],
    [0.0837, -0.0040],
    [0.0864, 0.0],
    [0.0888, 0.0040],
    [0.0900, 0.0090],
    [0.0905, 0.0160],
    [0.0905, 0.0208],
    [0.0895, 0.0222],
    [0.0875, 0.02245],
    [0.0859, 0.0215],
    [0.0853, 0.0160],
    [0.0840, 0.0100],
    [0.0800, 0.0050],
    [0.0740, 0.0008],
    [0.0600, -0.0020],
    [0.0, -0.0030],
];
/// Heights of the bottom and the top of the rim's wall in the plate's frame, in m.
const WALL_Z: [f64; 2] = [0.0015, 0.024];
/// Thickness of the rim's wall, in m.
const WALL_THICKNESS: f64 = 0.0085;
/// Outer radius of the wall halfway up, at the middle of a segment, in m.
const WALL_RADIUS: f64 = 0.0904;
/// Outward lean of the wall from the plate's axis, in rad.
const FLARE: f64 = 0.053;
/// Number of boxes that the wall consists of for collision. A plate on edge rests on one of them and does not
/// roll.
const N_SEGMENTS: u32 = 16;

/// Creates the plate, open at the top, about its z axis. By default it lies on the table in the first region.
///
/// The benchmark's plate is a shallow dish on a foot. It collides as convex pieces that fill its floor and
/// double the thickness of its rim; so does this one.
pub(crate) fn plate() -> BodySpec {
    let white = AppearanceSpec { specular: 0.4, ..AppearanceSpec::plain([0.93; 3]) };
    let half = [
        WALL_THICKNESS / 2.0,
        WALL_RADIUS * libm::tan(PI / f64::from(N_SEGMENTS)),
        (WALL_Z[1] - WALL_Z[0]) / 2.0,
    ];
    let segment =
        |i: u32| PartSpec { shape: Primitive::Box { half }, pose: wall_pose(azimuth(i)), appearance: white };
    let foot = Primitive::Cylinder { radius: FOOT_RADIUS, half_height: (SOLID[0][0][1] - FOOT_Z) / 2.0 };
    let foot = PartSpec::at(foot, [0.0, 0.0, (SOLID[0][0][1] + FOOT_Z) / 2.0], white);
    let solid = SOLID.map(|circles| PartSpec::at(Primitive::frustum(circles), [0.0; 3], white));
    BodySpec {
        visuals: vec![VisualSpec::at(VisualShape::Lathe { profile: PROFILE.to_vec() }, [0.0; 3], white)],
        scaled_by: ScaledBy::Nothing("the slots of the rack are made for it"),
        mass: Mass::Measured { kg: 0.1365, centre: [0.0, 0.0, -0.0029], inertia: [2.9e-4, 2.9e-4, 5.5e-4] },
        friction: 20.0,
        ..movable(
            "plate",
            (0..N_SEGMENTS).map(segment).chain([foot]).chain(solid).collect(),
            0,
            SINGLE_TABLE_Z,
        )
    }
}

/// Returns the azimuth of a wall segment's centre about the plate's axis, in rad.
fn azimuth(segment: u32) -> f64 {
    TAU * f64::from(segment) / f64::from(N_SEGMENTS)
}

/// Returns the pose of the plate's wall at an azimuth, in the plate's frame: x points outwards through the
/// wall and z along it to the rim.
fn wall_pose(azimuth_rad: f64) -> Isometry3<f64> {
    let middle = Vector3::new(WALL_RADIUS - WALL_THICKNESS / 2.0, 0.0, (WALL_Z[0] + WALL_Z[1]) / 2.0);
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
/// Half-extents of the rack's floor, in m.
const FLOOR_HALF: [f64; 3] = [0.09045, 0.12585, 0.005];
/// Centre of the rack's floor in the rack's frame, in m.
const FLOOR_CENTRE: [f64; 3] = [0.0043, 0.0078, FLOOR_Z - 0.005];
/// Half-width and half-thickness of a divider, in m.
const DIVIDER_HALF: [f64; 2] = [0.0603, 0.003];

/// Creates the rack: four dividers at the given y on a floor. Its visuals show the object that the boxes
/// approximate, a frame with two rows of pegs.
pub(crate) fn rack(region: usize, dividers_y: [f64; 4]) -> BodySpec {
    let white = AppearanceSpec::plain([0.8; 3]);
    let [half_x, half_y] = DIVIDER_HALF;
    // Half-height and centre z of the outer and of the inner dividers.
    let upright = |i: usize| if i == 0 || i == 3 { [0.06265, -0.0011] } else { [0.06145, -0.0023] };
    let divider = |(i, y)| {
        let [half_z, z] = upright(i);
        box_part([half_x, half_y, half_z], [0.0, y, z], white)
    };
    let dividers = dividers_y.into_iter().enumerate().map(divider);
    let parts = dividers.chain([box_part(FLOOR_HALF, FLOOR_CENTRE, white)]).collect();
    BodySpec {
        visuals: rack_visuals(white),
        ..fixed("rack", parts, region, RACK_Z + UNDERSIDE_Z, "the released code keeps its size")
    }
}

/// Distance of a row of pegs, and of the rail on which it stands, from the middle of the rack, in m.
const PEG_X: f64 = 0.0752;
/// The y of the pegs of a row, in m.
const PEG_Y: [f64; 4] = [-0.0992, -0.0392, 0.0222, 0.0822];
/// Radius of a peg, in m.
const PEG_RADIUS: f64 = 0.0075;
/// Height of the tips of the pegs, in m.
const PEG_TIP_Z: f64 = 0.0638;
/// Half-extents of a rail of the frame, in m.
const RAIL_HALF: [f64; 3] = [0.0155, 0.1259, 0.0113];
/// Half-extents of a crossbar of the frame, in m.
const CROSSBAR_HALF: [f64; 3] = [0.06, 0.009, 0.0075];
/// The y of the crossbars, in m.
const CROSSBAR_Y: [f64; 2] = [-0.102, 0.082];

/// Creates the visuals of the rack: a frame of two rails and two crossbars, and a row of pegs on each rail.
fn rack_visuals(appearance: AppearanceSpec) -> Vec<VisualSpec> {
    let visual = |shape, position| VisualSpec::at(VisualShape::Primitive(shape), position, appearance);
    let bar = |half: [f64; 3], x, y| visual(Primitive::Box { half }, [x, y, UNDERSIDE_Z + half[2]]);
    let half_height = (PEG_TIP_Z - UNDERSIDE_Z) / 2.0 - PEG_RADIUS;
    let peg = |x, y| {
        let capsule = Primitive::Capsule { radius: PEG_RADIUS, half_height };
        visual(capsule, [x, y, f64::midpoint(PEG_TIP_Z, UNDERSIDE_Z)])
    };
    let rows = [-PEG_X, PEG_X].into_iter();
    let rails = rows.clone().map(|x| bar(RAIL_HALF, x, 0.0));
    let pegs = rows.flat_map(|x| PEG_Y.map(|y| peg(x, y)));
    rails.chain(CROSSBAR_Y.map(|y| bar(CROSSBAR_HALF, 0.0, y))).chain(pegs).collect()
}

/// Returns the pose of the plate in the rack's frame when it stands upright, open towards −y, with its centre
/// at a given y and z (m).
pub(crate) fn upright_pose(y: f64, z: f64) -> Isometry3<f64> {
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    Isometry3::from_parts(Translation3::new(0.0, y, z), upright)
}
