//! DualArmDrawerOpen: two arms pull two drawers of one chest open (spec/tasks.md §3, task 26).

use ipc_types::Morphology;
use nalgebra::Isometry3;

use super::common::bimanual;
use super::common::drawer_unit::{DRAWERS, CAMERAS, Pull, TRAVEL, bodies, place};
use crate::expert::{Move, both_arms, grasp};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::scene::{Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "DualArmDrawerOpen-v1",
    category: Category::Articulated,
    morphology: Morphology::Bimanual,
    max_steps: 118,
    demo_steps: 81.0,
    instruction: "use both hands to grasp and pull the drawer open",
    paraphrases: include_str!("paraphrases/dual_arm_drawer_open.txt"),
    nominal,
    success,
    expert,
};

/// Both hands before the chest, one above the other.
const QPOS: [[f64; 7]; 2] = [
    [1.683, 0.284, -0.103, -1.529, -1.497, 1.409, -2.106],
    [1.357, 0.393, 0.249, -2.074, 1.647, 1.758, -0.114],
];
/// The drawer that each arm pulls.
const PULLED: [&str; 2] = [DRAWERS[0], DRAWERS[2]];

fn nominal() -> SceneSpec {
    bimanual(QPOS, 0.0, &CAMERAS, vec![place()], bodies(), TASK.instruction)
}

/// Both drawers open by a fifth. The released code measures the second one by the limits of the middle drawer; here all
/// have the same, and the profiles agree.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    PULLED.map(|name| Predicate::Opened { body: scene.body_idx(name), min_position: 0.2 * TRAVEL }).into()
}

/// How far the drawers are pulled, in m: not against their stops.
const PULL: f64 = 0.18;

fn expert(scene: &Scene) -> Vec<Move> {
    let pulls = [0, 1].map(|arm| {
        let drawer = scene.body(PULLED[arm]);
        Pull::new(scene, arm, drawer, PULL, &grasp::start_closing(scene, arm))
    });
    let to = |station: fn(&Pull) -> Isometry3<f64>| Move::Straight(both_arms(pulls.each_ref().map(station)));
    vec![
        // Straight, where the benchmark moves joints: these may end where no straight way leads to the bar.
        to(|pull| pull.before),
        to(|pull| pull.at),
        Move::close(&[0], 6),
        Move::close(&[1], 6),
        to(|pull| pull.open),
    ]
}
