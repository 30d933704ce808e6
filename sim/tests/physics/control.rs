//! Control modes as seen from outside: what an action row does to the arm.

use ipc_types::ControlMode;
use nalgebra::{UnitQuaternion, Vector3};
use sim::physics::World;
use sim::{Perturbation, TaskId};

use super::common;

/// The TCP's displacement (m) and rotation vector (rad) in the world after `steps` equal delta-pose rows.
fn moved_by(row: [f32; 7], steps: usize) -> (Vector3<f32>, Vector3<f32>) {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 1);
    let mut world = World::build(&scene, ControlMode::EeDeltaPose);
    let start = world.tcp_pose(0);
    for _ in 0..steps {
        world.step(&row);
    }
    let end = world.tcp_pose(0);
    let turn = UnitQuaternion::scaled_axis(&(end.rotation * start.rotation.inverse()));
    (end.translation.vector - start.translation.vector, turn)
}

#[test]
fn every_mode_holds_still_when_asked_to() {
    for &task in TaskId::ALL {
        let scene = common::draw(task, Perturbation::None, 0);
        for mode in ControlMode::ALL {
            let mut world = World::build(&scene, mode);
            let row = common::hold_row(&scene, &world, mode);
            let start: Vec<_> = (0..world.n_arms()).map(|arm| world.tcp_pose(arm)).collect();
            for _ in 0..40 {
                world.step(&row);
            }
            for (arm, start) in start.iter().enumerate() {
                let drift = (world.tcp_pose(arm).translation.vector - start.translation.vector).norm();
                assert!(
                    drift < 1e-3,
                    "{} {}: arm {} drifts {drift} m in 2 s",
                    task.name(),
                    mode.name(),
                    arm + 1
                );
            }
        }
    }
}

#[test]
fn a_delta_pose_translates_along_the_root_axes() {
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut row = [0.0; 7];
            (row[axis], row[6]) = (0.1 * sign, 1.0);
            let (moved, turned) = moved_by(row, 10);
            let along = moved[axis] * sign;
            let aside = (moved - Vector3::ith(axis, moved[axis])).norm();
            assert!(along > 0.03 && along < 0.1, "axis {axis}: {moved}");
            assert!(aside < 0.05 * along && turned.norm() < 0.02, "axis {axis}: {moved}, turned {turned}");
        }
    }
}

#[test]
fn a_delta_pose_turns_against_the_sign_of_its_action() {
    for axis in 0..3 {
        let mut row = [0.0; 7];
        (row[3 + axis], row[6]) = (0.5, 1.0);
        let (moved, turned) = moved_by(row, 10);
        assert!(turned[axis] < -0.1, "axis {axis}: {turned}");
        let aside = (turned - Vector3::ith(axis, turned[axis])).norm();
        assert!(
            aside < 0.1 * turned[axis].abs() && moved.norm() < 0.01,
            "axis {axis}: {turned}, moved {moved}"
        );
    }
}

#[test]
fn a_delta_pose_is_clipped_by_component_and_its_rotation_by_norm() {
    assert_eq!(
        moved_by([5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], 3),
        moved_by([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], 3)
    );
    assert_eq!(
        moved_by([0.0, 0.0, 0.0, 0.0, 0.0, 4.0, 1.0], 3),
        moved_by([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0], 3)
    );
}

#[test]
fn an_absolute_pose_is_reached_and_an_unreachable_one_holds() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let mut world = World::build(&scene, ControlMode::EePose);
    let start = world.tcp_pose(0).translation.vector;
    let mut row = common::hold_row(&scene, &world, ControlMode::EePose);
    row[0] -= 0.05;
    row[2] += 0.05;
    for _ in 0..40 {
        world.step(&row);
    }
    let reached = world.tcp_pose(0).translation.vector;
    assert!((reached - start - Vector3::new(-0.05, 0.0, 0.05)).norm() < 1e-3, "{start} -> {reached}");
    row[0] = 2.0;
    for _ in 0..40 {
        world.step(&row);
    }
    let held = world.tcp_pose(0).translation.vector;
    assert!((held - reached).norm() < 1e-3, "{reached} -> {held}");
}

#[test]
fn the_gripper_entry_maps_to_both_fingers() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    for (entry, finger_m) in [(1.0, 0.04), (0.0, 0.015), (-0.6, 0.0), (-1.0, 0.0)] {
        let mut world = World::build(&scene, ControlMode::JointPos);
        let mut row = common::hold_row(&scene, &world, ControlMode::JointPos);
        row[7] = entry;
        for _ in 0..20 {
            world.step(&row);
        }
        for finger in &world.qpos(0)[7..] {
            assert!((finger - finger_m).abs() < 5e-4, "gripper {entry}: finger at {finger} m");
        }
    }
}

#[test]
fn the_drive_never_exceeds_its_limit_of_force() {
    // At rest a joint's speed after one step of full torque is bounded by limit · dt over its least inertia, far above what
    // a spring of 1000 N·m/rad would give for an error of 2 rad; what shows is that joint 1 takes its time.
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let mut world = World::build(&scene, ControlMode::JointPos);
    let mut row = common::hold_row(&scene, &world, ControlMode::JointPos);
    row[0] += 2.0;
    let before = world.qpos(0)[0];
    world.step(&row);
    let moved = world.qpos(0)[0] - before;
    assert!(moved > 0.01 && moved < 0.15, "joint 1 moved {moved} rad in one control step");
}
