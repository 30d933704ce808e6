//! DualArmCubeHandover: one arm picks up a cube and hands it to the other (spec/tasks.md §3, task 17).

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::{self, BIMANUAL_TABLE_Z, BLUE, Eyes, QPOS_B, bimanual, region};
use crate::expert::{Move, both, grasp};
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
    let eyes = Eyes {
        external1: [[0.75, 0.0, 1.33], [-0.2, 0.0, 1.03]],
        external2: [[-0.5, 0.0, 1.58], [-0.2, 0.0, 1.13]],
    };
    let around_origin = region("cube", Range::symmetric(0.1), Range::symmetric(0.1));
    bimanual([QPOS_B; 2], 0.0, &eyes, vec![around_origin], vec![cube], TASK.instruction)
}

/// The cube in the second arm's hand.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    vec![Predicate::Nearer { body: scene.body_idx("cube"), arm: 1 }]
}

/// Where the cube changes hands, in m.
const MEETING: Vector3<f64> = Vector3::new(-0.2, 0.0, 1.2);
/// Leans of the hand that are tried, in rad.
const LEANS: [f64; 3] = [0.0, 0.3, 0.6];

fn expert(scene: &Scene) -> Vec<Move> {
    let cube = scene.body("cube");
    // The hands meet along y; the first one closes along x, the second one along z, past its fingers.
    let meeting = |arm: usize, way: f64| {
        let approach = Vector3::y() * [1.0, -1.0][arm];
        grasp::pose(&MEETING, &approach, &([Vector3::x(), Vector3::z()][arm] * way))
    };
    let closing = grasp::start_closing(scene, 0);
    let grips: Vec<Isometry3<f64>> = [Vector3::x(), Vector3::y()]
        .iter()
        .map(|preferred| grasp::from_above(cube, preferred, &closing))
        .flat_map(|tcp| LEANS.map(|lean| grasp::leant_back(scene, 0, &tcp, lean)))
        .collect();
    let raised = |tcp: &Isometry3<f64>| grasp::shifted(tcp, &(Vector3::z() * 0.15));
    let stations = |tcp: &Isometry3<f64>, way: f64| {
        [grasp::backed_off(tcp, 0.1), *tcp, raised(tcp), grasp::backed_off(&meeting(0, way), 0.06), meeting(0, way)]
    };
    let way_of = |arm: usize| {
        let start = grasp::start_tcp(scene, arm);
        let nearer = |way: &f64| (meeting(arm, *way).rotation.inverse() * start.rotation).angle();
        [1.0, -1.0].into_iter().min_by(|a, b| nearer(a).total_cmp(&nearer(b))).unwrap_or(1.0)
    };
    let way = way_of(0);
    let tcp = grasp::first_within_reach(scene, 0, &grips, |tcp| stations(tcp, way));
    let [above, at, raised, before, there] = stations(&tcp, way);
    let other = meeting(1, way_of(1));
    vec![
        Move::straight(0, above),
        Move::straight(0, at),
        Move::close(&[0], 10),
        Move::straight(0, raised),
        Move::Joint(both([before, grasp::backed_off(&other, 0.12)])),
        Move::Straight(both([there, other])),
        Move::close(&[1], 10),
        Move::open(&[0], 10),
        Move::straight(0, grasp::backed_off(&there, 0.1)),
    ]
}
