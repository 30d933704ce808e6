//! Model of the Panda with its hand: joints, masses and collision shapes. Lengths are in m, angles in rad.

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};

use crate::Primitive;

/// Number of arm joints, without the fingers.
pub const N_JOINTS: usize = 7;
/// Number of degrees of freedom, including the two fingers.
pub const N_DOFS: usize = 9;
/// Lower limits of joints 1 to 7.
pub const LOWER: [f64; N_JOINTS] = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973];
/// Upper limits of joints 1 to 7.
pub const UPPER: [f64; N_JOINTS] = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973];
/// Maximum opening of one finger.
pub const FINGER_OPEN: f64 = 0.04;
/// Distance from the hand frame to the TCP along z.
const HAND_TO_TCP: f64 = 0.1034;
/// Distance from the hand frame to the frame of a closed finger along z.
const HAND_TO_FINGER: f64 = 0.0584;
/// Distance from the TCP to the finger tips along the approach axis.
pub const TIP_BEYOND_TCP: f64 = HAND_TO_FINGER + 0.0545 - HAND_TO_TCP;

/// Joint frames in the frame of the preceding link, as translation and rotation about x. Every joint rotates
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

/// Returns the pose of joint `joint` (0 to 6) in the frame of the preceding link, at joint position zero.
#[must_use]
pub fn joint_origin(joint: usize) -> Isometry3<f64> {
    let (position, roll) = JOINT_ORIGINS[joint];
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), roll);
    Isometry3::from_parts(Translation3::from(position), rotation)
}

/// Returns the pose of the hand in the frame of link 7.
#[must_use]
pub fn hand_in_link7() -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -FRAC_PI_4);
    Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.107), rotation)
}

/// Returns the pose of the TCP in the frame of link 7; z is the approach axis, y the closing axis.
#[must_use]
pub fn tcp_in_link7() -> Isometry3<f64> {
    hand_in_link7() * Translation3::new(0.0, 0.0, HAND_TO_TCP)
}

/// Returns the frame of a closed finger in the frame of link 7. Finger 1 opens towards +y, finger 2 towards
/// −y.
#[must_use]
pub fn finger_in_link7() -> Isometry3<f64> {
    hand_in_link7() * Translation3::new(0.0, 0.0, HAND_TO_FINGER)
}

/// Mass, centre of mass, and inertia about the centre of mass, in a link frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    /// Mass in kg.
    pub mass: f64,
    /// Centre of mass, in m.
    pub com: Vector3<f64>,
    /// Inertia tensor about the centre of mass, in kg·m².
    pub matrix: Matrix3<f64>,
}

impl Inertia {
    /// Creates an inertia from the moments `[xx, yy, zz]` and products `[xy, xz, yz]`.
    fn new(mass: f64, com: [f64; 3], [xx, yy, zz]: [f64; 3], [xy, xz, yz]: [f64; 3]) -> Self {
        Self { mass, com: Vector3::from(com), matrix: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) }
    }

    /// Expresses the inertia in another frame, in which its own frame has `pose`.
    #[must_use]
    pub fn transformed(self, pose: &Isometry3<f64>) -> Self {
        let rotation = pose.rotation.to_rotation_matrix();
        Self {
            mass: self.mass,
            com: (pose * nalgebra::Point3::from(self.com)).coords,
            matrix: rotation.matrix() * self.matrix * rotation.matrix().transpose(),
        }
    }

    /// Returns the inertia of both parts as one rigid body (parallel axis theorem).
    #[must_use]
    pub fn combined(self, other: Self) -> Self {
        let mass = self.mass + other.mass;
        let com = (self.com * self.mass + other.com * other.mass) / mass;
        let about = |part: Self| {
            let d = part.com - com;
            part.matrix + (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * part.mass
        };
        Self { mass, com, matrix: about(self) + about(other) }
    }
}

/// Returns the inertia of link 1 to 7 (`link` 0 to 6). Link 7 includes the hand and the wrist camera.
///
/// Masses are those of the benchmark; centres of mass and inertias were identified by Gaz et al., "Dynamic
/// Identification of the Franka Emika Panda Robot With Retrieval of Feasible Parameters" (RA-L 2019), as
/// published with the robot model.
#[must_use]
pub fn link_inertia(link: usize) -> Inertia {
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
            let wrist = flange.combined(hand.transformed(&hand_in_link7()));
            // The camera is modelled as a small box at the camera centre.
            let camera = Inertia::new(0.564, [0.0465, -0.02, 0.036], [0.0002; 3], [0.0; 3]);
            wrist.combined(camera.transformed(&hand_in_link7()))
        }
    }
}

/// Returns the inertia of one finger.
#[must_use]
pub fn finger_inertia() -> Inertia {
    Inertia::new(0.015, [0.0; 3], [2.4e-6, 2.4e-6, 7.5e-7], [0.0; 3])
}

/// A collision shape and its pose in a link frame.
pub type CollisionShape = (Primitive, Isometry3<f64>);

/// Returns the collision shapes of link 0 to 7, without the hand. They are capsules and boxes fitted to the
/// bounds of the benchmark's convex hulls.
#[must_use]
pub fn link_shapes(link: usize) -> Vec<CollisionShape> {
    match link {
        0 => vec![capsule_between([-0.07, 0.0, 0.07], [0.0, 0.0, 0.07], 0.07)],
        1 => vec![
            capsule_between([0.0, 0.0, -0.137], [0.0, 0.0, 0.0], 0.055),
            capsule_between([0.0, 0.0, 0.0], [0.0, -0.074, 0.0], 0.055),
        ],
        2 => vec![
            capsule_between([0.0, 0.0, 0.0], [0.0, 0.0, 0.074], 0.055),
            capsule_between([0.0, -0.139, 0.0], [0.0, 0.0, 0.0], 0.055),
        ],
        3 => vec![
            capsule_between([0.0, 0.0, -0.066], [0.0, 0.0, 0.0], 0.055),
            capsule_between([0.0825, 0.0, 0.0], [0.0825, 0.056, 0.0], 0.055),
        ],
        4 => vec![
            capsule_between([0.0, 0.0, 0.0], [0.0, 0.0, 0.056], 0.055),
            capsule_between([-0.0825, 0.0, 0.0], [-0.0825, 0.069, 0.0], 0.055),
        ],
        5 => vec![
            capsule_between([0.0, 0.0, -0.21], [0.0, 0.02, -0.13], 0.055),
            capsule_between([0.0, 0.06, -0.13], [0.0, 0.075, -0.003], 0.055),
        ],
        6 => vec![
            capsule_between([0.0, 0.0, 0.0], [0.08, 0.0, 0.0], 0.05),
            capsule_between([0.088, 0.0, 0.0], [0.088, 0.033, 0.0], 0.05),
        ],
        _ => {
            let flange = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_4);
            let centre = flange * Vector3::new(0.0214, 0.0, 0.0794);
            vec![
                box_at([0.044, 0.044, 0.0275], &(hand_in_link7() * Translation3::new(0.0, 0.0, -0.0275))),
                box_at([0.0653, 0.0283, 0.0274], &Isometry3::from_parts(centre.into(), flange)),
            ]
        }
    }
}

/// Returns the collision shapes of the hand and the wrist camera in the frame of link 7.
#[must_use]
pub fn hand_shapes() -> [CollisionShape; 2] {
    let shape = |half, [x, y, z]: [f64; 3]| box_at(half, &(hand_in_link7() * Translation3::new(x, y, z)));
    [
        shape([0.0315, 0.102, 0.046], [0.0, 0.0, 0.02]),
        shape([0.0115, 0.0495, 0.010025], [0.0465, 0.0, 0.0235]),
    ]
}

/// Returns the collision shapes of a finger in its frame: the pad, and the three boxes that support it.
/// `side` is 1 for finger 1 and −1 for finger 2, whose shapes are mirrored in y.
#[must_use]
pub fn finger_shapes(side: f64) -> [CollisionShape; 4] {
    let shape = |half, [x, y, z]: [f64; 3], tilt: f64| {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), side * tilt);
        box_at(half, &Isometry3::from_parts(Translation3::new(x, side * y, z), rotation))
    };
    [
        shape([0.011, 0.0075, 0.010], [0.0, 0.0185, 0.011], 0.0),
        shape([0.011, 0.0044, 0.0019], [0.0, 0.0068, 0.0022], 0.0),
        shape([0.00875, 0.0035, 0.01175], [0.0, 0.0159, 0.02835], FRAC_PI_2 / 3.0),
        shape([0.00875, 0.0076, 0.00925], [0.0, 0.00758, 0.04525], 0.0),
    ]
}

fn box_at(half: [f64; 3], pose: &Isometry3<f64>) -> CollisionShape {
    (Primitive::Box { half }, *pose)
}

fn capsule_between(from: [f64; 3], to: [f64; 3], radius: f64) -> CollisionShape {
    let (from, to) = (Vector3::from(from), Vector3::from(to));
    let along = to - from;
    let rotation = UnitQuaternion::rotation_between(&Vector3::z(), &along)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), core::f64::consts::PI));
    let pose = Isometry3::from_parts(Translation3::from((from + to) / 2.0), rotation);
    (Primitive::Capsule { radius, half_height: along.norm() / 2.0 }, pose)
}
