//! An expert's plan, which is made of joint targets, told in other control modes (spec/env.md §7).

use ipc_types::{ControlMode, Morphology};

use crate::physics::World;
use crate::robot::control::delta_row;
use crate::robot::kinematics::{Joints, displacement, tcp};
use crate::robot::panda::N_JOINTS;

/// Most control steps in a row that go after the same row of the plan, where one cannot ask for all of it.
pub(super) const MOST_REPEATS: u32 = 4;

/// Writes the action row that a row of a plan comes to; whether it asks for all of it.
pub(super) type Teller = fn(planned: &[f32], world: &World, row: &mut [f32]) -> bool;

/// How plans are told in this mode, if they are.
pub(super) fn teller(mode: ControlMode, morphology: Morphology) -> Option<Teller> {
    match (mode, morphology) {
        (ControlMode::JointPos, _) => Some(repeat),
        (ControlMode::EeDeltaPose, Morphology::Single) => Some(follow),
        (ControlMode::EeDeltaPose, Morphology::Bimanual) | (ControlMode::EePose, _) => None,
    }
}

fn repeat(planned: &[f32], _: &World, row: &mut [f32]) -> bool {
    row.copy_from_slice(planned);
    true
}

/// From where the TCP is to where the planned joints would have it.
fn follow(planned: &[f32], world: &World, row: &mut [f32]) -> bool {
    let joints = |numbers: &[f32]| Joints::from_fn(|joint, _| f64::from(numbers[joint]));
    let way = displacement(&tcp(&joints(&world.qpos(0))), &tcp(&joints(planned)));
    row[N_JOINTS - 1] = planned[N_JOINTS];
    delta_row(&way, &mut row[..N_JOINTS - 1])
}
