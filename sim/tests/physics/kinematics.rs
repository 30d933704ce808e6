//! Kinematics of the arm, compared with known poses, finite differences and its own inverse.

use core::f64::consts::FRAC_PI_8;

use nalgebra::{Isometry3, Vector3};
use sim::expert::grasp::start_tcp;
use sim::robot::ik;
use sim::scene::Range;
use sim::scene::robot::kinematics::{Joints, displacement, tcp, tcp_and_jacobian};
use sim::scene::robot::panda::{LOWER, UPPER};
use sim::scene::stream::Stream;
use sim::{Perturbation, Profile, TaskId};

use super::common;

/// Draws joint positions within their limits, with a margin of 0.1 rad.
fn random_joints(stream: &mut Stream) -> Joints {
    Joints::from_fn(|joint, _| stream.uniform(Range::new(LOWER[joint] + 0.1, UPPER[joint] - 0.1)))
}

#[test]
fn default_pose_places_tcp_above_the_table() {
    let mut scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    scene.robots[0].qpos = (TaskId::RaiseCube.task().nominal)(Profile::Strict).robots[0].qpos;
    let tcp = start_tcp(&scene, 0);
    assert!((tcp.translation.vector - Vector3::new(0.0, 0.0, 0.1698)).norm() < 2e-4, "{tcp}");
    assert!((tcp.rotation * Vector3::z() + Vector3::z()).norm() < 1e-9, "it points down: {tcp}");
    assert!((tcp.rotation * Vector3::y()).x.abs() > 1.0 - 1e-9, "it closes along x: {tcp}");
}

#[test]
fn both_arms_start_facing_each_other() {
    let scene = common::draw(TaskId::DualArmLiftTray, Perturbation::None, 0);
    for (arm, side) in [(0, -1.0), (1, 1.0)] {
        let tcp = start_tcp(&scene, arm);
        let expected = Vector3::new(-0.4, side * 0.2935, 0.9227);
        assert!((tcp.translation.vector - expected).norm() < 2e-4, "arm {}: {tcp}", arm + 1);
        let approach = tcp.rotation * Vector3::z();
        let back_to_base = Vector3::new(0.0, side * libm::sin(FRAC_PI_8), -libm::cos(FRAC_PI_8));
        assert!((approach - back_to_base).norm() < 1e-4, "arm {}: approach {approach}", arm + 1);
    }
}

#[test]
fn jacobian_matches_finite_differences() {
    let mut stream = Stream::new(1, "jacobian");
    for _ in 0..50 {
        let q = random_joints(&mut stream);
        let (_, jacobian) = tcp_and_jacobian(&q);
        for joint in 0..7 {
            let mut ahead = q;
            let mut behind = q;
            ahead[joint] += 1e-6;
            behind[joint] -= 1e-6;
            let numeric = displacement(&tcp(&behind), &tcp(&ahead)) / 2e-6;
            assert!((numeric - jacobian.column(joint)).norm() < 1e-7, "joint {joint} at {q}");
        }
    }
}

#[test]
fn inverse_kinematics_solves_reachable_poses() {
    let mut stream = Stream::new(2, "ik");
    for case in 0..100 {
        let target = tcp(&random_joints(&mut stream));
        let near = random_joints(&mut stream);
        let q = ik::solve(&target, &near).unwrap_or_else(|| panic!("case {case}: {target}"));
        let miss = displacement(&tcp(&q), &target);
        assert!(
            miss.fixed_rows::<3>(0).norm() < 1e-5 && miss.fixed_rows::<3>(3).norm() < 1e-4,
            "case {case}: {miss}"
        );
        assert_eq!(q, ik::clamped(&q), "case {case}: within limits");
    }
}

#[test]
fn inverse_kinematics_rejects_unreachable_pose() {
    let far = Isometry3::translation(1.5, 0.0, 0.3);
    assert_eq!(ik::solve(&far, &Joints::from([0.0, 0.4, 0.0, -2.0, 0.0, 2.4, -0.8])), None);
}
