//! The JSON format of trajectories (docs/trajectories.md).

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use run_config::input;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::Profile;
use scene::robot::panda::N_DOFS;

/// Errors that can occur while reading a trajectory.
#[derive(Debug, Error)]
pub enum TrajectoryError {
    /// The file cannot be read.
    #[error("failed to read {}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Reason.
        source: io::Error,
    },
    /// The file is not JSON of the expected structure.
    #[error("{} is not a trajectory (docs/trajectories.md describes the format)", path.display())]
    Format {
        /// Path of the file.
        path: PathBuf,
        /// Position and reason.
        source: serde_json::Error,
    },
    /// A value does not fit the task.
    #[error("{}: {key}: expected {expected}, found {found}", path.display())]
    Value {
        /// Path of the file.
        path: PathBuf,
        /// Key whose value is wrong.
        key: String,
        /// Expected value or type.
        expected: String,
        /// Found value or type.
        found: String,
    },
}

impl TrajectoryError {
    /// Describes a value that does not fit the task.
    pub(crate) fn value(path: &Path, key: &str, expected: &str, found: String) -> Self {
        Self::Value { path: path.into(), key: key.to_owned(), expected: expected.to_owned(), found }
    }
}

/// A start state, with the actions that follow and the motion that another simulator recorded for them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryFile {
    /// Name of the task, or the id of its environment in the benchmark.
    pub task: String,
    /// Control mode of the actions.
    pub control_mode: String,
    /// Reading of the benchmark by which success is determined.
    #[serde(default)]
    pub profile: Profile,
    /// Sampled dimensions of the task's bodies, in the order and unit of the task's definition.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sizes: Vec<f64>,
    /// State of each arm.
    pub arms: Vec<ArmFile>,
    /// State of each body, by name.
    pub bodies: BTreeMap<String, BodyFile>,
    /// Action rows, `[n_steps, action_dim]`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub actions: Vec<Vec<f64>>,
    /// The motion that another simulator recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded: Option<RecordedFile>,
}

/// State of an arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmFile {
    /// Positions of joints 1 to 7 (rad) and of both fingers (m).
    pub qpos: [f64; N_DOFS],
    /// Velocities of joints 1 to 7 (rad/s) and of both fingers (m/s).
    #[serde(default)]
    pub qvel: [f64; N_DOFS],
}

/// State of a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyFile {
    /// World position (m) and orientation as a unit quaternion (w, x, y, z) of the body's frame.
    pub pose: [f64; 7],
    /// World velocity of the centre of mass, in m/s.
    #[serde(default)]
    pub linear_velocity: [f64; 3],
    /// World angular velocity, in rad/s.
    #[serde(default)]
    pub angular_velocity: [f64; 3],
}

/// A recorded motion of `n_steps` actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedFile {
    /// Simulator and recording, in words.
    pub source: String,
    /// Number of the first step after which the task had succeeded, from 1; `null` if it never had.
    pub first_success_step: Option<u32>,
    /// `true` if the task had succeeded after the last step, `None` if that was not recorded.
    #[serde(default)]
    pub success_at_end: Option<bool>,
    /// Joint positions of each arm after each step, `[n_steps, n_arms, 9]`, in rad and m.
    pub qpos: Vec<Vec<[f64; N_DOFS]>>,
    /// Position of each arm's TCP after each step, `[n_steps, n_arms, 3]`, in m.
    pub tcp: Vec<Vec<[f64; 3]>>,
    /// Poses of bodies after the last step, as in [`BodyFile::pose`].
    pub bodies_at_end: BTreeMap<String, [f64; 7]>,
}

impl TrajectoryFile {
    /// Reads a file. The values are checked by [`super::Start::resolve`].
    ///
    /// # Errors
    /// If the file cannot be read or has another structure.
    pub fn read(path: &Path) -> Result<Self, TrajectoryError> {
        read_json(path)
    }
}

/// Reads the action rows of a file, `[n_steps, action_dim]`: a trajectory, or any JSON object with the key
/// `actions`.
///
/// # Errors
/// If the file cannot be read, has no actions, or a row has another length than `action_dim`.
pub fn read_actions(path: &Path, action_dim: usize) -> Result<Vec<f32>, TrajectoryError> {
    #[derive(Deserialize)]
    struct ActionsFile {
        actions: Vec<Vec<f64>>,
    }
    let ActionsFile { actions } = read_json(path)?;
    let error = |key: String, expected: String, found| TrajectoryError::value(path, &key, &expected, found);
    if actions.is_empty() {
        return Err(error("actions".to_owned(), "at least one row".to_owned(), "none".to_owned()));
    }
    for (i, row) in actions.iter().enumerate() {
        if row.len() != action_dim {
            let expected = format!("{action_dim} numbers");
            return Err(error(format!("actions[{i}]"), expected, format!("{}", row.len())));
        }
        if let Some(value) = row.iter().find(|value| !(**value as f32).is_finite()) {
            return Err(error(format!("actions[{i}]"), "32-bit numbers".to_owned(), value.to_string()));
        }
    }
    Ok(actions.into_iter().flatten().map(|value| value as f32).collect())
}

fn read_json<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<T, TrajectoryError> {
    let text =
        input::read_to_string(path).map_err(|source| TrajectoryError::Read { path: path.into(), source })?;
    serde_json::from_str(&text).map_err(|source| TrajectoryError::Format { path: path.into(), source })
}
