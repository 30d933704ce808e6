//! Joint and gripper positions in a state vector (docs/benchmark.md, "Observations"), for the weight-free
//! policies.

use ipc_types::{ControlMode, Morphology};

/// Number of joints of an arm, fingers excluded.
pub const N_JOINTS: usize = 7;
/// Finger positions of the gripper commands −1 and +1, in m (docs/benchmark.md, "Robot and control").
const FINGER_RANGE_M: [f32; 2] = [-0.01, 0.04];

/// View of the joint positions in a state vector.
#[derive(Clone, Copy, Debug)]
pub struct RobotState<'a> {
    state: &'a [f32],
    morphology: Morphology,
}

impl<'a> RobotState<'a> {
    /// Creates a view of a state vector `[state_dim] f32`.
    ///
    /// # Panics
    /// If the length does not match the robot.
    #[must_use]
    pub fn new(state: &'a [f32], morphology: Morphology) -> Self {
        assert_eq!(state.len(), morphology.state_dim(), "state of a {} robot", morphology.name());
        Self { state, morphology }
    }

    /// Returns the position of joint `joint` of arm `arm`, in rad, or in m for the fingers (7 and 8). The
    /// state of a bimanual robot interleaves the two arms.
    #[must_use]
    pub fn joint(&self, arm: usize, joint: usize) -> f32 {
        self.state[joint * self.morphology.n_arms() + arm]
    }

    /// Returns the gripper command in [−1, 1] that keeps the fingers of arm `arm` at their current position.
    #[must_use]
    pub fn gripper_command(&self, arm: usize) -> f32 {
        let finger_m = 0.5 * (self.joint(arm, N_JOINTS) + self.joint(arm, N_JOINTS + 1));
        let [low, high] = FINGER_RANGE_M;
        (2.0 * (finger_m - low) / (high - low) - 1.0).clamp(-1.0, 1.0)
    }

    /// Writes the action that keeps the robot at its current position. Returns `false` if the control mode
    /// needs information that the state vector lacks.
    pub fn write_hold(&self, control_mode: ControlMode, row: &mut [f32]) -> bool {
        let n_arms = self.morphology.n_arms();
        for (arm, action) in row.chunks_exact_mut(row.len() / n_arms).enumerate() {
            let (gripper, pose) = action.split_last_mut().expect("an action has a gripper entry");
            *gripper = self.gripper_command(arm);
            match control_mode {
                ControlMode::EeDeltaPose => pose.fill(0.0),
                ControlMode::JointPos => {
                    pose.iter_mut().enumerate().for_each(|(joint, x)| *x = self.joint(arm, joint));
                }
                ControlMode::EePose => return false,
            }
        }
        true
    }
}
