//! States in which the profiles disagree: the released code counts a success and the evident intent does not,
//! or vice versa.

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use sim::physics::World;
use sim::predicate::first_unmet;
use sim::scene::Scene;
use sim::{Perturbation, Profile, TaskId};

use super::common;

/// Returns the success under the strict and the paper profile after `arrange` has moved the bodies of the
/// scene.
fn judged(task: TaskId, arrange: impl Fn(&mut Scene)) -> [bool; 2] {
    judged_scene(task, &common::draw(task, Perturbation::None, 0), arrange)
}

fn judged_scene(task: TaskId, drawn: &Scene, arrange: impl Fn(&mut Scene)) -> [bool; 2] {
    let mut arranged = drawn.clone();
    arrange(&mut arranged);
    let world = World::build(&arranged, ControlMode::JointPos);
    Profile::ALL.map(|profile| first_unmet(&(task.task().success)(drawn, profile), &world).is_none())
}

fn shift(scene: &mut Scene, body: &str, by: [f64; 3]) {
    let body = scene.body_idx(body);
    let pose = &mut scene.bodies[body].pose;
    *pose = Translation3::from(by) * *pose;
}

const STRICT_ONLY: [bool; 2] = [true, false];
const PAPER_ONLY: [bool; 2] = [false, true];
const BOTH: [bool; 2] = [true; 2];
const NEITHER: [bool; 2] = [false; 2];

#[test]
fn sinking_body_does_not_count_as_lifted() {
    let by = |task, body, z| judged(task, |scene| shift(scene, body, [0.0, 0.0, z]));
    assert_eq!(by(TaskId::DualArmLiftPot, "pot", 0.16), BOTH);
    assert_eq!(by(TaskId::DualArmLiftPot, "pot", -0.16), PAPER_ONLY);
    assert_eq!(by(TaskId::PickDishFromRack, "plate", 0.1), BOTH);
    assert_eq!(by(TaskId::PickDishFromRack, "plate", -0.09), PAPER_ONLY);
}

#[test]
fn scaled_peg_is_judged_by_its_own_length() {
    let task = TaskId::LiftPegUpright;
    let is_scaled = |scene: &Scene| (scene.body("peg").scale.x - 1.0).abs() > 0.1;
    let mut draws = (0..50).map(|episode_idx| common::draw(task, Perturbation::MoSize, episode_idx));
    let drawn = draws.find(is_scaled).expect("half of all pegs are scaled");
    let stand = |nominal: bool| {
        judged_scene(task, &drawn, |scene| {
            let peg = scene.body_idx("peg");
            let scale = scene.bodies[peg].scale.x;
            let upright = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -core::f64::consts::FRAC_PI_2);
            let z = 0.12 * if nominal { 1.0 } else { scale };
            scene.bodies[peg].pose = Isometry3::from_parts(
                Translation3::new(0.0, 0.0, z),
                upright * scene.bodies[peg].pose.rotation,
            );
        })
    };
    assert_eq!(stand(false), STRICT_ONLY);
    assert_eq!(stand(true), PAPER_ONLY);
}

#[test]
fn peg_behind_the_box_is_not_inserted() {
    let head_at = |lengths: f64| {
        judged(TaskId::PegInsertionSide, |scene| {
            let (peg, target) = (scene.body_idx("peg"), scene.body("box").clone());
            let length = scene.bodies[peg].aabb(&Isometry3::identity()).max.x;
            let wall = |i: usize| target.parts[i].shape.aabb(&target.parts[i].pose);
            let y = f64::midpoint(wall(0).max.y, wall(1).min.y);
            let z = f64::midpoint(wall(2).max.z, wall(3).min.z);
            scene.bodies[peg].pose = target.pose * Translation3::new((lengths - 1.0) * length, y, z);
        })
    };
    assert_eq!(head_at(-0.5), NEITHER);
    assert_eq!(head_at(0.5), BOTH);
    assert_eq!(head_at(1.5), PAPER_ONLY);
}

#[test]
fn arrow_rotation_is_measured_from_its_start() {
    let turned = |degrees: f64| {
        judged(TaskId::RotateArrow, |scene| {
            let arrow = scene.body_idx("arrow");
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), degrees.to_radians());
            scene.bodies[arrow].pose.rotation = turn * scene.bodies[arrow].pose.rotation;
        })
    };
    // The arrow starts within 15° of the world's x axis.
    assert_eq!(turned(70.0), NEITHER);
    assert_eq!(turned(110.0), PAPER_ONLY);
    assert_eq!(turned(160.0), BOTH);
}

#[test]
fn ring_is_judged_at_its_true_position() {
    let tip_above_middle = |z: f64| {
        judged(TaskId::DualArmThreading, |scene| {
            let (needle, tripod) = (scene.body_idx("needle"), scene.body("tripod").pose);
            scene.bodies[needle].pose = tripod * Translation3::new(-0.125, 0.0, 0.215 + z);
        })
    };
    assert_eq!(tip_above_middle(0.0), BOTH);
    assert_eq!(tip_above_middle(0.045), STRICT_ONLY);
    assert_eq!(tip_above_middle(-0.06), PAPER_ONLY);
}

#[test]
fn can_on_the_floor_is_not_placed() {
    let at = |position: [f64; 3]| {
        judged(TaskId::PickSodaFromCabinet, |scene| {
            let can = scene.body_idx("can");
            scene.bodies[can].pose.translation = Translation3::from(position);
        })
    };
    assert_eq!(at([-0.2, -0.1, 0.063]), BOTH);
    assert_eq!(at([-0.2, -0.1, -0.85]), PAPER_ONLY);
    assert_eq!(at([0.25, -0.1, 0.099]), PAPER_ONLY);
}

#[test]
fn apple_in_pan_off_the_stove_fails() {
    // The pan is at its start next to the stove; the middle of its floor is at about (−0.1, 0.29).
    let apple_at = |position: [f64; 3]| {
        judged(TaskId::CookItemInPan, |scene| {
            let apple = scene.body_idx("apple");
            scene.bodies[apple].pose.translation = Translation3::from(position);
        })
    };
    assert_eq!(apple_at([-0.1, 0.3, 0.1]), PAPER_ONLY);
    assert_eq!(apple_at([-0.1, 0.0, 0.1]), NEITHER);
}
