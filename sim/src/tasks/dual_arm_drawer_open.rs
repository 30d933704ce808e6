//! DualArmDrawerOpen: each arm pulls open one drawer of the same unit. See docs/benchmark.md, "Tasks".

use ipc_types::Morphology;
use nalgebra::Isometry3;

use super::common::bimanual;
use super::common::bimanual_plan::BimanualPlan;
use super::common::furniture::drawer_unit::{CAMERAS, DRAWERS, DrawerPull, TRAVEL, bodies, placement_region};
use crate::expert::{Move, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmDrawerOpen-v1",
    category: Category::Articulated,
    morphology: Morphology::Bimanual,
    max_steps: 118,
    demo_steps: 81.0,
    instruction: "use both hands to grasp and pull the drawer open",
    lerobot_instruction: "Open the drawer with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_drawer_open.txt"),
    nominal,
    success,
    expert,
};

/// Initial joint positions in rad: both hands in front of the unit, one above the other.
const QPOS: [[f64; 7]; 2] = [
    [1.683, 0.284, -0.103, -1.529, -1.497, 1.409, -2.106],
    [1.357, 0.393, 0.249, -2.074, 1.647, 1.758, -0.114],
];
/// Drawers that the first and the second arm pull.
const PULLED_DRAWERS: [&str; 2] = [DRAWERS[0], DRAWERS[2]];

fn nominal(_profile: Profile) -> SceneSpec {
    bimanual(QPOS, 0.0, &CAMERAS, vec![placement_region()], bodies(), TASK.instruction)
}

/// Requires both drawers to be open by a fifth of their travel. The released code measures the second drawer
/// against the limits of the middle one; here all drawers have the same limits, so the profiles agree.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    PULLED_DRAWERS
        .map(|name| Predicate::Opened { body: scene.body_idx(name), min_position: 0.2 * TRAVEL })
        .into()
}

/// Candidate lean angles of the hands in rad: head-on, they would be in each other's way.
const LEANS: [f64; 5] = [0.2, 0.4, 0.6, 0.8, 0.0];
/// Distance by which the drawers are pulled in m, short of their stops.
const PULL_DISTANCE: f64 = 0.18;

fn expert(scene: &Scene) -> Vec<Move> {
    let pulls = [0, 1].map(|arm| {
        let drawer = scene.body(PULLED_DRAWERS[arm]);
        DrawerPull::new(scene, arm, drawer, PULL_DISTANCE, &grasp::start_closing(scene, arm), LEANS)
    });
    let at = |pose: fn(&DrawerPull) -> Isometry3<f64>| pulls.each_ref().map(pose);
    let start = BimanualPlan::new(scene);
    let pre_grasp = at(|pull| pull.pre_grasp);
    // A joint-space motion may end where no straight path leads to the bar.
    let approaches = [start.clone().joint(pre_grasp), start.screw(pre_grasp)];
    let pull_open = |plan: BimanualPlan| {
        plan.screw(at(|pull| pull.grasp)).close(0, 6).close(1, 6).screw(at(|pull| pull.open)).into_moves()
    };
    first_feasible(scene, TASK.max_steps, approaches.into_iter().map(pull_open))
}
