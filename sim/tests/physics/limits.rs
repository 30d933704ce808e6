//! Joint limits: no motion, however forced, shows a policy joint positions that no robot has.

use ipc_types::{ControlMode, Morphology};
use rayon::prelude::*;
use sim::physics::World;
use sim::scene::robot::panda::{FINGER_OPEN, LOWER, N_JOINTS, UPPER};
use sim::scene::stream::Stream;
use sim::{Perturbation, TaskId};

use super::common;

/// Control steps of each motion; over all tasks and motions, more than 10,000.
const N_STEPS: u32 = 200;
/// Maximum distance of a joint beyond its limit, in rad and m.
const TOLERANCE: [f64; 2] = [5e-4, 1e-4];

/// A motion that pushes joints into their limits.
#[derive(Clone, Copy, Debug)]
enum PushingMotion {
    /// Random commands.
    Random(ControlMode),
    /// Random commands that press the arm on the table, while the gripper opens and closes.
    Press(ControlMode),
}

impl PushingMotion {
    const ALL: [Self; 4] = [
        Self::Random(ControlMode::JointPos),
        Self::Press(ControlMode::JointPos),
        Self::Random(ControlMode::EeDeltaPose),
        Self::Press(ControlMode::EeDeltaPose),
    ];

    const fn mode(self) -> ControlMode {
        let (Self::Random(mode) | Self::Press(mode)) = self;
        mode
    }

    /// Writes the command of one arm at joint positions `qpos`.
    fn write(self, row: &mut [f32], qpos: &[f32], stream: &mut Stream) {
        row.fill_with(|| (2.0 * stream.unit() - 1.0) as f32);
        let (Self::Random(mode) | Self::Press(mode)) = self;
        if mode == ControlMode::JointPos {
            for (command, q) in row.iter_mut().zip(&qpos[..N_JOINTS]) {
                *command = q + 0.5 * *command;
            }
        }
        match self {
            Self::Random(_) => {}
            Self::Press(ControlMode::JointPos) => row[1] = qpos[1] + 0.3,
            Self::Press(_) => row[2] = -0.5,
        }
    }
}

/// Returns the largest distance of an arm joint (rad) and of a finger (m) beyond a limit during a motion.
fn max_excess(task: TaskId, motion: PushingMotion) -> [f64; 2] {
    let scene = common::draw(task, Perturbation::None, 1);
    let mut world = World::build(&scene, motion.mode());
    let mut row = common::zeros(&scene, motion.mode());
    let mut stream = Stream::new(1, task.name());
    let row_len = row.len() / world.n_arms();
    let mut worst = [0.0_f64; 2];
    for _ in 0..N_STEPS {
        for (arm, row) in row.chunks_exact_mut(row_len).enumerate() {
            motion.write(row, &world.qpos(arm), &mut stream);
        }
        world.step(&row);
        for arm in 0..world.n_arms() {
            for (dof, q) in world.qpos(arm).into_iter().map(f64::from).enumerate() {
                let is_finger = dof >= N_JOINTS;
                let [min, max] = if is_finger { [0.0, FINGER_OPEN] } else { [LOWER[dof], UPPER[dof]] };
                let worst = &mut worst[usize::from(is_finger)];
                *worst = worst.max(min - q).max(q - max);
            }
        }
    }
    worst
}

#[test]
fn joints_stay_within_their_limits() {
    let cases = TaskId::ALL.iter().flat_map(|task| PushingMotion::ALL.map(|motion| (*task, motion)));
    let cases: Vec<(TaskId, PushingMotion)> = cases
        .filter(|(task, motion)| {
            task.task().morphology == Morphology::Single || motion.mode() == ControlMode::JointPos
        })
        .collect();
    assert!(cases.len() as u32 * N_STEPS > 10_000);
    cases.into_par_iter().for_each(|(task, motion)| {
        let excess = max_excess(task, motion);
        let within = excess.iter().zip(TOLERANCE).all(|(excess, tolerance)| *excess <= tolerance);
        assert!(within, "{} {motion:?}: joints {} rad, fingers {} m", task.name(), excess[0], excess[1]);
    });
}
