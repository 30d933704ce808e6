//! ScoopBanana: scoop up a banana with a dustpan against a wall. See docs/benchmark.md, "Tasks".

use core::f64::consts::PI;

use ipc_types::Morphology;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::common::objects::tools;
use super::common::{ExternalCameras, QPOS_D, QPOS_NOISE_RAD, SINGLE_TABLE_Z, box_part, fixed, region, rgb, single_arm};
use crate::expert::{Move, TcpGoal, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{AppearanceSpec, BodySpec, PlacementSpec, Range, RegionSpec, Role, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "ScoopBanana-v1",
    category: Category::ToolUse,
    morphology: Morphology::Single,
    max_steps: 322,
    demo_steps: 242.9,
    instruction: "scoop the banana and move it to the target location",
    lerobot_instruction: "Scoop the banana",
    paraphrases: include_str!("paraphrases/scoop_banana.txt"),
    nominal,
    success,
    expert,
};

/// Half-extents of the visible wall, in m.
const WALL_HALF: [f64; 3] = [0.02, 0.2, 0.1];
/// Distance of the wall beyond the banana, in m.
const WALL_DISTANCE: f64 = 0.15;
/// World z of the banana's origin at the start where it drops onto the table, in m.
const DROPPED_BANANA_Z: f64 = 0.045;
/// Depth by which the wall extends into the table, in m: the height of its origin varies with the scale of
/// the banana.
const FOUNDATION: f64 = 0.02;

fn nominal(profile: Profile) -> SceneSpec {
    let mut banana = BodySpec { role: Role::ReceiverObject, ..tools::banana(1) };
    let mut banana_z = tools::BANANA_RADIUS;
    if !profile.separates_starts() {
        banana_z = DROPPED_BANANA_Z;
        banana = banana.with_origin_z(banana_z);
    }
    let [half_x, half_y, half_z] = WALL_HALF;
    let slab = box_part(
        [half_x, half_y, half_z + FOUNDATION / 2.0],
        [WALL_DISTANCE, 0.0, half_z - banana_z - FOUNDATION / 2.0],
        AppearanceSpec::plain(rgb([201, 204, 182])),
    );
    // The wall's origin is the banana's, so that its distance does not scale with the banana.
    let wall = BodySpec {
        role: Role::Fixture,
        placement: PlacementSpec::RelativeTo { body: 1, pose: Isometry3::identity() },
        ..fixed("wall", vec![slab], 1, SINGLE_TABLE_Z, "the released code scales only dustpan and banana")
    };
    let around_banana = region("banana", Range::new(-0.05, 0.15), Range::new(-0.25, 0.05)).not_widened();
    let regions = vec![
        region("dustpan", Range::new(-0.3, -0.1), Range::new(-0.3, -0.1)),
        // The regions overlap: the banana's position is resampled until it is next to the dustpan and not
        // inside it. The circles about both may overlap a little; what is in them cannot.
        RegionSpec { min_gap_m: profile.separates_starts().then_some(-0.02), ..around_banana },
    ];
    let target = [0.0, 0.0, 0.1];
    let cameras =
        ExternalCameras { external1: [[-0.25, 0.25, 0.4], target], external2: [[-0.2, -0.4, 0.4], target] };
    let bodies = vec![tools::dustpan(0), banana, wall];
    single_arm(QPOS_D, QPOS_NOISE_RAD, &cameras, regions, bodies, TASK.instruction)
}

/// Requires the banana to be within 0.17 m of the dustpan's centre and at most 55 mm above it. A banana on
/// the table is lower.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let [top, base] = ["banana", "dustpan"].map(|name| scene.body_idx(name));
    vec![Predicate::On { top, base, xy_m: 0.16968, rise_m: 0.0275, rise_tolerance_m: 0.0275 }]
}

/// Position of the hand relative to the banana at the two ends of the push, along x in m.
const PUSH_X: [f64; 2] = [-0.07, -0.03];
/// Position of the hand relative to the banana, along x in m, at which the dustpan's mouth is behind the
/// banana.
const BEHIND_X: f64 = -0.22;
/// Candidate tilt angles of the dustpan, in rad. The later ones are for poses in which the arm cannot tilt
/// further.
const TILTS: [f64; 3] = [40.0 * PI / 180.0, 0.55, 0.4];
/// Displacement of the hand while it tilts the dustpan in its own frame, in m.
const TILT_SHIFT: [f64; 3] = [0.01, 0.0, -0.03];
/// Height to which the dustpan is raised, in m.
const LIFT: f64 = 0.18;

fn expert(scene: &Scene) -> Vec<Move> {
    let across = scene.body("dustpan").resting_pose().rotation * Vector3::y();
    let options = TILTS.iter().flat_map(|tilt| [(*tilt, -across), (*tilt, across)]);
    first_feasible(scene, TASK.max_steps, options.map(|(tilt, closing)| scoop(scene, &closing, tilt)))
}

/// Plans to grasp the dustpan, push it under the banana until that touches the wall, tilt it back and lift
/// it.
fn scoop(scene: &Scene, closing: &Vector3<f64>, tilt: f64) -> Vec<Move> {
    let (dustpan, banana) = (scene.body("dustpan"), scene.body("banana").pose.translation);
    let grip = dustpan.point(tools::DUSTPAN_GRIP);
    let tcp = grasp::pose(&grip.coords, &-Vector3::z(), closing);
    let pushed =
        |x: f64| Isometry3::from_parts(Translation3::new(banana.x + x, banana.y, grip.z), tcp.rotation);
    let [before, under] = PUSH_X.map(pushed);
    // Positive about the closing axis if the hand's x axis points to the mouth.
    let forward = dustpan.resting_pose().rotation * Vector3::x();
    let side = (tcp.rotation * Vector3::x()).dot(&forward).signum();
    let [x, y, z] = TILT_SHIFT;
    let tilted = under
        * Translation3::new(side * x, y, z)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), side * tilt);
    let lifted =
        Isometry3::from_parts((under.translation.vector + Vector3::z() * LIFT).into(), tilted.rotation);
    let to = |tcp| Move::straight(0, tcp);
    let joint = |tcp| Move::Joint(vec![TcpGoal { arm: 0, tcp }]);
    let mut moves = vec![
        Move::Limit { per_joint: 0.75 },
        to(grasp::retreated(&tcp, 0.15)),
        to(tcp),
        Move::close(&[0], 6),
    ];
    let offset = dustpan.resting_pose().inverse() * scene.body("banana").resting_pose();
    // If the dustpan starts beside the banana, a straight path would push the banana away.
    if offset.translation.y.abs() > 1.2 * offset.translation.x {
        let behind = pushed(BEHIND_X);
        let back = grip.x.min(behind.translation.x);
        let beside = Isometry3::from_parts(Translation3::new(back, grip.y, grip.z), tcp.rotation);
        moves.extend([to(beside), to(behind)]);
    }
    moves.extend([to(before), to(under), Move::close(&[0], 6), joint(tilted), joint(lifted)]);
    moves
}
