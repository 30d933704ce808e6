//! DualArmCubeHandover: one arm picks up a cube and hands it to the other arm. See docs/benchmark.md,
//! "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::bimanual_plan::{BimanualPlan, pose};
use super::common::{self, BIMANUAL_TABLE_Z, BLUE, ExternalCameras, QPOS_B, bimanual, region};
use crate::expert::{Move, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmPickCube-v1",
    category: Category::Handover,
    morphology: Morphology::Bimanual,
    max_steps: 213,
    demo_steps: 201.1,
    instruction: "use both arms to pick up the cube",
    lerobot_instruction: "Pick up the cube with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_cube_handover.txt"),
    nominal,
    success,
    expert,
};

/// Half-extent of the cube, in m.
const HALF: f64 = 0.02;

fn nominal(_profile: Profile) -> SceneSpec {
    let cube = common::cube("cube", HALF, BLUE, 0, BIMANUAL_TABLE_Z).with_origin_z(0.85);
    let cameras = ExternalCameras {
        external1: [[0.75, 0.0, 1.33], [-0.2, 0.0, 1.03]],
        external2: [[-0.5, 0.0, 1.58], [-0.2, 0.0, 1.13]],
    };
    let around_origin = region("cube", Range::symmetric(0.1), Range::symmetric(0.1));
    bimanual([QPOS_B; 2], 0.0, &cameras, vec![around_origin], vec![cube], TASK.instruction)
}

/// Requires the second arm to hold the cube.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    vec![Predicate::GraspedByNearest { body: scene.body_idx("cube"), arm: 1 }]
}

/// World poses of both TCPs before the handover. The hands face each other along y; the first closes about
/// along x and the second along z, so that their fingers do not collide.
const BEFORE: [([f64; 3], [f64; 4]); 2] =
    [([-0.333, -0.1, 1.5], [0.546, -0.449, 0.523, 0.515]), ([-0.333, 0.1, 1.5], [0.707, 0.707, 0.0, 0.0])];
/// World y of both TCPs at the handover, in m.
const HANDOVER_Y: f64 = 0.04;
/// Candidate lean angles of the hand in rad; the later ones are for cubes that are out of reach.
const LEANS: [f64; 6] = [0.0, 0.3, 0.6, 0.8, 1.0, 1.2];

fn expert(scene: &Scene) -> Vec<Move> {
    let closing = grasp::start_closing(scene, 0);
    let grasps = LEANS.iter().flat_map(|lean| {
        [closing, Vector3::z().cross(&closing)].map(|preferred| {
            let upright = grasp::top_down(scene.body("cube"), &preferred, &closing);
            grasp::tilted_toward_base(scene, 0, &upright, *lean)
        })
    });
    first_feasible(scene, TASK.max_steps, grasps.map(|tcp| hand_over(scene, &tcp)))
}

/// Plans to grasp the cube at `tcp` and hand it over.
fn hand_over(scene: &Scene, tcp: &Isometry3<f64>) -> Vec<Move> {
    let before = BEFORE.map(|(position, orientation)| pose(position, orientation));
    let meeting = before.map(|tcp| {
        let there = tcp.translation.vector;
        Isometry3::from_parts(Vector3::new(there.x, HANDOVER_Y, there.z).into(), tcp.rotation)
    });
    BimanualPlan::new(scene)
        .screw_one(0, grasp::retreated(tcp, 0.1))
        .screw_one(0, *tcp)
        .close(0, 10)
        .joint(before)
        // The benchmark's arms move at the same speed, and the first to arrive hardly slows the other one.
        .meet(meeting)
        .close(1, 10)
        .open(0, 10)
        .joint(meeting.map(|tcp| grasp::retreated(&tcp, 0.1)))
        .hold(5)
        .into_moves()
}
