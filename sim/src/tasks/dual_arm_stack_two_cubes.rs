//! DualArmStackTwoCubes: two arms build a tower of three cubes on the goal. See docs/benchmark.md, "Tasks".

use ipc_types::Morphology;

use super::common::stacking::{self, CubeTransfer};
use super::common::{QPOS_B, bimanual, region};
use crate::expert::Move;
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::scene::{Range, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "DualArmStack3Cube-v1",
    category: Category::LongHorizon,
    morphology: Morphology::Bimanual,
    max_steps: 284,
    demo_steps: 242.1,
    instruction: "use both hands to stack three cubes into a tower",
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

/// Heights of the TCP above the goal disc at which the three cubes are released, in m.
const RELEASE_HEIGHTS: [f64; 3] = [0.05, stacking::RELEASE_HEIGHT, 0.16];

fn expert(scene: &Scene) -> Vec<Move> {
    let [first, second, third] = [0, 1, 2].map(|i| {
        let arm = [0, 1, 0][i];
        CubeTransfer::new(scene, arm, scene.body(CUBES[i]), RELEASE_HEIGHTS[i])
    });
    stacking::stack_two(scene, &first, &second)
        .open(1, 10)
        .screw_one(1, stacking::parked(1))
        .screw_one(0, third.above)
        .screw_one(0, third.grasp)
        .close(0, 10)
        .screw_one(0, third.release)
        .open(0, 10)
        .into_moves()
}
