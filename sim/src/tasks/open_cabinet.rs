//! OpenCabinet: open a door by its handle. See docs/benchmark.md, "Tasks".

use core::f64::consts::{FRAC_PI_2, PI};

use ipc_types::Morphology;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::common::furniture::cabinet::{DOOR_HANDLE, ORIGIN_Z, drawer_over_door};
use super::common::{ExternalCameras, QPOS_NOISE_RAD, region, single_arm};
use crate::expert::{Move, grasp};
use crate::predicate::Predicate;
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{DistractorsSpec, Range, RegionSpec, Scene, SceneSpec, TableKind, WidenedRanges};

pub(crate) const TASK: Task = Task {
    env_id: "OpenCabinet-v1",
    category: Category::Articulated,
    morphology: Morphology::Single,
    max_steps: 491,
    demo_steps: 475.9,
    instruction: "grasp the handle and open the cabinet door",
    lerobot_instruction: "Open the cabinet door",
    paraphrases: include_str!("paraphrases/open_cabinet.txt"),
    nominal,
    success,
    expert,
};

/// Initial joint positions in rad: the hand in front of the handle, the fingers on either side of it.
const QPOS: [f64; 7] = [-2.5733, -0.6890, 1.9453, -2.5164, -2.7048, 1.5930, 1.5252];

fn nominal(profile: Profile) -> SceneSpec {
    let target = [0.0, 0.0, 0.35];
    let cameras =
        ExternalCameras { external1: [[-0.4, -0.5, 0.6], target], external2: [[-0.2, -0.15, 0.8], target] };
    let placement = region("cabinet", Range::fixed(0.2), Range::fixed(0.0));
    let x_only = |widened| WidenedRanges { y: placement.y, ..widened };
    let widened = placement.widened.map(|all| if profile.widens_all_points() { all } else { x_only(all) });
    let placement = RegionSpec { widened, ..placement };
    let bodies = drawer_over_door(Range::fixed(0.0));
    let mut spec = single_arm(QPOS, QPOS_NOISE_RAD, &cameras, vec![placement], bodies, TASK.instruction);
    spec.table.kind = TableKind::SingleArmTurned;
    // In front of the cabinet, clear of the door and of the arm's base.
    spec.distractors = DistractorsSpec {
        n: 1,
        x: Range::new(-0.25, -0.15),
        y: Range::symmetric(0.05),
        drop_m: (0.10 + ORIGIN_Z, None),
        ..spec.distractors
    };
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI / 12.0);
    spec.robots[0].base = Isometry3::from_parts(Translation3::new(-0.615, 0.15, 0.0), turn);
    spec
}

/// Requires the door to be open by the released code's angle and to move slowly.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let door = scene.body_idx("door");
    vec![
        Predicate::Opened { body: door, min_position: 0.45 * 0.25 * FRAC_PI_2 },
        Predicate::AtRest { body: door, max_linear: 0.1, max_angular: 1.0 },
    ]
}

/// Number of short straight moves that follow the handle's arc about the hinge.
const N_ARC_MOVES: u32 = 32;
/// Distance of the hand behind the handle while it opens the door, in m.
const PULL_BACK: f64 = 0.02;
/// Angle by which the door is opened, in rad.
const OPENING_ANGLE: f64 = 0.9 * FRAC_PI_2;

fn expert(scene: &Scene) -> Vec<Move> {
    let handle = (scene.body("cabinet").pose * DOOR_HANDLE).coords;
    let approach = handle - scene.robots[0].base.translation.vector;
    let tangent = Vector3::z().cross(&approach);
    let closing = grasp::closest_closing(tangent, &grasp::start_closing(scene, 0));
    let tcp = grasp::pose(&handle, &approach, &closing);
    let opened_by = |angle: f64| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -angle);
        let hinge = scene.body("door").pose.translation;
        hinge * turn * hinge.inverse() * tcp
    };
    let mut moves =
        vec![Move::open(&[0], 6), Move::straight(0, tcp), Move::close(&[0], 4), Move::Hold { steps: 10 }];
    let pulled = |angle: f64| grasp::retreated(&opened_by(angle), PULL_BACK);
    let angles = (1..=N_ARC_MOVES).map(|i| OPENING_ANGLE * f64::from(i) / f64::from(N_ARC_MOVES));
    moves.extend(angles.map(|angle| Move::straight(0, pulled(angle))));
    moves.extend([Move::open(&[0], 6), Move::straight(0, grasp::retreated(&pulled(OPENING_ANGLE), 0.05))]);
    moves
}
