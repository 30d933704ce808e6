//! Control modes: the effect of action rows on the arm.

use ipc_types::ControlMode;
use nalgebra::{UnitQuaternion, Vector3};
use sim::physics::World;
use sim::{Perturbation, TaskId};

use super::common;

/// Returns the TCP's displacement (m) and rotation vector (rad) in the world frame after `steps` identical
/// delta-pose rows.
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
fn hold_action_holds_the_pose_in_every_mode() {
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
fn delta_pose_translates_along_the_root_axes() {
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut row = [0.0; 7];
            (row[axis], row[6]) = (0.1 * sign, 1.0);
            let (moved, turned) = moved_by(row, 10);
            let along = moved[axis] * sign;
            let lateral = (moved - Vector3::ith(axis, moved[axis])).norm();
            assert!(along > 0.03 && along < 0.1, "axis {axis}: {moved}");
            assert!(lateral < 0.05 * along && turned.norm() < 0.02, "axis {axis}: {moved}, turned {turned}");
        }
    }
}

#[test]
fn delta_pose_rotates_against_the_action_sign() {
    for axis in 0..3 {
        let mut row = [0.0; 7];
        (row[3 + axis], row[6]) = (0.5, 1.0);
        let (moved, turned) = moved_by(row, 10);
        assert!(turned[axis] < -0.1, "axis {axis}: {turned}");
        let lateral = (turned - Vector3::ith(axis, turned[axis])).norm();
        assert!(
            lateral < 0.1 * turned[axis].abs() && moved.norm() < 0.01,
            "axis {axis}: {turned}, moved {moved}"
        );
    }
}

#[test]
fn delta_pose_is_clipped_to_its_range() {
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
fn absolute_pose_is_reached_or_held_if_unreachable() {
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
fn gripper_command_maps_to_both_fingers() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    for (entry, finger_m) in [(1.0, 0.04), (0.0, 0.015), (-0.6, 0.0), (-1.0, 0.0)] {
        let mut world = World::build(&scene, ControlMode::JointPos);
        let mut row = common::hold_row(&scene, &world, ControlMode::JointPos);
        row[7] = entry;
        for _ in 0..20 {
            world.step(&row);
        }
        for finger in &world.qpos(0)[7..] {
            assert!((finger - finger_m).abs() < 5e-4, "gripper command {entry}: finger at {finger} m");
        }
    }
}

#[test]
fn drive_respects_its_force_limit() {
    // A force limit of 100 N·m slows joint 1 down visibly: without it, a spring of 1000 N·m/rad with an error
    // of 2 rad would move the joint much farther in one control step.
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let mut world = World::build(&scene, ControlMode::JointPos);
    let mut row = common::hold_row(&scene, &world, ControlMode::JointPos);
    row[0] += 2.0;
    let before = world.qpos(0)[0];
    world.step(&row);
    let moved = world.qpos(0)[0] - before;
    assert!(moved > 0.01 && moved < 0.15, "joint 1 moved {moved} rad in one control step");
}
