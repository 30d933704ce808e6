//! DualArmLiftPot: two arms grasp a pot by its handles and lift it. See docs/benchmark.md, "Tasks".

use core::f64::consts::FRAC_PI_8;

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::bimanual_plan::BimanualPlan;
use super::common::kitchen::pot;
use super::common::{LIFT_CAMERAS, bimanual, lifted, region};
use crate::expert::{Move, grasp};
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmLiftPot-v1",
    category: Category::Lift,
    morphology: Morphology::Bimanual,
    max_steps: 125,
    demo_steps: 98.1,
    instruction: "grasp the pot with both hands and lift it up",
    lerobot_instruction: "Lift the pot with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_lift_pot.txt"),
    nominal,
    success,
    expert,
};

fn nominal(_profile: Profile) -> SceneSpec {
    let pot = pot::pot(0, pot::UNPAINTED).with_yaw(Range::symmetric(FRAC_PI_8));
    let around_origin = region("pot", Range::symmetric(0.1), Range::symmetric(0.1));
    bimanual(pot::QPOS, 0.0, &LIFT_CAMERAS, vec![around_origin], vec![pot], TASK.instruction)
}

/// Requires the pot to be 0.15 m above its start, from which it first drops onto the table.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    vec![lifted(scene, scene.body_idx("pot"), 0.15, profile)]
}

/// Candidate rotations of a hand about the vertical at its bar, in rad.
const LEANS: [f64; 7] = [0.0, 0.3, -0.3, 0.6, -0.6, 0.9, -0.9];

fn expert(scene: &Scene) -> Vec<Move> {
    let raised = |tcp: &Isometry3<f64>| grasp::translated(tcp, &(Vector3::z() * 0.2));
    let level = pot::grasps(scene);
    let grasps = [0, 1].map(|arm| {
        let candidates = LEANS.map(|lean| grasp::tilted_toward_base(scene, arm, &level[arm], lean));
        grasp::first_reachable(scene, arm, &candidates, |tcp| [pot::pre_grasp(tcp), *tcp, raised(tcp)])
    });
    BimanualPlan::new(scene)
        .joint(grasps.each_ref().map(pot::pre_grasp))
        .screw(grasps)
        .close(0, 10)
        .close(1, 10)
        .joint(grasps.each_ref().map(raised))
        .into_moves()
}
