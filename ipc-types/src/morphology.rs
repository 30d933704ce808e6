//! The two robot morphologies of the benchmark and the control modes a policy may drive them in.
//!
//! Axes used in shapes throughout: `n_envs` envs, `horizon` rows of an action chunk, `action_dim`, `state_dim`.

use serde::{Deserialize, Serialize};

/// One Franka Panda at a table, or two facing each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Morphology {
    /// One arm, three cameras (two external, one at the hand).
    Single,
    /// Two arms, four cameras (two external, one at each hand).
    Bimanual,
}

impl Morphology {
    /// Both morphologies, in the order of their wire codes.
    pub const ALL: [Self; 2] = [Self::Single, Self::Bimanual];

    /// Number of arms: 1 or 2.
    #[must_use]
    pub const fn n_arms(self) -> usize {
        match self {
            Self::Single => 1,
            Self::Bimanual => 2,
        }
    }

    /// Cameras whose images are 224×224: always the two external ones.
    #[must_use]
    pub const fn n_external_cameras(self) -> usize {
        2
    }

    /// Cameras whose images are 128×128: one at each hand.
    #[must_use]
    pub const fn n_hand_cameras(self) -> usize {
        self.n_arms()
    }

    /// Width of the state vector: 25 (qpos 9, qvel 9, TCP pose 7) or 64 (qpos 18, qvel 18, four poses of 7).
    /// Poses are position then quaternion (w, x, y, z), in the world frame.
    #[must_use]
    pub const fn state_dim(self) -> usize {
        match self {
            Self::Single => 25,
            Self::Bimanual => 64,
        }
    }

    /// Names of the cameras, in the order of their images: external, then hand (spec/env.md §4).
    #[must_use]
    pub const fn camera_names(self) -> &'static [&'static str] {
        match self {
            Self::Single => &["external1_camera", "external2_camera", "hand_camera"],
            Self::Bimanual => {
                &["external1_camera", "external2_camera", "panda1_hand_camera", "panda2_hand_camera"]
            }
        }
    }

    /// Parts of the state vector, in its order: name and width (spec/env.md §6).
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

    /// Control mode of the benchmark's policies for this morphology.
    #[must_use]
    pub const fn default_control_mode(self) -> ControlMode {
        match self {
            Self::Single => ControlMode::EeDeltaPose,
            Self::Bimanual => ControlMode::JointPos,
        }
    }

    /// How a run's policies drive it, in which single-arm policies drive in `single_arm`: two arms always by absolute joints.
    #[must_use]
    pub const fn control_mode(self, single_arm: ControlMode) -> ControlMode {
        match self {
            Self::Single => single_arm,
            Self::Bimanual => self.default_control_mode(),
        }
    }

    /// Code on the wire: 0 or 1.
    #[must_use]
    pub const fn code(self) -> u32 {
        self as u32
    }

    /// The morphology of a wire code.
    #[must_use]
    pub const fn from_code(code: u32) -> Option<Self> {
        match code {
            0 => Some(Self::Single),
            1 => Some(Self::Bimanual),
            _ => None,
        }
    }

    /// Name in tables and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::Bimanual => "bimanual",
        }
    }
}

/// How an action row is read. The gripper entry is always in [−1, 1]: −1 is −0.01 m (squeeze), +1 is 0.04 m per finger.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlMode {
    /// Per arm 7 numbers in [−1, 1]: translation (×0.1 m), rotation vector (×−0.1 rad), gripper; relative to the measured
    /// TCP pose, in the root frame of the arm (spec/env.md §5.1).
    EeDeltaPose,
    /// Per arm 8 numbers: seven absolute joint positions in rad, gripper.
    JointPos,
    /// Per arm 7 numbers: TCP position in m, intrinsic XYZ Euler angles in rad, both in the root frame; gripper.
    EePose,
}

impl ControlMode {
    /// All modes, in the order of their wire codes.
    pub const ALL: [Self; 3] = [Self::EeDeltaPose, Self::JointPos, Self::EePose];

    /// Numbers in an action row for a robot of this morphology.
    #[must_use]
    pub const fn action_dim(self, morphology: Morphology) -> usize {
        let per_arm = match self {
            Self::EeDeltaPose | Self::EePose => 7,
            Self::JointPos => 8,
        };
        per_arm * morphology.n_arms()
    }

    /// Code on the wire: 0, 1 or 2.
    #[must_use]
    pub const fn code(self) -> u32 {
        self as u32
    }

    /// The mode of a wire code.
    #[must_use]
    pub const fn from_code(code: u32) -> Option<Self> {
        match code {
            0 => Some(Self::EeDeltaPose),
            1 => Some(Self::JointPos),
            2 => Some(Self::EePose),
            _ => None,
        }
    }

    /// Name in sweep files, as ManiSkill spells it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::EeDeltaPose => "pd_ee_delta_pose",
            Self::JointPos => "pd_joint_pos",
            Self::EePose => "pd_ee_pose",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::MAX_ACTION_DIM;

    #[test]
    fn codes_name_what_they_came_from_and_nothing_else() {
        for (code, morphology) in (0..).zip(Morphology::ALL) {
            assert_eq!((morphology.code(), Morphology::from_code(code)), (code, Some(morphology)));
        }
        for (code, mode) in (0..).zip(ControlMode::ALL) {
            assert_eq!((mode.code(), ControlMode::from_code(code)), (code, Some(mode)));
        }
        assert_eq!((Morphology::from_code(2), ControlMode::from_code(3)), (None, None));
    }

    #[test]
    fn cameras_and_state_parts_are_as_many_and_as_wide_as_the_layout_says() {
        for morphology in Morphology::ALL {
            let n_cameras = morphology.n_external_cameras() + morphology.n_hand_cameras();
            assert_eq!(morphology.camera_names().len(), n_cameras);
            let width: usize = morphology.state_parts().iter().map(|(_, width)| width).sum();
            assert_eq!(width, morphology.state_dim());
        }
    }

    #[test]
    fn action_rows_have_the_widths_of_the_benchmark() {
        let widths =
            Morphology::ALL.map(|morphology| ControlMode::ALL.map(|mode| mode.action_dim(morphology)));
        assert_eq!(widths, [[7, 8, 7], [14, 16, 14]]);
        assert!(widths.as_flattened().iter().all(|&width| width <= MAX_ACTION_DIM));
    }
}
