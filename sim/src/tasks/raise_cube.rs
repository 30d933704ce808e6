//! RaiseCube: grasp a cube and lift it. See docs/benchmark.md, "Tasks".

use ipc_types::Morphology;

use super::common::{
    self, BLUE, ExternalCameras, QPOS_D, QPOS_NOISE_RAD, SINGLE_TABLE_Z, region, single_arm,
};
use crate::expert::{Move, grasp};
use crate::predicate::Predicate;
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "RaiseCube-v1",
    category: Category::Pick,
    morphology: Morphology::Single,
    max_steps: 92,
    demo_steps: 78.3,
    instruction: "lift the cube up to a certain height",
    lerobot_instruction: "Raise the cube up from the table",
    paraphrases: include_str!("paraphrases/raise_cube.txt"),
    nominal,
    success,
    expert,
};

/// Half-extent of the cube, in m.
const HALF: f64 = 0.02;

fn nominal(_profile: Profile) -> SceneSpec {
    let cube = common::cube("cube", HALF, BLUE, 0, SINGLE_TABLE_Z);
    let target = [-0.1, 0.0, 0.1];
    let cameras =
        ExternalCameras { external1: [[0.2, -0.3, 0.3], target], external2: [[0.1, 0.3, 0.3], target] };
    let around_origin = region("cube", Range::symmetric(0.1), Range::symmetric(0.1));
    single_arm(QPOS_D, QPOS_NOISE_RAD, &cameras, vec![around_origin], vec![cube], TASK.instruction)
}

/// Requires the cube's centre to be above 0.20 m (0.18 m above its resting height) and the arm to be at rest.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let cube = scene.body_idx("cube");
    let rest_z = if profile.scales_thresholds() { scene.bodies[cube].pose.translation.z } else { HALF };
    vec![Predicate::Above { body: cube, z_m: rest_z + 0.18 }, Predicate::RobotAtRest { max_qvel: 0.2 }]
}

/// Distance of the first waypoint above the grasp, in m.
const APPROACH: f64 = 0.05;
/// Height by which the cube is lifted in m: the benchmark's goal and a margin above that waypoint.
const LIFT: f64 = APPROACH + 0.2 + 0.025;

fn expert(scene: &Scene) -> Vec<Move> {
    let (cube, closing) = (scene.body("cube"), grasp::start_closing(scene, 0));
    let tcp = grasp::at_origin(cube, &grasp::top_down(cube, &closing, &closing));
    vec![
        Move::straight(0, grasp::retreated(&tcp, APPROACH)),
        Move::straight(0, tcp),
        Move::close(&[0], 6),
        Move::straight(0, grasp::retreated(&tcp, LIFT)),
    ]
}
