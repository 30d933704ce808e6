//! DualArmLiftTray: two arms grip a tray by its short rims and lift it (spec/tasks.md §3, task 20).

use core::f64::consts::FRAC_PI_8;

use ipc_types::Morphology;

use super::common::tray::{self, HALF, HEIGHT, RIM_HALF_THICKNESS};
use super::common::{LIFT_CAMERAS, QPOS_B, bimanual, lifted, region};
use crate::expert::{Move, both_arms, grasp};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::scene::{Range, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "DualArmLiftTray-v1",
    category: Category::Lift,
    morphology: Morphology::Bimanual,
    max_steps: 122,
    demo_steps: 104.7,
    instruction: "grasp the tray with both hands and lift it up",
    paraphrases: include_str!("paraphrases/dual_arm_lift_tray.txt"),
    nominal,
    success,
    expert,
};

fn nominal() -> SceneSpec {
    let tray = tray::tray(0).with_yaw(Range::symmetric(FRAC_PI_8));
    let around_origin = region("tray", Range::symmetric(0.1), Range::symmetric(0.1));
    bimanual([QPOS_B; 2], 0.0, &LIFT_CAMERAS, vec![around_origin], vec![tray], TASK.instruction)
}

/// The tray 0.15 m above its start, in at least one hand.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let tray = scene.body_idx("tray");
    vec![lifted(scene, tray, 0.15, profile), Predicate::Held { body: tray }]
}

/// How far below the rim's top the TCPs grip, in m: deep enough to hold, and the finger tips clear of the tray's floor.
const GRIP_DEPTH: f64 = 0.012;

fn expert(scene: &Scene) -> Vec<Move> {
    let tray = scene.body("tray");
    let along = tray.pose.rotation * nalgebra::Vector3::y();
    let height = HEIGHT * tray.scale - GRIP_DEPTH;
    let rim = (HALF[1] - RIM_HALF_THICKNESS) * tray.scale;
    let grips = [0, 1].map(|arm| {
        let side = [-rim, rim][arm];
        let position = tray.pose * nalgebra::Point3::new(0.0, side, height);
        let closing = grasp::closest_closing(along, &grasp::start_closing(scene, arm));
        grasp::pose(&position.coords, &-nalgebra::Vector3::z(), &closing)
    });
    let back = |distance_m: f64| both_arms(grips.map(|tcp| grasp::retreated(&tcp, distance_m)));
    vec![
        Move::Joint(back(0.1)),
        Move::Straight(back(0.0)),
        // At once, where the benchmark closes one hand after the other: the longest plans would outlast the episode.
        Move::close(&[0, 1], 10),
        // Straight, where the benchmark moves joints: hands that hold one tray must keep their distance all the way up.
        Move::Straight(back(0.2)),
    ]
}
