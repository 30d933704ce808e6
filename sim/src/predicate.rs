//! Success as data: predicates over one world, each with the numbers of its own drawn scene.

use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector3};

use crate::physics::World;

/// A part of space, in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Region {
    /// A box along the axes.
    Box {
        /// Minimum x, y and z; may be infinite.
        min: [f64; 3],
        /// Maximum x, y and z; may be infinite.
        max: [f64; 3],
    },
    /// What is near a line.
    Cylinder {
        /// A point on the line.
        origin: [f64; 3],
        /// Unit vector along it.
        axis: [f64; 3],
        /// Greatest distance from it.
        radius: f64,
        /// Least and greatest distance from the origin along it; may be infinite.
        along: [f64; 2],
    },
}

impl Region {
    fn contains(self, point: &Point3<f64>) -> bool {
        match self {
            Self::Box { min, max } => (0..3).all(|k| (min[k]..=max[k]).contains(&point[k])),
            Self::Cylinder { origin, axis, radius, along: [least, greatest] } => {
                let (offset, axis) = (point - Point3::from(origin), Vector3::from(axis));
                let along = offset.dot(&axis);
                (least..=greatest).contains(&along) && (offset - axis * along).norm() <= radius
            }
        }
    }
}

/// A condition on one world. Bodies are indices into the scene's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Predicate {
    /// The body's origin is higher than `z_m`.
    Above {
        /// Body.
        body: usize,
        /// World z in m.
        z_m: f64,
    },
    /// A point of the body is farther than a distance from where it was, along one axis and either way.
    Moved {
        /// Body.
        body: usize,
        /// World position in m.
        from: [f64; 3],
        /// Unit vector in the world.
        along: [f64; 3],
        /// Distance in m.
        by_m: f64,
    },
    /// A point of the body lies within a region.
    Inside {
        /// Body.
        body: usize,
        /// Point in the body's frame, in m.
        point: [f64; 3],
        /// Whose frame the region is stated in: that of a body, or the world.
        of: Option<usize>,
        /// Region.
        region: Region,
    },
    /// A jointed body has moved at least so far from its start.
    Opened {
        /// Body.
        body: usize,
        /// Position of its joint, in m or rad.
        min_position: f64,
    },
    /// An axis of the body makes such an angle with a direction.
    Aligned {
        /// Body.
        body: usize,
        /// Unit vector in the body's frame.
        axis: [f64; 3],
        /// Unit vector in the world.
        with: [f64; 3],
        /// Least and greatest angle between them, in rad.
        angle_rad: [f64; 2],
        /// Whether the axis counts either way round, so that no angle exceeds a right one.
        either_way: bool,
    },
    /// The body is at a pose.
    At {
        /// Body.
        body: usize,
        /// World position in m.
        position: [f64; 3],
        /// World orientation, quaternion (w, x, y, z).
        orientation: [f64; 4],
        /// Greatest distance in m and greatest angle in rad.
        tolerance: [f64; 2],
    },
    /// `top` stands on `base`: origins near in xy, and one above the other.
    On {
        /// Upper body.
        top: usize,
        /// Lower body.
        base: usize,
        /// Greatest distance of the origins in the xy plane, in m.
        xy_m: f64,
        /// Height of `top`'s origin over `base`'s, in m.
        rise_m: f64,
        /// Greatest error of that height, in m; infinite for any height.
        rise_tolerance_m: f64,
    },
    /// The body is at rest.
    AtRest {
        /// Body.
        body: usize,
        /// Greatest speed in m/s.
        max_linear: f64,
        /// Greatest angular speed in rad/s.
        max_angular: f64,
    },
    /// No arm joint moves faster than `max_qvel` rad/s; fingers do not count.
    RobotAtRest {
        /// rad/s.
        max_qvel: f64,
    },
    /// This arm grasps the body, and its TCP is at least as near to it as the other arm's.
    GraspedByNearest {
        /// Body.
        body: usize,
        /// Arm index.
        arm: usize,
    },
    /// At least one arm grasps the body.
    Held {
        /// Body.
        body: usize,
    },
    /// No arm grasps the body.
    Released {
        /// Body.
        body: usize,
    },
}

impl Predicate {
    /// The body's origin lies within a box of the world, in m; bounds may be infinite.
    #[must_use]
    pub const fn inside_box(body: usize, least: [f64; 3], greatest: [f64; 3]) -> Self {
        Self::Inside { body, point: [0.0; 3], of: None, region: Region::Box { min: least, max: greatest } }
    }

    /// Word for the predicate in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Above { .. } => "above",
            Self::Moved { .. } => "moved",
            Self::Inside { .. } => "inside",
            Self::Opened { .. } => "opened",
            Self::Aligned { .. } => "aligned",
            Self::At { .. } => "at",
            Self::On { .. } => "on",
            Self::AtRest { .. } => "still",
            Self::RobotAtRest { .. } => "robot_still",
            Self::GraspedByNearest { .. } => "nearer",
            Self::Held { .. } => "held",
            Self::Released { .. } => "released",
        }
    }

    /// Whether it holds in the world as it is now.
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
            Self::Opened { body, min_position } => f64::from(world.joint_position(body)) >= min_position,
            Self::Aligned { body, axis, with, angle_rad: [least, greatest], either_way } => {
                let axis = world.body_pose(body).rotation.cast::<f64>() * Vector3::from(axis);
                let cosine = axis.dot(&Vector3::from(with));
                let cosine = if either_way { cosine.abs() } else { cosine };
                (libm::cos(greatest)..=libm::cos(least)).contains(&cosine.clamp(-1.0, 1.0))
            }
            Self::At { body, position: goal, orientation: [w, x, y, z], tolerance: [far, turned] } => {
                let goal_orientation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
                (position(body) - Vector3::from(goal)).norm() <= far
                    && world.body_pose(body).rotation.cast::<f64>().angle_to(&goal_orientation) <= turned
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

/// The first predicate that does not hold, if any.
#[must_use]
pub fn first_unmet(predicates: &[Predicate], world: &World) -> Option<Predicate> {
    predicates.iter().copied().find(|predicate| !predicate.holds(world))
}
