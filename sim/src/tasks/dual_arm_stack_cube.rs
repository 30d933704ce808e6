//! DualArmStackCube: one arm puts the red cube on the goal and the other the green cube on top. See
//! docs/benchmark.md, "Tasks".

use ipc_types::Morphology;

use super::common::stacking;
use super::common::{QPOS_B, bimanual, region};
use crate::expert::Move;
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmStackCube-v1",
    category: Category::LongHorizon,
    morphology: Morphology::Bimanual,
    max_steps: 166,
    demo_steps: 137.0,
    instruction: "use both hands to stack one cube on top of another",
    lerobot_instruction: "Stack cubes with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_stack_cube.txt"),
    nominal,
    success,
    expert,
};

fn nominal(_profile: Profile) -> SceneSpec {
    let regions = vec![
        region("red cube", Range::new(-0.05, 0.15), Range::new(-0.2, -0.1)),
        region("green cube", Range::new(-0.05, 0.05), Range::new(0.1, 0.2)),
        region("goal", Range::symmetric(0.05), Range::fixed(0.0)).not_widened(),
    ];
    let bodies = vec![
        stacking::cube("red cube", [1.0, 0.0, 0.0], 0),
        stacking::cube("green cube", [0.0, 1.0, 0.0], 1),
        stacking::goal(2),
    ];
    bimanual([QPOS_B; 2], 0.0, &stacking::CAMERAS, regions, bodies, TASK.instruction)
}

/// Requires the green cube on the red one, and the red one on the goal.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let [red, green, goal] = ["red cube", "green cube", "goal"].map(|name| scene.body_idx(name));
    vec![stacking::on(scene, profile, green, red), stacking::on_goal(red, goal)]
}

fn expert(scene: &Scene) -> Vec<Move> {
    stacking::stack_two(scene, scene.body("red cube"), scene.body("green cube")).0
}
