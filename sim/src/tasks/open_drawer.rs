//! OpenDrawer: pull a drawer open by its handle. See docs/benchmark.md, "Tasks".

use core::f64::consts::FRAC_PI_8;

use ipc_types::Morphology;
use nalgebra::Vector3;

use super::common::furniture::cabinet::{DRAWER_TRAVEL, ORIGIN_Z, drawer_grasp, drawer_over_door};
use super::common::{ExternalCameras, QPOS_NOISE_RAD, region, single_arm};
use crate::expert::{Move, grasp};
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{Range, Scene, SceneSpec, TableKind};

pub(crate) const TASK: Task = Task {
    env_id: "OpenDrawer-v1",
    category: Category::Articulated,
    morphology: Morphology::Single,
    max_steps: 132,
    demo_steps: 118.4,
    instruction: "grasp the handle and pull the drawer open",
    lerobot_instruction: "Open the drawer",
    paraphrases: include_str!("paraphrases/open_drawer.txt"),
    nominal,
    success,
    expert,
};

/// Initial joint positions in rad: the hand in front of the cabinet, the fingers above and below the handle.
const QPOS: [f64; 7] = [-0.1360, -1.2611, 0.2409, -2.9000, 2.5729, 3.0260, 0.0299];

fn nominal(_profile: Profile) -> SceneSpec {
    let bodies = drawer_over_door(Range::new(0.0, FRAC_PI_8));
    let target = [-0.2, 0.0, 0.5];
    let cameras =
        ExternalCameras { external1: [[-0.3, 0.4, 0.8], target], external2: [[-0.4, -0.4, 0.8], target] };
    let placement = region("cabinet", Range::new(0.15, 0.25), Range::symmetric(0.05));
    let mut spec = single_arm(QPOS, QPOS_NOISE_RAD, &cameras, vec![placement], bodies, TASK.instruction);
    spec.table.kind = TableKind::SingleArmTurned;
    spec.distractors.drop_m = (0.25 + ORIGIN_Z, None);
    spec
}

/// Requires the drawer to be half open and to move slowly.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let drawer = scene.body_idx("drawer");
    vec![
        Predicate::Opened { body: drawer, min_position: 0.5 * DRAWER_TRAVEL },
        Predicate::AtRest { body: drawer, max_linear: 0.1, max_angular: 1.0 },
    ]
}

/// Distance by which the drawer is pulled, in m.
const PULL_DISTANCE: f64 = 0.2;

fn expert(scene: &Scene) -> Vec<Move> {
    let tcp = drawer_grasp(scene);
    let out = scene.body("drawer").pose.rotation * Vector3::x();
    vec![
        Move::open(&[0], 6),
        Move::straight(0, grasp::retreated(&tcp, 0.05)),
        Move::open(&[0], 6),
        Move::straight(0, tcp),
        Move::close(&[0], 6),
        Move::straight(0, grasp::translated(&tcp, &(out * PULL_DISTANCE))),
        Move::open(&[0], 6),
    ]
}
