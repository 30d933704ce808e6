//! DualArmStackTwoCubes: two arms build a tower of three cubes on the goal. See docs/benchmark.md, "Tasks".

use ipc_types::Morphology;

use super::common::stacking::{self, CubeTransfer};
use super::common::{QPOS_B, bimanual, region};
use crate::expert::{Move, TcpGoal};
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmStack3Cube-v1",
    category: Category::LongHorizon,
    morphology: Morphology::Bimanual,
    max_steps: 284,
    demo_steps: 242.1,
    instruction: "use both hands to stack three cubes into a tower",
    lerobot_instruction: "Stack three cubes with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_stack_two_cubes.txt"),
    nominal,
    success,
    expert,
};

const CUBES: [&str; 3] = ["red cube", "green cube", "blue cube"];

fn nominal(_profile: Profile) -> SceneSpec {
    let near_first_arm = Range::new(-0.2, -0.1);
    let regions = vec![
        region("red cube", Range::new(0.0, 0.2), near_first_arm),
        region("green cube", Range::new(0.1, 0.2), Range::new(0.1, 0.2)),
        region("blue cube", Range::new(-0.2, 0.0), near_first_arm),
        region("goal", Range::symmetric(0.05), Range::fixed(0.0)).not_widened(),
    ];
    let colors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let cubes = CUBES.into_iter().zip(colors).enumerate();
    let mut bodies: Vec<_> = cubes.map(|(i, (name, color))| stacking::cube(name, color, i)).collect();
    bodies.push(stacking::goal(3));
    bimanual([QPOS_B; 2], 0.0, &stacking::CAMERAS, regions, bodies, TASK.instruction)
}

/// Requires green on red, blue on green, and red on the goal.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let [red, green, blue] = CUBES.map(|name| scene.body_idx(name));
    vec![
        stacking::on(scene, profile, green, red),
        stacking::on(scene, profile, blue, green),
        stacking::on_goal(red, scene.body_idx("goal")),
    ]
}

fn expert(scene: &Scene) -> Vec<Move> {
    let [red, green, blue] = CUBES.map(|name| scene.body(name));
    let third = CubeTransfer::new(scene, 0, blue, 2.0 * stacking::HALF * (red.scale.x + green.scale.x));
    let (mut moves, second) = stacking::stack_two(scene, red, green);
    moves.push(second.retreat());
    moves.push(Move::Straight(vec![TcpGoal { arm: 0, tcp: third.above }, stacking::parked(scene, 1)]));
    moves.extend([Move::straight(0, third.grasp), Move::close(&[0], 6)]);
    moves.extend([Move::Straight(vec![third.raised()]), third.carry(None)]);
    moves.extend(third.place());
    moves
}
