//! What the weight-free policies read from a state vector (spec/env.md §6): joints and grippers.

use ipc_types::{ControlMode, Morphology};

/// Joints of an arm.
pub const N_JOINTS: usize = 7;
/// Finger positions that the gripper commands −1 and +1 ask for, in m (spec/env.md §5.1).
const FINGER_RANGE_M: [f32; 2] = [-0.01, 0.04];

/// The measured joints of a robot.
#[derive(Clone, Copy, Debug)]
pub struct RobotState<'a> {
    state: &'a [f32],
    morphology: Morphology,
}

impl<'a> RobotState<'a> {
    /// Reads a state vector `[state_dim] f32`.
    ///
    /// # Panics
    /// If it has another width than the robot's.
    #[must_use]
    pub fn new(state: &'a [f32], morphology: Morphology) -> Self {
        assert_eq!(state.len(), morphology.state_dim(), "state of a {} robot", morphology.name());
        Self { state, morphology }
    }

    /// Position of joint `joint` (fingers are 7 and 8) of arm `arm`: the arms of a bimanual robot alternate.
    #[must_use]
    pub fn joint(&self, arm: usize, joint: usize) -> f32 {
        self.state[joint * self.morphology.n_arms() + arm]
    }

    /// The gripper command in [−1, 1] that keeps the fingers of arm `arm` where they are.
    #[must_use]
    pub fn gripper_command(&self, arm: usize) -> f32 {
        let finger_m = 0.5 * (self.joint(arm, N_JOINTS) + self.joint(arm, N_JOINTS + 1));
        let [low, high] = FINGER_RANGE_M;
        (2.0 * (finger_m - low) / (high - low) - 1.0).clamp(-1.0, 1.0)
    }

    /// Writes the action row that keeps the robot where it is; `false` if this control mode needs to know more than the
    /// state vector says.
    pub fn hold(&self, control_mode: ControlMode, row: &mut [f32]) -> bool {
        let n_arms = self.morphology.n_arms();
        for (arm, action) in row.chunks_exact_mut(row.len() / n_arms).enumerate() {
            let (gripper, pose) = action.split_last_mut().expect("an action row has a gripper entry");
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
