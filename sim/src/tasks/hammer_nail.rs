//! HammerNail: drive a nail into a block with a hammer. See docs/benchmark.md, "Tasks".

use core::f64::consts::{FRAC_PI_2, FRAC_PI_3};

use ipc_types::Morphology;
use nalgebra::{Isometry3, Translation3, Vector3};

use super::common::objects::tools::{self, HAMMER_FACE, HAMMER_HALF_THICKNESS, NAIL_HALF_LENGTH, NAIL_HEAD_RADIUS};
use super::common::{
    ExternalCameras, QPOS_D, QPOS_NOISE_RAD, SINGLE_TABLE_Z, box_part, fixed, region, single_arm,
};
use crate::expert::{Move, TcpGoal, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{AppearanceSpec, BodySpec, Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "HammerNail-v1",
    category: Category::ToolUse,
    morphology: Morphology::Single,
    max_steps: 247,
    demo_steps: 225.7,
    instruction: "use the hammer to hit the nail into the wood",
    lerobot_instruction: "Hammer the nail into the surface",
    paraphrases: include_str!("paraphrases/hammer_nail.txt"),
    nominal,
    success,
    expert,
};

/// Half-extents of the block, in m.
const BLOCK_HALF: [f64; 3] = [0.03, 0.015, 0.06];
/// Height of the hole above the block's centre, in m.
const HOLE_Z: f64 = 0.04;
/// Index of the nail among the bodies.
const NAIL: usize = 2;
/// Half-width of the hole, in m.
const HOLE_HALF_WIDTH: f64 = 0.003;

fn nominal(_profile: Profile) -> SceneSpec {
    let [half_x, half_y, half_z] = BLOCK_HALF;
    let slab = |x: [f64; 2], z: [f64; 2]| {
        let half = [(x[1] - x[0]) / 2.0, half_y, (z[1] - z[0]) / 2.0];
        box_part(
            half,
            [(x[0] + x[1]) / 2.0, 0.0, (z[0] + z[1]) / 2.0],
            AppearanceSpec::plain([0.6, 0.4, 0.2]),
        )
    };
    let hole_z = [HOLE_Z - HOLE_HALF_WIDTH, HOLE_Z + HOLE_HALF_WIDTH];
    let slabs = vec![
        slab([-half_x, half_x], [-half_z, hole_z[0]]),
        slab([-half_x, half_x], [hole_z[1], half_z]),
        slab([-half_x, -HOLE_HALF_WIDTH], hole_z),
        slab([HOLE_HALF_WIDTH, half_x], hole_z),
    ];
    let pierced_block = fixed("block", slabs, 1, SINGLE_TABLE_Z, "its hole fits the nail");
    let nail = tools::nail(2, SINGLE_TABLE_Z + half_z + HOLE_Z - NAIL_HEAD_RADIUS);
    // The x and y axes of the block's frame are −y and x of the benchmark's.
    let block = BodySpec { friction: tools::NAIL_FRICTION, ..pierced_block };
    let bodies = vec![tools::hammer(0).with_yaw(Range::new(0.0, FRAC_PI_2)), block, nail];
    let regions = vec![
        region("hammer", Range::new(-0.13, -0.07), Range::new(0.32, 0.38)),
        region("block", Range::fixed(0.15), Range::fixed(0.10)).not_widened(),
        region("nail", Range::fixed(0.15), Range::new(0.108, 0.113)).not_widened(),
    ];
    let target = [-0.1, 0.1, 0.0];
    let cameras =
        ExternalCameras { external1: [[0.5, 0.5, 0.3], target], external2: [[0.75, 0.0, 0.5], target] };
    let mut scene = single_arm(QPOS_D, QPOS_NOISE_RAD, &cameras, regions, bodies, TASK.instruction);
    // In the released code, the nail's height is the reference, not the hammer's.
    scene.distractors.drop_m.1 = Some(NAIL);
    for camera in &mut scene.cameras[..2] {
        (camera.fov_y_rad, camera.clip_m[1]) = (FRAC_PI_3, 10.0);
    }
    scene
}

/// World y below which the nail's centre must be driven in m, 10 to 15 mm from its initial position.
const DRIVEN_Y: f64 = 0.098;

/// Requires the nail to be driven in.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let nail = scene.body_idx("nail");
    vec![Predicate::inside_box(nail, [f64::NEG_INFINITY; 3], [f64::INFINITY, DRIVEN_Y, f64::INFINITY])]
}

/// Grasp position along the handle in m at scale 1: 0.7 of the way from the middle of the hammer's length to
/// its centre of mass.
const GRASP_X: f64 = 0.020;
/// Depth of the grasp below the hammer's top, in m.
const GRASP_DEPTH: f64 = 0.015;
/// Height at which the hammer is carried above the nail, in m.
const CARRY_HEIGHT: f64 = 0.10;
/// Distance of the hammer's face from the nail's head at the start of the stroke, in m.
const STROKE_START: f64 = 0.10;
/// Distance beyond the middle of the nail at which the stroke would end if nothing were in the way, in m.
const FOLLOW_THROUGH: f64 = 0.12;

fn expert(scene: &Scene) -> Vec<Move> {
    let across = scene.body("hammer").resting_pose().rotation * Vector3::y();
    let closing = grasp::closest_closing(across, &grasp::start_closing(scene, 0));
    first_feasible(scene, TASK.max_steps, [closing, -closing].iter().map(|closing| strike(scene, closing)))
}

/// Plans to grasp the hammer's handle, turn it to lie along x in front of the nail and strike.
fn strike(scene: &Scene, closing: &Vector3<f64>) -> Vec<Move> {
    let (hammer, nail) = (scene.body("hammer"), scene.body("nail"));
    let position = hammer.point([GRASP_X, 0.0, HAMMER_HALF_THICKNESS]) - Vector3::z() * GRASP_DEPTH;
    let tcp = grasp::pose(&position.coords, &-Vector3::z(), closing);
    let height = nail.pose.translation.z + CARRY_HEIGHT - tcp.translation.z;
    let raised = grasp::translated(&tcp, &(Vector3::z() * height));
    // TCP pose at which the hammer lies along x with its face `distance_m` in front of the initial position
    // of the nail's head.
    let in_front = |distance_m: f64| -> Isometry3<f64> {
        let [face_x, face_y] = HAMMER_FACE.map(|x| x * hammer.scale.x);
        let nail_head = nail.pose.translation.vector + Vector3::y() * NAIL_HALF_LENGTH;
        let hammer_at = nail_head + Vector3::new(-face_x, distance_m - face_y, 0.0);
        Isometry3::from(Translation3::from(hammer_at)) * hammer.resting_pose().inverse() * tcp
    };
    let along_x = Isometry3::from_parts(raised.translation, in_front(0.0).rotation);
    let joint = |tcp| Move::Joint(vec![TcpGoal { arm: 0, tcp }]);
    vec![
        Move::open(&[0], 6),
        joint(grasp::retreated(&tcp, 0.08)),
        Move::straight(0, tcp),
        Move::close(&[0], 6),
        joint(raised),
        joint(along_x),
        joint(in_front(STROKE_START)),
        Move::straight(0, in_front(-FOLLOW_THROUGH - NAIL_HALF_LENGTH)),
        Move::straight(0, in_front(STROKE_START)),
        Move::open(&[0], 6),
    ]
}
