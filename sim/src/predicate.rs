//! Success as data: predicates over one world, each with the numbers of its own drawn scene.

use nalgebra::Vector3;

use crate::physics::World;

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
    /// The body's origin lies within a box.
    Inside {
        /// Body.
        body: usize,
        /// Least world x, y and z in m; may be infinite.
        least: [f64; 3],
        /// Greatest world x, y and z in m; may be infinite.
        greatest: [f64; 3],
    },
    /// An axis of the body lies along a direction, either way round.
    Aligned {
        /// Body.
        body: usize,
        /// Unit vector in the body's frame.
        axis: [f64; 3],
        /// Unit vector in the world.
        with: [f64; 3],
        /// Greatest angle between them, in rad.
        tolerance_rad: f64,
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
    Still {
        /// Body.
        body: usize,
        /// Greatest speed in m/s.
        max_linear: f64,
        /// Greatest angular speed in rad/s.
        max_angular: f64,
    },
    /// No arm joint moves faster than `max_qvel` rad/s; fingers do not count.
    RobotStill {
        /// rad/s.
        max_qvel: f64,
    },
    /// This arm grasps the body, and its TCP is at least as near to it as the other arm's.
    Nearer {
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
    /// Word for the predicate in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Above { .. } => "above",
            Self::Inside { .. } => "inside",
            Self::Aligned { .. } => "aligned",
            Self::On { .. } => "on",
            Self::Still { .. } => "still",
            Self::RobotStill { .. } => "robot_still",
            Self::Nearer { .. } => "nearer",
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
            Self::Inside { body, least, greatest } => {
                let position = position(body);
                (0..3).all(|k| (least[k]..=greatest[k]).contains(&position[k]))
            }
            Self::Aligned { body, axis, with, tolerance_rad } => {
                let axis = world.body_pose(body).rotation.cast::<f64>() * Vector3::from(axis);
                axis.dot(&Vector3::from(with)).abs() >= tolerance_rad.cos()
            }
            Self::On { top, base, xy_m, rise_m, rise_tolerance_m } => {
                let offset = position(top) - position(base);
                offset.xy().norm() <= xy_m && (offset.z - rise_m).abs() <= rise_tolerance_m
            }
            Self::Still { body, max_linear, max_angular } => {
                let (linear, angular) = world.body_velocity(body);
                f64::from(linear.norm()) <= max_linear && f64::from(angular.norm()) <= max_angular
            }
            Self::RobotStill { max_qvel } => (0..world.n_arms())
                .all(|arm| world.qvel(arm)[..7].iter().all(|v| f64::from(v.abs()) <= max_qvel)),
            Self::Nearer { body, arm } => {
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
