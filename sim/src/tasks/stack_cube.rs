//! StackCube: put the red cube on the green cube. See docs/benchmark.md, "Tasks".

use core::f64::consts::TAU;

use ipc_types::Morphology;
use nalgebra::Vector3;

use super::common::{self, ExternalCameras, QPOS_D, QPOS_NOISE_RAD, SINGLE_TABLE_Z, single_arm};
use crate::expert::{Move, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{BodySpec, Range, RegionSpec, Role, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "StackCubeColosseumV2-v1",
    category: Category::PickAndPlace,
    morphology: Morphology::Single,
    max_steps: 142,
    demo_steps: 107.1,
    instruction: "stack red cube on top of green cube",
    lerobot_instruction: "Stack one cube on top of another",
    paraphrases: include_str!("paraphrases/stack_cube.txt"),
    nominal,
    success,
    expert,
};

/// Half-extent of a cube, in m.
const HALF: f64 = 0.02;
/// Half-diagonal of a cube's face in m, as rounded in the released code.
const HALF_DIAGONAL: f64 = 0.0283;

fn nominal(_profile: Profile) -> SceneSpec {
    // As in the released code, only MO-Size affects the green cube: it scales both.
    let cube = |name, role, color| BodySpec {
        role,
        ..common::cube(name, HALF, color, 0, SINGLE_TABLE_Z).with_yaw(Range::new(0.0, TAU))
    };
    let cubes = vec![
        cube("red cube", Role::ManipulationObject, [1.0, 0.0, 0.0]),
        cube("green cube", Role::Fixture, [0.0, 1.0, 0.0]),
    ];
    let region = RegionSpec {
        min_gap_m: Some(0.002),
        ..common::region("cubes", Range::symmetric(0.1), Range::symmetric(0.2))
            .with_shared_offset([Range::symmetric(0.1); 2])
    };
    let target = [-0.1, 0.0, 0.1];
    let cameras =
        ExternalCameras { external1: [[0.3, 0.0, 0.4], target], external2: [[0.0, -0.3, 0.4], target] };
    single_arm(QPOS_D, QPOS_NOISE_RAD, &cameras, vec![region], cubes, TASK.instruction)
}

/// Requires red on green within half a face diagonal plus 5 mm horizontally, at rest and released.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let (red, green) = (scene.body_idx("red cube"), scene.body_idx("green cube"));
    let scale = |body: usize| if profile.scales_thresholds() { scene.bodies[body].scale.x } else { 1.0 };
    vec![
        Predicate::On {
            top: red,
            base: green,
            xy_m: HALF_DIAGONAL * scale(green) + 0.005,
            rise_m: HALF * (scale(red) + scale(green)),
            rise_tolerance_m: 0.005,
        },
        Predicate::AtRest { body: red, max_linear: 0.01, max_angular: 0.5 },
        Predicate::Released { body: red },
    ]
}

/// Candidate lean angles of the hand, in rad: cubes at the far end of the table are out of reach from
/// straight above.
const LEANS: [f64; 6] = [0.0, 0.25, 0.5, 0.75, 0.95, 1.15];
/// Distance between the cubes below which the fingers must descend on the sides of the red cube that face
/// away from the green one, in m.
const NEAR: f64 = 0.075;
/// Control steps by which a plan may exceed the episode, since the red cube comes to rest before the plan
/// ends.
const SPARE_STEPS: u32 = 5;

fn expert(scene: &Scene) -> Vec<Move> {
    let (red, green) = (scene.body("red cube"), scene.body("green cube"));
    let rise = Vector3::z() * HALF * (red.scale.x + green.scale.x);
    let to_goal = green.pose.translation.vector - red.pose.translation.vector + rise;
    let closing = grasp::start_closing(scene, 0);
    let preferred = if to_goal.xy().norm() < NEAR { Vector3::z().cross(&to_goal) } else { closing };
    let upright = [preferred, Vector3::z().cross(&preferred)]
        .map(|preferred| grasp::top_down(red, &preferred, &closing));
    let grasps =
        LEANS.iter().flat_map(|lean| upright.map(|tcp| grasp::tilted_toward_base(scene, 0, &tcp, *lean)));
    let plans = grasps.map(|tcp| {
        vec![
            Move::straight(0, grasp::retreated(&tcp, 0.05)),
            Move::straight(0, tcp),
            Move::close(&[0], 6),
            Move::straight(0, grasp::translated(&tcp, &(Vector3::z() * 0.1))),
            Move::Carry { from: red.pose, to: grasp::translated(&red.pose, &to_goal) },
            Move::open(&[0], 6),
        ]
    });
    first_feasible(scene, TASK.max_steps + SPARE_STEPS, plans)
}
