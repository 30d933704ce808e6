//! Conversion of expert plans, which consist of joint targets, to the action rows of other control modes
//! (docs/benchmark.md, "Robot and control").

use ipc_types::{ControlMode, Morphology};

use crate::physics::World;
use crate::robot::control::delta_row;
use scene::robot::kinematics::{Joints, displacement, tcp};
use scene::robot::panda::N_JOINTS;

/// Maximum number of consecutive control steps spent on the same row of the plan, in modes whose actions are
/// bounded.
pub(crate) const MAX_REPEATS: u32 = 4;

/// Converts a row of a plan to an action row, given the current world. Returns `true` if the action commands
/// the full motion to the planned joint positions, `false` if it was clamped.
pub(crate) type Converter = fn(planned: &[f32], world: &World, row: &mut [f32]) -> bool;

/// Returns the converter for a control mode, or `None` if plans cannot be converted to it.
pub(crate) fn converter(mode: ControlMode, morphology: Morphology) -> Option<Converter> {
    match (mode, morphology) {
        (ControlMode::JointPos, _) => Some(copy_joint_targets),
        (ControlMode::EeDeltaPose, Morphology::Single) => Some(to_ee_delta),
        (ControlMode::EeDeltaPose, Morphology::Bimanual) | (ControlMode::EePose, _) => None,
    }
}

fn copy_joint_targets(planned: &[f32], _: &World, row: &mut [f32]) -> bool {
    row.copy_from_slice(planned);
    true
}

/// Commands the displacement from the current TCP pose to the TCP pose at the planned joint positions.
fn to_ee_delta(planned: &[f32], world: &World, row: &mut [f32]) -> bool {
    let joints = |qpos: &[f32]| Joints::from_fn(|joint, _| f64::from(qpos[joint]));
    let delta = displacement(&tcp(&joints(&world.qpos(0))), &tcp(&joints(planned)));
    row[N_JOINTS - 1] = planned[N_JOINTS];
    delta_row(&delta, &mut row[..N_JOINTS - 1])
}
