//! The two robot morphologies of the benchmark and the control modes of policies.
//!
//! Shapes throughout the project use these axes: `n_envs` (envs in a batch), `horizon` (rows of an action
//! chunk), `action_dim` (width of an action row), and `state_dim` (width of a state vector).

use serde::{Deserialize, Serialize};

/// Robot set-up of a task: one Franka Panda at a table, or two facing each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Morphology {
    /// One arm and three cameras: two external, one on the hand.
    Single,
    /// Two arms and four cameras: two external, one on each hand.
    Bimanual,
}

impl Morphology {
    /// Both morphologies, in the order of their wire codes.
    pub const ALL: [Self; 2] = [Self::Single, Self::Bimanual];

    /// Returns the number of arms: 1 or 2.
    #[must_use]
    pub const fn n_arms(self) -> usize {
        match self {
            Self::Single => 1,
            Self::Bimanual => 2,
        }
    }

    /// Returns the number of external cameras, whose images are 224×224: always 2.
    #[must_use]
    pub const fn n_external_cameras(self) -> usize {
        2
    }

    /// Returns the number of hand cameras, whose images are 128×128: one per arm.
    #[must_use]
    pub const fn n_hand_cameras(self) -> usize {
        self.n_arms()
    }

    /// Returns the width of the state vector: 25 (qpos 9, qvel 9, TCP pose 7) or 64 (qpos 18, qvel 18, four
    /// poses of 7). A pose is a position in m followed by a quaternion (w, x, y, z), both in the world frame.
    #[must_use]
    pub const fn state_dim(self) -> usize {
        match self {
            Self::Single => 25,
            Self::Bimanual => 64,
        }
    }

    /// Returns the camera names in the order of their images: external, then hand (docs/benchmark.md,
    /// "Cameras").
    #[must_use]
    pub const fn camera_names(self) -> &'static [&'static str] {
        match self {
            Self::Single => &["external1_camera", "external2_camera", "hand_camera"],
            Self::Bimanual => {
                &["external1_camera", "external2_camera", "panda1_hand_camera", "panda2_hand_camera"]
            }
        }
    }

    /// Returns the parts of the state vector in order, as (name, width) pairs (docs/benchmark.md,
    /// "Observations").
    #[must_use]
    pub const fn state_parts(self) -> &'static [(&'static str, usize)] {
        match self {
            Self::Single => &[("qpos", 9), ("qvel", 9), ("tcp_pose", 7)],
            Self::Bimanual => &[
                ("qpos", 18),
                ("qvel", 18),
                ("ee1_pose", 7),
                ("ee2_pose", 7),
                ("left_arm_tcp", 7),
                ("right_arm_tcp", 7),
            ],
        }
    }

    /// Returns the control mode that the benchmark's policies use with this morphology.
    #[must_use]
    pub const fn default_control_mode(self) -> ControlMode {
        match self {
            Self::Single => ControlMode::EeDeltaPose,
            Self::Bimanual => ControlMode::JointPos,
        }
    }

    /// Returns the control mode of this morphology in a run whose single-arm policies use `single_arm`.
    /// Bimanual policies always use [`ControlMode::JointPos`].
    #[must_use]
    pub const fn control_mode(self, single_arm: ControlMode) -> ControlMode {
        match self {
            Self::Single => single_arm,
            Self::Bimanual => self.default_control_mode(),
        }
    }

    /// Returns the wire code: 0 or 1.
    #[must_use]
    pub const fn code(self) -> u32 {
        self as u32
    }

    /// Returns the morphology with wire code `code`, or `None` if there is none.
    #[must_use]
    pub const fn from_code(code: u32) -> Option<Self> {
        match code {
            0 => Some(Self::Single),
            1 => Some(Self::Bimanual),
            _ => None,
        }
    }

    /// Returns the name used in tables and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::Bimanual => "bimanual",
        }
    }
}

/// Interpretation of an action row (docs/benchmark.md, "Robot and control"). A gripper entry is in [−1, 1]
/// and maps to a target position of each finger: −1 to −0.01 m (squeeze), +1 to 0.04 m (open).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String")]
pub enum ControlMode {
    /// Seven values in [−1, 1] per arm: translation (×0.1 m), rotation vector (×−0.1 rad), gripper. Relative
    /// to the measured TCP pose, in the arm's root frame.
    #[serde(rename = "pd_ee_delta_pose")]
    EeDeltaPose,
    /// Eight values per arm: seven absolute joint positions in rad, gripper.
    #[serde(rename = "pd_joint_pos")]
    JointPos,
    /// Seven values per arm: TCP position in m and intrinsic XYZ Euler angles in rad, both in the arm's root
    /// frame, gripper.
    #[serde(rename = "pd_ee_pose")]
    EePose,
}

impl ControlMode {
    /// All control modes, in the order of their wire codes.
    pub const ALL: [Self; 3] = [Self::EeDeltaPose, Self::JointPos, Self::EePose];

    /// Returns the width of an action row for `morphology`.
    #[must_use]
    pub const fn action_dim(self, morphology: Morphology) -> usize {
        let per_arm = match self {
            Self::EeDeltaPose | Self::EePose => 7,
            Self::JointPos => 8,
        };
        per_arm * morphology.n_arms()
    }

    /// Returns the wire code: 0, 1 or 2.
    #[must_use]
    pub const fn code(self) -> u32 {
        self as u32
    }

    /// Returns the control mode with wire code `code`, or `None` if there is none.
    #[must_use]
    pub const fn from_code(code: u32) -> Option<Self> {
        match code {
            0 => Some(Self::EeDeltaPose),
            1 => Some(Self::JointPos),
            2 => Some(Self::EePose),
            _ => None,
        }
    }

    /// Returns the name used everywhere outside the program, which is ManiSkill's.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::EeDeltaPose => "pd_ee_delta_pose",
            Self::JointPos => "pd_joint_pos",
            Self::EePose => "pd_ee_pose",
        }
    }
}

impl TryFrom<String> for ControlMode {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        Self::ALL.into_iter().find(|mode| mode.name() == name).ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            format!("unknown control_mode `{name}`, expected one of {known}")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::MAX_ACTION_DIM;

    #[test]
    fn wire_codes_round_trip_and_others_are_rejected() {
        for (code, morphology) in (0..).zip(Morphology::ALL) {
            assert_eq!((morphology.code(), Morphology::from_code(code)), (code, Some(morphology)));
        }
        for (code, mode) in (0..).zip(ControlMode::ALL) {
            assert_eq!((mode.code(), ControlMode::from_code(code)), (code, Some(mode)));
        }
        assert_eq!((Morphology::from_code(2), ControlMode::from_code(3)), (None, None));
        for mode in ControlMode::ALL {
            assert_eq!(serde_json::to_value(mode).unwrap(), mode.name());
            assert_eq!(serde_json::from_value::<ControlMode>(mode.name().into()).unwrap(), mode);
        }
    }

    #[test]
    fn cameras_and_state_parts_match_their_counts() {
        for morphology in Morphology::ALL {
            let n_cameras = morphology.n_external_cameras() + morphology.n_hand_cameras();
            assert_eq!(morphology.camera_names().len(), n_cameras);
            let width: usize = morphology.state_parts().iter().map(|(_, width)| width).sum();
            assert_eq!(width, morphology.state_dim());
        }
    }

    #[test]
    fn action_rows_have_the_expected_widths() {
        let widths =
            Morphology::ALL.map(|morphology| ControlMode::ALL.map(|mode| mode.action_dim(morphology)));
        assert_eq!(widths, [[7, 8, 7], [14, 16, 14]]);
        assert!(widths.as_flattened().iter().all(|&width| width <= MAX_ACTION_DIM));
    }
}
