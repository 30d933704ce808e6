//! Facts of the Panda with its hand: joints, masses, solids (spec/env.md §3). Lengths in m, angles in rad.

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};

use crate::scene::Primitive;

/// Joints of an arm without its fingers.
pub const N_JOINTS: usize = 7;
/// Joints of an arm with its two fingers.
pub const N_DOFS: usize = 9;
/// Least positions of joints 1 to 7.
pub const LOWER: [f64; N_JOINTS] = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973];
/// Greatest positions of joints 1 to 7.
pub const UPPER: [f64; N_JOINTS] = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973];
/// Greatest opening of one finger.
pub const FINGER_OPEN: f64 = 0.04;
/// Distance from the hand's frame to the TCP along z.
const HAND_TO_TCP: f64 = 0.1034;
/// Distance from the hand's frame to a closed finger's frame along z.
const HAND_TO_FINGER: f64 = 0.0584;
/// How far the finger tips reach beyond the TCP.
pub const TIP_BEYOND_TCP: f64 = HAND_TO_FINGER + 0.0545 - HAND_TO_TCP;

/// Where a joint's frame sits in the frame of the link before it, as translation and rotation about x; every joint turns
/// about its own z.
const JOINT_ORIGINS: [([f64; 3], f64); N_JOINTS] = [
    ([0.0, 0.0, 0.333], 0.0),
    ([0.0, 0.0, 0.0], -FRAC_PI_2),
    ([0.0, -0.316, 0.0], FRAC_PI_2),
    ([0.0825, 0.0, 0.0], FRAC_PI_2),
    ([-0.0825, 0.384, 0.0], -FRAC_PI_2),
    ([0.0, 0.0, 0.0], FRAC_PI_2),
    ([0.088, 0.0, 0.0], FRAC_PI_2),
];

/// Pose of joint `joint` (0 to 6) in the frame of the link before it, at position zero.
#[must_use]
pub fn joint_origin(joint: usize) -> Isometry3<f64> {
    let (position, roll) = JOINT_ORIGINS[joint];
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), roll);
    Isometry3::from_parts(Translation3::from(position), rotation)
}

/// Pose of the hand in the frame of link 7.
#[must_use]
pub fn hand_in_link7() -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -FRAC_PI_4);
    Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.107), rotation)
}

/// Pose of the TCP in the frame of link 7: z approaches, y closes.
#[must_use]
pub fn tcp_in_link7() -> Isometry3<f64> {
    hand_in_link7() * Translation3::new(0.0, 0.0, HAND_TO_TCP)
}

/// Pose of a closed finger's frame in the frame of link 7; finger 1 opens towards its +y, finger 2 towards its −y.
#[must_use]
pub fn finger_in_link7() -> Isometry3<f64> {
    hand_in_link7() * Translation3::new(0.0, 0.0, HAND_TO_FINGER)
}

/// Mass, centre of mass and inertia about it, in a link's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    /// kg.
    pub mass: f64,
    /// m.
    pub com: Vector3<f64>,
    /// kg·m².
    pub matrix: Matrix3<f64>,
}

impl Inertia {
    /// From the diagonal `[xx, yy, zz]` and the products `[xy, xz, yz]`.
    fn new(mass: f64, com: [f64; 3], [xx, yy, zz]: [f64; 3], [xy, xz, yz]: [f64; 3]) -> Self {
        Self { mass, com: Vector3::from(com), matrix: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) }
    }

    /// The same matter, seen from the frame in which its own frame has this pose.
    fn at(self, pose: &Isometry3<f64>) -> Self {
        let rotation = pose.rotation.to_rotation_matrix();
        Self {
            mass: self.mass,
            com: (pose * nalgebra::Point3::from(self.com)).coords,
            matrix: rotation.matrix() * self.matrix * rotation.matrix().transpose(),
        }
    }

    /// Both, as one rigid body (parallel axis theorem).
    fn with(self, other: Self) -> Self {
        let mass = self.mass + other.mass;
        let com = (self.com * self.mass + other.com * other.mass) / mass;
        let about = |part: Self| {
            let d = part.com - com;
            part.matrix + (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * part.mass
        };
        Self { mass, com, matrix: about(self) + about(other) }
    }
}

/// Inertia of link 1 to 7 (`link` 0 to 6); link 7 carries the hand, and on a single arm the wrist camera.
///
/// Masses are the benchmark's; centres and inertias are those identified by Gaz et al., "Dynamic Identification of the
/// Franka Emika Panda Robot With Retrieval of Feasible Parameters" (RA-L 2019), as published with the robot's model.
#[must_use]
pub fn link_inertia(link: usize, wrist_camera: bool) -> Inertia {
    match link {
        0 => Inertia::new(
            4.971,
            [0.0039, 0.0021, -0.0476],
            [0.7034, 0.7066, 0.0091],
            [-0.0001, 0.0068, 0.0192],
        ),
        1 => Inertia::new(
            0.647,
            [-0.0031, -0.0287, 0.0035],
            [0.0080, 0.0281, 0.0260],
            [-0.0039, 0.0103, 0.0007],
        ),
        2 => Inertia::new(
            3.229,
            [0.0275, 0.0393, -0.0665],
            [0.0372, 0.0362, 0.0108],
            [-0.0048, -0.0114, -0.0128],
        ),
        3 => Inertia::new(
            3.588,
            [-0.0532, 0.1044, 0.0275],
            [0.0259, 0.0196, 0.0283],
            [0.0078, -0.0013, 0.0086],
        ),
        4 => Inertia::new(
            1.226,
            [-0.0120, 0.0411, -0.0384],
            [0.0355, 0.0295, 0.0086],
            [-0.0021, -0.0040, 0.0002],
        ),
        5 => Inertia::new(
            1.667,
            [0.0601, -0.0141, -0.0105],
            [0.0020, 0.0044, 0.0054],
            [0.0001, -0.0012, 0.0003],
        ),
        _ => {
            let hand = Inertia::new(0.73, [-0.01, 0.0, 0.03], [0.001, 0.0025, 0.0017], [0.0; 3]);
            let flange = Inertia::new(
                0.736,
                [0.0105, -0.0043, 0.0616],
                [0.0125, 0.0100, 0.0048],
                [-0.0004, -0.0012, -0.0007],
            );
            let wrist = flange.with(hand.at(&hand_in_link7()));
            // The camera as a small block where the image is taken from.
            let camera = Inertia::new(0.564, [0.0465, -0.02, 0.036], [0.0002; 3], [0.0; 3]);
            if wrist_camera { wrist.with(camera.at(&hand_in_link7())) } else { wrist }
        }
    }
}

/// Inertia of one finger.
#[must_use]
pub fn finger_inertia() -> Inertia {
    Inertia::new(0.015, [0.0; 3], [2.4e-6, 2.4e-6, 7.5e-7], [0.0; 3])
}

/// A collision solid and its pose in a link's frame.
pub type Solid = (Primitive, Isometry3<f64>);

/// Collision solids of link 0 to 7; those of link 7 include the hand's. Capsules and boxes that fill the bounds of the
/// benchmark's hulls.
#[must_use]
pub fn link_solids(link: usize) -> Vec<Solid> {
    match link {
        0 => vec![capsule([-0.07, 0.0, 0.07], [0.0, 0.0, 0.07], 0.07)],
        1 => vec![
            capsule([0.0, 0.0, -0.137], [0.0, 0.0, 0.0], 0.055),
            capsule([0.0, 0.0, 0.0], [0.0, -0.074, 0.0], 0.055),
        ],
        2 => vec![
            capsule([0.0, 0.0, 0.0], [0.0, 0.0, 0.074], 0.055),
            capsule([0.0, -0.139, 0.0], [0.0, 0.0, 0.0], 0.055),
        ],
        3 => vec![
            capsule([0.0, 0.0, -0.066], [0.0, 0.0, 0.0], 0.055),
            capsule([0.0825, 0.0, 0.0], [0.0825, 0.056, 0.0], 0.055),
        ],
        4 => vec![
            capsule([0.0, 0.0, 0.0], [0.0, 0.0, 0.056], 0.055),
            capsule([-0.0825, 0.0, 0.0], [-0.0825, 0.069, 0.0], 0.055),
        ],
        5 => vec![
            capsule([0.0, 0.0, -0.21], [0.0, 0.02, -0.13], 0.055),
            capsule([0.0, 0.06, -0.13], [0.0, 0.075, -0.003], 0.055),
        ],
        6 => vec![
            capsule([0.0, 0.0, 0.0], [0.08, 0.0, 0.0], 0.05),
            capsule([0.088, 0.0, 0.0], [0.088, 0.033, 0.0], 0.05),
        ],
        _ => {
            let hand = hand_in_link7();
            vec![
                block([0.044, 0.044, 0.0275], &(hand * Translation3::new(0.0, 0.0, -0.0275))),
                block([0.0315, 0.102, 0.046], &(hand * Translation3::new(0.0, 0.0, 0.02))),
            ]
        }
    }
}

/// Collision solids of a finger in its frame: the pad that grips and the three blocks that carry it. `side` is 1 for
/// finger 1, −1 for finger 2, whose solids are mirrored in y.
#[must_use]
pub fn finger_solids(side: f64) -> [Solid; 4] {
    let solid = |half, [x, y, z]: [f64; 3], tilt: f64| {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), side * tilt);
        block(half, &Isometry3::from_parts(Translation3::new(x, side * y, z), rotation))
    };
    [
        solid([0.011, 0.0075, 0.010], [0.0, 0.0185, 0.011], 0.0),
        solid([0.011, 0.0044, 0.0019], [0.0, 0.0068, 0.0022], 0.0),
        solid([0.00875, 0.0035, 0.01175], [0.0, 0.0159, 0.02835], FRAC_PI_2 / 3.0),
        solid([0.00875, 0.0076, 0.00925], [0.0, 0.00758, 0.04525], 0.0),
    ]
}

fn block(half: [f64; 3], pose: &Isometry3<f64>) -> Solid {
    (Primitive::Box { half }, *pose)
}

fn capsule(from: [f64; 3], to: [f64; 3], radius: f64) -> Solid {
    let (from, to) = (Vector3::from(from), Vector3::from(to));
    let along = to - from;
    let rotation = UnitQuaternion::rotation_between(&Vector3::z(), &along)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), core::f64::consts::PI));
    let pose = Isometry3::from_parts(Translation3::from((from + to) / 2.0), rotation);
    (Primitive::Capsule { radius, half_height: along.norm() / 2.0 }, pose)
}
