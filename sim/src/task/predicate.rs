//! Success predicates: conditions on the state of one world, with the parameters of its sampled scene.

use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector3};

use crate::physics::World;

/// A region of space, in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Region {
    /// An axis-aligned box.
    Box {
        /// Minimum x, y and z; may be infinite.
        min: [f64; 3],
        /// Maximum x, y and z; may be infinite.
        max: [f64; 3],
    },
    /// A cylinder with arbitrary axis.
    Cylinder {
        /// A point on the axis.
        origin: [f64; 3],
        /// Unit vector along the axis.
        axis: [f64; 3],
        /// Maximum distance from the axis.
        radius: f64,
        /// Minimum and maximum position along the axis, relative to `origin`; may be infinite.
        along: [f64; 2],
    },
    /// A cylinder with a half-ellipsoid on its base.
    DomedCylinder {
        /// Centre of the base.
        origin: [f64; 3],
        /// Unit vector along the axis, from the base into the cylinder.
        axis: [f64; 3],
        /// Radius of the cylinder and of the half-ellipsoid.
        radius: f64,
        /// Length of the cylinder.
        length: f64,
        /// Height of the half-ellipsoid.
        dome: f64,
    },
}

impl Region {
    fn contains(self, point: &Point3<f64>) -> bool {
        match self {
            Self::Box { min, max } => (0..3).all(|k| (min[k]..=max[k]).contains(&point[k])),
            Self::Cylinder { origin, axis, radius, along: [min, max] } => {
                let (offset, axis) = (point - Point3::from(origin), Vector3::from(axis));
                let along = offset.dot(&axis);
                (min..=max).contains(&along) && (offset - axis * along).norm() <= radius
            }
            Self::DomedCylinder { origin, axis, radius, length, dome } => {
                let (offset, axis) = (point - Point3::from(origin), Vector3::from(axis));
                let along = offset.dot(&axis);
                let across = (offset - axis * along).norm() / radius;
                along <= length && libm::hypot(across, (along / dome).min(0.0)) <= 1.0
            }
        }
    }
}

/// A condition on the state of one world. Bodies are indices into [`scene::Scene::bodies`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Predicate {
    /// The origin of the body is above `z_m`.
    Above {
        /// Index of the body.
        body: usize,
        /// Height in the world frame, in m.
        z_m: f64,
    },
    /// The origin of the body has moved by more than a distance along an axis, in either direction.
    Moved {
        /// Index of the body.
        body: usize,
        /// Reference position in the world frame, in m.
        from: [f64; 3],
        /// Axis, as a unit vector in the world frame.
        along: [f64; 3],
        /// Minimum distance, in m.
        by_m: f64,
    },
    /// A point of the body is inside a region.
    Inside {
        /// Index of the body.
        body: usize,
        /// Point in the body frame, in m.
        point: [f64; 3],
        /// Body in whose frame the region is defined; `None` for the world frame.
        of: Option<usize>,
        /// The region, in that frame.
        region: Region,
    },
    /// The offset of a body's origin from that of another body, along the world's axes, is inside a region.
    Offset {
        /// Index of the body.
        body: usize,
        /// Index of the other body.
        from: usize,
        /// The region, about the other body's origin.
        region: Region,
    },
    /// The joint of a jointed body has moved at least a given distance from its start.
    Opened {
        /// Index of the body.
        body: usize,
        /// Minimum joint position, in m or rad.
        min_position: f64,
    },
    /// The angle between an axis of the body and a direction is within bounds.
    Aligned {
        /// Index of the body.
        body: usize,
        /// Axis, as a unit vector in the body frame.
        axis: [f64; 3],
        /// Direction, as a unit vector in the world frame.
        with: [f64; 3],
        /// Minimum and maximum angle, in rad.
        angle_rad: [f64; 2],
        /// `true` if the sign of the axis is ignored, so that the angle is at most π/2.
        either_way: bool,
    },
    /// The third of the body's intrinsic XYZ Euler angles is within bounds, whatever its sign.
    ThirdEulerAngle {
        /// Index of the body.
        body: usize,
        /// Minimum and maximum of the angle's absolute value, in rad.
        angle_rad: [f64; 2],
    },
    /// The body is close to a pose.
    At {
        /// Index of the body.
        body: usize,
        /// Position in the world frame, in m.
        position: [f64; 3],
        /// Orientation in the world frame, quaternion (w, x, y, z).
        orientation: [f64; 4],
        /// Maximum distance in m and maximum angle in rad.
        tolerance: [f64; 2],
    },
    /// `top` is on `base`: their origins are close in xy, and `top` is above `base` by a given height.
    On {
        /// Index of the upper body.
        top: usize,
        /// Index of the lower body.
        base: usize,
        /// Maximum distance of the origins in the xy plane, in m.
        xy_m: f64,
        /// Height of the origin of `top` above that of `base`, in m.
        rise_m: f64,
        /// Maximum deviation from that height, in m; infinite to accept any height.
        rise_tolerance_m: f64,
    },
    /// The body is at rest.
    AtRest {
        /// Index of the body.
        body: usize,
        /// Maximum linear speed, in m/s.
        max_linear: f64,
        /// Maximum angular speed, in rad/s.
        max_angular: f64,
    },
    /// All arm joints are at rest; fingers are ignored.
    RobotAtRest {
        /// Maximum joint speed, in rad/s.
        max_qvel: f64,
    },
    /// An arm grasps the body, and its TCP is at least as close to it as that of any other arm.
    GraspedByNearest {
        /// Index of the body.
        body: usize,
        /// Index of the arm.
        arm: usize,
    },
    /// At least one arm grasps the body.
    Held {
        /// Index of the body.
        body: usize,
    },
    /// No arm grasps the body.
    Released {
        /// Index of the body.
        body: usize,
    },
}

impl Predicate {
    /// Creates a predicate for the body's origin being inside a box in the world frame, in m. Bounds may be
    /// infinite.
    #[must_use]
    pub const fn inside_box(body: usize, min: [f64; 3], max: [f64; 3]) -> Self {
        Self::Inside { body, point: [0.0; 3], of: None, region: Region::Box { min, max } }
    }

    /// Returns the name used in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Above { .. } => "above",
            Self::Moved { .. } => "moved",
            Self::Inside { .. } => "inside",
            Self::Offset { .. } => "offset",
            Self::Opened { .. } => "opened",
            Self::Aligned { .. } => "aligned",
            Self::ThirdEulerAngle { .. } => "euler",
            Self::At { .. } => "at",
            Self::On { .. } => "on",
            Self::AtRest { .. } => "still",
            Self::RobotAtRest { .. } => "robot_still",
            Self::GraspedByNearest { .. } => "nearer",
            Self::Held { .. } => "held",
            Self::Released { .. } => "released",
        }
    }

    /// Returns `true` if the predicate holds in the current state of `world`.
    #[must_use]
    pub fn holds(self, world: &World) -> bool {
        let position = |body: usize| world.body_pose(body).translation.vector.cast::<f64>();
        let held = |body: usize| (0..world.n_arms()).any(|arm| world.is_grasping(arm, body));
        match self {
            Self::Above { body, z_m } => position(body).z > z_m,
            Self::Moved { body, from, along, by_m } => {
                (position(body) - Vector3::from(from)).dot(&Vector3::from(along)).abs() > by_m
            }
            Self::Inside { body, point, of, region } => {
                let pose = |body: usize| world.body_pose(body).cast::<f64>();
                let in_world = pose(body) * Point3::from(point);
                region.contains(&of.map_or(in_world, |of| pose(of).inverse_transform_point(&in_world)))
            }
            Self::Offset { body, from, region } => region.contains(&(position(body) - position(from)).into()),
            Self::Opened { body, min_position } => f64::from(world.joint_position(body)) >= min_position,
            Self::Aligned { body, axis, with, angle_rad: [min, max], either_way } => {
                let axis = world.body_pose(body).rotation.cast::<f64>() * Vector3::from(axis);
                let cosine = axis.dot(&Vector3::from(with));
                let cosine = if either_way { cosine.abs() } else { cosine };
                (libm::cos(max)..=libm::cos(min)).contains(&cosine.clamp(-1.0, 1.0))
            }
            Self::ThirdEulerAngle { body, angle_rad: [min, max] } => {
                let rotation = world.body_pose(body).rotation.cast::<f64>().to_rotation_matrix();
                (min..=max).contains(&libm::atan2(-rotation[(0, 1)], rotation[(0, 0)]).abs())
            }
            Self::At {
                body,
                position: goal,
                orientation: [w, x, y, z],
                tolerance: [max_distance, max_angle],
            } => {
                let goal_orientation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
                (position(body) - Vector3::from(goal)).norm() <= max_distance
                    && world.body_pose(body).rotation.cast::<f64>().angle_to(&goal_orientation) <= max_angle
            }
            Self::On { top, base, xy_m, rise_m, rise_tolerance_m } => {
                let offset = position(top) - position(base);
                offset.xy().norm() <= xy_m && (offset.z - rise_m).abs() <= rise_tolerance_m
            }
            Self::AtRest { body, max_linear, max_angular } => {
                let (linear, angular) = world.body_velocity(body);
                f64::from(linear.norm()) <= max_linear && f64::from(angular.norm()) <= max_angular
            }
            Self::RobotAtRest { max_qvel } => (0..world.n_arms())
                .all(|arm| world.qvel(arm)[..7].iter().all(|v| f64::from(v.abs()) <= max_qvel)),
            Self::GraspedByNearest { body, arm } => {
                let distance = |arm: usize| {
                    (world.tcp_pose(arm).translation.vector.cast::<f64>() - position(body)).norm()
                };
                world.is_grasping(arm, body)
                    && (0..world.n_arms()).all(|other| distance(arm) <= distance(other))
            }
            Self::Held { body } => held(body),
            Self::Released { body } => !held(body),
        }
    }
}

/// Returns the first predicate that does not hold, if any.
#[must_use]
pub fn first_unmet(predicates: &[Predicate], world: &World) -> Option<Predicate> {
    predicates.iter().copied().find(|predicate| !predicate.holds(world))
}
