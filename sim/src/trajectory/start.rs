//! Start states: a trajectory file resolved against the task it names.

use std::path::Path;

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::file::{ArmFile, BodyFile, TrajectoryError, TrajectoryFile};
use crate::physics::{ArmState, BodyState, Parameters, World, WorldState};
use crate::{Profile, TaskId};
use scene::Scene;
use scene::robot::panda;

/// Maximum deviation of a quaternion's norm from 1.
const NORM_TOLERANCE: f64 = 1e-3;
/// Distance in rad (joints) and m (fingers) by which recordings of contacts are beyond their limits.
const LIMIT_TOLERANCE: [f64; 2] = [0.1, 0.01];
/// Deviation of a body's dimension, since recorded numbers are rounded.
pub(crate) const SIZE_TOLERANCE: f64 = 1e-4;
/// Largest speed of a joint in rad/s and of a body in m/s, ten times and more of what the benchmark reaches.
const MAX_SPEED: f64 = 100.0;
/// Largest angular speed of a body in rad/s.
const MAX_ANGULAR_SPEED: f64 = 1000.0;
/// Largest distance of a body from the origin along an axis in m. The table is 2.4 m wide.
const MAX_DISTANCE: f64 = 10.0;
/// Seed of what a start leaves open, none of which affects the motion.
const APPEARANCE_SEED: u64 = 0;

/// A start state of a task.
#[derive(Clone, Debug)]
pub struct Start {
    /// The task.
    pub task: TaskId,
    /// Reading of the benchmark by which success is determined.
    pub profile: Profile,
    /// Control mode of the actions.
    pub mode: ControlMode,
    /// The scene; its bodies and arms have the poses of the state.
    pub scene: Scene,
    /// Positions and velocities.
    pub state: WorldState,
}

impl Start {
    /// Checks the values of a file against its task. `path` appears in errors.
    ///
    /// # Errors
    /// If the task or the control mode is unknown; if an arm, a body or a size is missing or unknown; or if a
    /// number is not a possible value.
    pub fn resolve(file: &TrajectoryFile, path: &Path) -> Result<Self, TrajectoryError> {
        let error = |key: &str, expected: &str, found| TrajectoryError::value(path, key, expected, found);
        let task = TaskId::ALL.iter().find(|it| it.name() == file.task || it.task().env_id == file.task);
        let task = *task.ok_or_else(|| error("task", "the name of a task", format!("{:?}", file.task)))?;
        let mode = ControlMode::ALL.into_iter().find(|mode| mode.name() == file.control_mode);
        let modes = ControlMode::ALL.map(ControlMode::name).join(", ");
        let mode =
            mode.ok_or_else(|| error("control_mode", &format!("one of {modes}"), file.control_mode.clone()))?;
        let mut scene = scene_of_size(task, file.profile, &file.sizes)
            .map_err(|expected| error("sizes", &expected, format!("{:?}", file.sizes)))?;

        let names: Vec<&str> = scene.bodies.iter().map(|body| body.name).collect();
        let state = file.world_state(path, scene.robots.len(), &names)?;
        for (robot, arm) in scene.robots.iter_mut().zip(&file.arms) {
            robot.qpos.copy_from_slice(&arm.qpos[..7]);
        }
        for (body, state) in scene.bodies.iter_mut().zip(&state.bodies) {
            body.pose = state.pose.cast();
        }
        Ok(Self { task, profile: file.profile, mode, scene, state })
    }

    /// Builds the world in this state.
    #[must_use]
    pub fn world(&self, parameters: &Parameters) -> World {
        let mut world = World::with_parameters(&self.scene, self.mode, parameters);
        world.set_state(&self.state);
        world
    }

    /// Returns the width of an action row.
    #[must_use]
    pub fn action_dim(&self) -> usize {
        self.mode.action_dim(self.task.task().morphology)
    }
}

/// Returns the scene of a task whose bodies have the given dimensions. The error is what was expected.
fn scene_of_size(task: TaskId, profile: Profile, sizes: &[f64]) -> Result<Scene, String> {
    let mut spec = (task.task().nominal)(profile);
    let drawn = spec.sizes.take();
    let ranges = drawn.as_ref().map_or(&[][..], |drawn| drawn.ranges);
    let is_within = |(size, (_, range)): (&f64, &(&str, scene::Range))| {
        (range.lo - SIZE_TOLERANCE..=range.hi + SIZE_TOLERANCE).contains(size)
    };
    if sizes.len() != ranges.len() || !sizes.iter().zip(ranges).all(is_within) {
        let names = ranges.iter().map(|(name, range)| format!("{name} in [{}, {}]", range.lo, range.hi));
        let names: Vec<String> = names.collect();
        return Err(if names.is_empty() { "nothing".to_owned() } else { names.join(", ") });
    }
    if let Some(drawn) = drawn {
        (drawn.apply)(sizes, &mut spec.bodies);
    }
    Ok(Scene { sizes: sizes.to_vec(), ..spec.draw(APPEARANCE_SEED) })
}

/// Checks that numbers are in a range. The error is what was expected and what was found; `mistaken` is the
/// unit, and how many of it the right one has, in which the number would be possible.
fn check_range(
    values: &[f64],
    (low, high): (f64, f64),
    unit: &str,
    mistaken: Option<(&str, f64)>,
) -> Result<(), (String, String)> {
    let is_possible = |value: f64| (low..=high).contains(&value);
    let Some(value) = values.iter().copied().find(|value| !is_possible(*value)) else { return Ok(()) };
    let hint = mistaken.filter(|(_, factor)| is_possible(value / factor));
    let hint = hint.map_or_else(String::new, |(name, _)| format!(" (in {name}?)"));
    Err((format!("numbers from {low} to {high} {unit}"), format!("{value}{hint}")))
}

impl TrajectoryFile {
    /// Returns the state of a world with `n_arms` arms and bodies of these names. `path` appears in errors.
    pub(crate) fn world_state(
        &self,
        path: &Path,
        n_arms: usize,
        names: &[&str],
    ) -> Result<WorldState, TrajectoryError> {
        let error = |key: &str, expected: &str, found| TrajectoryError::value(path, key, expected, found);
        if self.arms.len() != n_arms {
            return Err(error("arms", &format!("{n_arms}"), self.arms.len().to_string()));
        }
        for (i, arm) in self.arms.iter().enumerate() {
            arm.check()
                .map_err(|(key, expected, found)| error(&format!("arms[{i}].{key}"), &expected, found))?;
        }
        if let Some(name) = self.bodies.keys().find(|name| !names.contains(&name.as_str())) {
            return Err(error("bodies", &format!("only {}", names.join(", ")), name.clone()));
        }
        let body = |name: &&str| {
            let key = format!("bodies.{name}");
            let given = self.bodies.get(*name);
            let given = given.ok_or_else(|| error(&key, "a pose", "nothing".to_owned()))?;
            given.state().map_err(|(expected, found)| error(&key, &expected, found))
        };
        let bodies = names.iter().map(body).collect::<Result<_, _>>()?;
        Ok(WorldState { arms: self.arms.iter().map(ArmFile::state).collect(), bodies })
    }
}

impl ArmFile {
    /// Checks that positions and velocities are possible. The error is a key, what was expected and found.
    fn check(&self) -> Result<(), (String, String, String)> {
        let keyed = |key: &str, joint: usize, result: Result<(), (String, String)>| {
            result.map_err(|(expected, found)| (format!("{key}[{joint}]"), expected, found))
        };
        let [slack, finger_slack] = LIMIT_TOLERANCE;
        for (joint, value) in self.qpos.iter().enumerate() {
            let result = match panda::LOWER.get(joint).zip(panda::UPPER.get(joint)) {
                Some((low, high)) => {
                    let degrees = Some(("degrees", 1_f64.to_degrees()));
                    check_range(&[*value], (low - slack, high + slack), "rad", degrees)
                }
                None => {
                    let range = (-finger_slack, panda::FINGER_OPEN + finger_slack);
                    check_range(&[*value], range, "m", Some(("millimetres", 1000.0)))
                }
            };
            keyed("qpos", joint, result)?;
        }
        for (joint, value) in self.qvel.iter().enumerate() {
            let unit = if joint < panda::N_JOINTS { "rad/s" } else { "m/s" };
            keyed("qvel", joint, check_range(&[*value], (-MAX_SPEED, MAX_SPEED), unit, None))?;
        }
        Ok(())
    }

    fn state(&self) -> ArmState {
        ArmState { qpos: self.qpos.map(|q| q as f32), qvel: self.qvel.map(|v| v as f32) }
    }

    /// Converts a state into the numbers of a file.
    #[must_use]
    pub fn of(state: &ArmState) -> Self {
        Self { qpos: state.qpos.map(f64::from), qvel: state.qvel.map(f64::from) }
    }
}

impl BodyFile {
    /// Returns the state. The error is what was expected and what was found.
    fn state(&self) -> Result<BodyState, (String, String)> {
        let Self { pose, linear_velocity, angular_velocity } = self;
        let distances = (-MAX_DISTANCE, MAX_DISTANCE);
        check_range(&pose[..3], distances, "m for the position", Some(("millimetres", 1000.0)))?;
        check_range(linear_velocity, (-MAX_SPEED, MAX_SPEED), "m/s", None)?;
        check_range(angular_velocity, (-MAX_ANGULAR_SPEED, MAX_ANGULAR_SPEED), "rad/s", None)?;
        let [x, y, z, w, i, j, k] = *pose;
        let quaternion = Quaternion::new(w, i, j, k);
        if (quaternion.norm() - 1.0).abs() > NORM_TOLERANCE || quaternion.norm().is_nan() {
            let found = format!("one of norm {:.4}", quaternion.norm());
            return Err(("a unit quaternion (w, x, y, z) after the position".to_owned(), found));
        }
        let rotation = UnitQuaternion::from_quaternion(quaternion);
        Ok(BodyState {
            pose: Isometry3::from_parts(Translation3::new(x, y, z), rotation).cast(),
            linear_velocity: Vector3::from(*linear_velocity).cast(),
            angular_velocity: Vector3::from(*angular_velocity).cast(),
        })
    }

    /// Converts a state into the numbers of a file.
    #[must_use]
    pub fn of(state: &BodyState) -> Self {
        Self {
            pose: pose_to_array(&state.pose),
            linear_velocity: state.linear_velocity.cast().into(),
            angular_velocity: state.angular_velocity.cast().into(),
        }
    }
}

/// Returns position, then quaternion (w, x, y, z).
pub(crate) fn pose_to_array(pose: &Isometry3<f32>) -> [f64; 7] {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    [p.x, p.y, p.z, q.w, q.x, q.y, q.z].map(f64::from)
}
