//! DualArmLiftTray: two arms grasp a tray by its short rims and lift it. See docs/benchmark.md, "Tasks".

use core::f64::consts::FRAC_PI_8;

use ipc_types::Morphology;
use nalgebra::Vector3;

use super::common::bimanual_plan::BimanualPlan;
use super::common::kitchen::tray;
use super::common::{LIFT_CAMERAS, QPOS_B, bimanual, lifted, region};
use crate::expert::{Move, grasp};
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmLiftTray-v1",
    category: Category::Lift,
    morphology: Morphology::Bimanual,
    max_steps: 122,
    demo_steps: 104.7,
    instruction: "grasp the tray with both hands and lift it up",
    lerobot_instruction: "Lift the tray with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_lift_tray.txt"),
    nominal,
    success,
    expert,
};

fn nominal(_profile: Profile) -> SceneSpec {
    let tray = tray::tray(0).with_origin_z(0.86).with_yaw(Range::symmetric(FRAC_PI_8));
    let around_origin = region("tray", Range::symmetric(0.1), Range::symmetric(0.1));
    bimanual([QPOS_B; 2], 0.0, &LIFT_CAMERAS, vec![around_origin], vec![tray], TASK.instruction)
}

/// Requires the tray to be in at least one hand and 0.15 m above its start, from which it first drops onto
/// the table.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let tray = scene.body_idx("tray");
    vec![lifted(scene, tray, 0.15, profile), Predicate::Held { body: tray }]
}

/// Depth of the grasp below the top of the rim in m: enough for a firm grasp, with the fingertips clear of
/// the tray's floor.
const GRASP_DEPTH: f64 = 0.012;

fn expert(scene: &Scene) -> Vec<Move> {
    let tray = scene.body("tray");
    // The sign is the benchmark's, for both hands.
    let closing = -(tray.pose.rotation * Vector3::y());
    let grasps = [-tray::RIM_Y, tray::RIM_Y].map(|y| {
        let rim = tray.point([0.0, y, tray::RIM_Z]);
        grasp::pose(&(rim.coords - Vector3::z() * GRASP_DEPTH), &-Vector3::z(), &closing)
    });
    let backed_off = |distance_m: f64| grasps.map(|tcp| grasp::retreated(&tcp, distance_m));
    BimanualPlan::new(scene)
        .joint(backed_off(0.1))
        .screw(grasps)
        .close(0, 10)
        .close(1, 10)
        .joint(backed_off(0.2))
        .into_moves()
}
