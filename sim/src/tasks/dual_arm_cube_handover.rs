//! DualArmCubeHandover: one arm picks up a cube and hands it to the other (spec/tasks.md §3, task 17).

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::{self, BIMANUAL_TABLE_Z, BLUE, ExternalCameras, QPOS_B, bimanual, region};
use crate::expert::{Move, both_arms, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::scene::{Range, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "DualArmPickCube-v1",
    category: Category::Handover,
    morphology: Morphology::Bimanual,
    max_steps: 213,
    demo_steps: 201.1,
    instruction: "use both arms to pick up the cube",
    paraphrases: include_str!("paraphrases/dual_arm_cube_handover.txt"),
    nominal,
    success,
    expert,
};

const HALF: f64 = 0.02;

fn nominal() -> SceneSpec {
    let cube = common::cube("cube", HALF, BLUE, 0, BIMANUAL_TABLE_Z);
    let cameras = ExternalCameras {
        external1: [[0.75, 0.0, 1.33], [-0.2, 0.0, 1.03]],
        external2: [[-0.5, 0.0, 1.58], [-0.2, 0.0, 1.13]],
    };
    let around_origin = region("cube", Range::symmetric(0.1), Range::symmetric(0.1));
    bimanual([QPOS_B; 2], 0.0, &cameras, vec![around_origin], vec![cube], TASK.instruction)
}

/// The cube in the second arm's hand.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    vec![Predicate::GraspedByNearest { body: scene.body_idx("cube"), arm: 1 }]
}

/// Where the cube changes hands, in m.
const MEETING: Vector3<f64> = Vector3::new(-0.2, 0.0, 1.2);
/// Leans of the hand that are tried, in rad, and those that are tried last.
const LEANS: [f64; 3] = [0.0, 0.3, 0.6];
const FAR_LEANS: [f64; 3] = [0.8, 1.0, 1.2];

fn expert(scene: &Scene) -> Vec<Move> {
    let closing = grasp::start_closing(scene, 0);
    let upright = [Vector3::x(), Vector3::y()]
        .map(|preferred| grasp::top_down(scene.body("cube"), &preferred, &closing));
    let leant = |leans: &'static [f64]| {
        upright.iter().flat_map(|tcp| leans.iter().map(|lean| grasp::tilted_toward_base(scene, 0, tcp, *lean)))
    };
    let ways = [0, 1].map(|arm| nearer_way(scene, arm));
    let near: Vec<Isometry3<f64>> = leant(&LEANS).collect();
    let first = grasp::first_reachable(scene, 0, &near, |tcp| stations(tcp, ways[0]));
    let others =
        leant(&LEANS).chain(leant(&FAR_LEANS)).flat_map(|tcp| [ways[0], -ways[0]].map(|way| (tcp, way)));
    let grips = core::iter::once((first, ways[0])).chain(others);
    first_feasible(scene, TASK.max_steps, grips.map(|(tcp, way)| handed_over(&tcp, [way, ways[1]])))
}

/// The hands meet along y; the first one closes along x, the second one along z, past its fingers.
fn meeting(arm: usize, way: f64) -> Isometry3<f64> {
    let approach = Vector3::y() * [1.0, -1.0][arm];
    grasp::pose(&MEETING, &approach, &([Vector3::x(), Vector3::z()][arm] * way))
}

/// The way round of a hand at the meeting, 1 or −1, that is nearer to how it starts.
fn nearer_way(scene: &Scene, arm: usize) -> f64 {
    let start = grasp::start_tcp(scene, arm);
    let nearer = |way: &f64| (meeting(arm, *way).rotation.inverse() * start.rotation).angle();
    [1.0, -1.0].into_iter().min_by(|a, b| nearer(a).total_cmp(&nearer(b))).unwrap_or(1.0)
}

/// Where the first TCP goes: above the cube, around it, up, before the meeting and there.
fn stations(tcp: &Isometry3<f64>, way: f64) -> [Isometry3<f64>; 5] {
    let raised = grasp::translated(tcp, &(Vector3::z() * 0.15));
    let there = meeting(0, way);
    [grasp::retreated(tcp, 0.1), *tcp, raised, grasp::retreated(&there, 0.06), there]
}

/// Takes the cube and hands it over, each hand this way round.
fn handed_over(tcp: &Isometry3<f64>, [way, other_way]: [f64; 2]) -> Vec<Move> {
    let [above, at, raised, before, there] = stations(tcp, way);
    let other = meeting(1, other_way);
    vec![
        Move::straight(0, above),
        Move::straight(0, at),
        Move::close(&[0], 10),
        Move::straight(0, raised),
        Move::Joint(both_arms([before, grasp::retreated(&other, 0.12)])),
        Move::Straight(both_arms([there, other])),
        Move::close(&[1], 10),
        Move::open(&[0], 10),
        Move::straight(0, grasp::retreated(&there, 0.1)),
    ]
}
