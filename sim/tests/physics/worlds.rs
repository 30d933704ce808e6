//! Worlds: grasps, stacking, state vectors, snapshots and determinism.

use ipc_types::ControlMode;
use nalgebra::Translation3;
use rayon::prelude::*;
use sim::expert::{Move, grasp};
use sim::physics::World;
use sim::physics::fingerprint::Fingerprint;
use sim::scene::{Link, Motion, Primitive, Snapshot};
use sim::{Perturbation, TaskId};

use super::common;

/// Returns the fingerprint of a whole expert episode.
fn trajectory(task: TaskId, perturbation: Perturbation, episode_idx: u32) -> u64 {
    let scene = common::draw(task, perturbation, episode_idx);
    let mut fingerprint = Fingerprint::default();
    common::play(&scene, &(task.task().expert)(&scene), 0, |_, world| world.hash_state(&mut fingerprint));
    fingerprint.finish()
}

#[test]
fn trajectories_do_not_depend_on_the_thread() {
    let cases: Vec<(TaskId, u32)> = TaskId::ALL.iter().flat_map(|&task| [(task, 0), (task, 1)]).collect();
    let run = |&(task, episode_idx): &(TaskId, u32)| trajectory(task, Perturbation::None, episode_idx);
    let sequential: Vec<u64> = cases.iter().map(run).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().expect("four threads");
    let parallel: Vec<u64> = pool.install(|| cases.par_iter().map(run).collect());
    assert_eq!(sequential, parallel);
    assert!(sequential.windows(2).all(|pair| pair[0] != pair[1]), "episodes differ: {sequential:?}");
}

#[test]
fn grasped_cube_does_not_slip() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 3);
    let moves = (TaskId::RaiseCube.task().expert)(&scene);
    let n_until_closed = sim::expert::Expert::new(&scene, &moves[..3]).expect("reachable").n_steps();
    let mut grasped = Vec::new();
    common::play(&scene, &moves, 40, |step, world| {
        if step >= n_until_closed {
            assert!(world.is_grasping(0, 0), "lost after {step} steps");
            grasped.push(world.tcp_pose(0).inverse() * world.body_pose(0));
        }
    });
    let (first, last) = (grasped[0], grasped[grasped.len() - 1]);
    let slip = (last.translation.vector - first.translation.vector).norm();
    let turn = first.rotation.angle_to(&last.rotation);
    // In the original, the cube moves by 1.3 mm in the grip.
    assert!(slip < 1e-3 && turn < 2e-2, "slipped {slip} m, turned {turn} rad");
}

#[test]
fn stack_is_stable_after_release() {
    let scene = common::draw(TaskId::StackCube, Perturbation::None, 1);
    let moves = (TaskId::StackCube.task().expert)(&scene);
    let n_steps = sim::expert::Expert::new(&scene, &moves).expect("reachable").n_steps();
    let mut poses = Vec::new();
    common::play(&scene, &moves, 80, |step, world| {
        if step >= n_steps + 20 {
            poses.push([0, 1].map(|body| world.body_pose(body)));
        }
    });
    assert!(poses[0][0].translation.z - poses[0][1].translation.z > 0.035, "one cube is on top of the other");
    for pose in &poses {
        for body in [0, 1] {
            let moved = (pose[body].translation.vector - poses[0][body].translation.vector).norm();
            let turned = pose[body].rotation.angle_to(&poses[0][body].rotation);
            assert!(moved < 1e-4 && turned < 1e-3, "body {body} moved {moved} m and turned {turned} rad");
        }
    }
}

#[test]
fn hull_with_a_many_sided_base_rests_still() {
    let mut vessel = common::brick("vessel", Motion::Dynamic, [0.1; 3], [0.0, 0.0, 0.005]);
    vessel.parts[0].shape = Primitive::frustum([[0.14, 0.0], [0.15, 0.1]]);
    let scene = common::bodies_only(vec![vessel]);
    let [first, last] = [20, 60].map(|steps| common::after(&scene, steps).body_pose(0));
    let moved = (last.translation.vector - first.translation.vector).norm();
    let turned = first.rotation.angle_to(&last.rotation);
    assert!(moved < 1e-4 && turned < 1e-3, "moved {moved} m and turned {turned} rad");
    assert!(last.translation.z.abs() < 5e-4, "rests at {}", last.translation);
}

#[test]
fn pressing_from_above_is_not_a_grasp() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let closing = grasp::start_closing(&scene, 0);
    let top = Translation3::new(0.0, 0.0, 0.02) * grasp::top_down(scene.body("cube"), &closing, &closing);
    let moves =
        [Move::close(&[0], 10), Move::straight(0, grasp::retreated(&top, 0.05)), Move::straight(0, top)];
    let world = common::play(&scene, &moves, 10, |step, world| {
        assert!(!world.is_grasping(0, 0), "grasp reported after {step} steps");
    });
    let above_target = f64::from(world.tcp_pose(0).translation.z) - top.translation.z;
    assert!(above_target > 0.003, "the finger tips rest on the cube, {above_target} m above their target");
}

#[test]
fn gripper_closing_on_air_grasps_nothing() {
    for &task in TaskId::ALL {
        let scene = common::draw(task, Perturbation::None, 0);
        let arms: Vec<usize> = (0..scene.robots.len()).collect();
        common::play(&scene, &[Move::close(&arms, 20)], 0, |_, world| {
            for arm in &arms {
                assert!((0..scene.bodies.len()).all(|body| !world.is_grasping(*arm, body)));
            }
        });
    }
}

#[test]
fn state_has_the_benchmark_layout() {
    for &task in TaskId::ALL {
        let scene = common::draw(task, Perturbation::None, 5);
        let world = common::play(&scene, &(task.task().expert)(&scene)[..2], 0, |_, _| {});
        let n = world.n_arms();
        let mut state = vec![f32::NAN; task.task().morphology.state_dim()];
        world.write_state(&mut state);
        for arm in 0..n {
            let (qpos, qvel, tcp) = (world.qpos(arm), world.qvel(arm), world.tcp_pose(arm));
            for joint in 0..7 {
                assert_eq!(state[n * joint + arm], qpos[joint], "joints of both arms are interleaved");
                assert_eq!(state[9 * n + n * joint + arm], qvel[joint]);
            }
            for finger in 0..2 {
                assert_eq!(state[7 * n + 2 * arm + finger], qpos[7 + finger], "fingers are grouped by arm");
                assert_eq!(state[16 * n + 2 * arm + finger], qvel[7 + finger]);
            }
            let q = tcp.rotation.quaternion();
            let p = tcp.translation.vector;
            let pose = [p.x, p.y, p.z, q.w, q.i, q.j, q.k];
            for copy in 0..n {
                let at = 18 * n + 7 * (n * copy + arm);
                assert_eq!(state[at..at + 7], pose, "arm {arm}, copy {copy}");
            }
        }
    }
}

#[test]
fn snapshot_contains_every_body_and_link() {
    for &task in TaskId::ALL {
        let scene = common::draw(task, Perturbation::None, 0);
        let world = World::build(&scene, ControlMode::JointPos);
        let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        world.write_snapshot(&mut snapshot);
        for (pose, body) in snapshot.bodies.iter().zip(&scene.bodies) {
            assert!((pose.translation.vector.cast() - body.pose.translation.vector).norm() < 1e-6);
            assert!(pose.rotation.cast::<f64>().angle_to(&body.pose.rotation) < 1e-3);
        }
        for (arm, links) in snapshot.arms.iter().enumerate() {
            let base = scene.robots[arm].base.cast::<f32>();
            assert!((links[Link::Link0 as usize].translation.vector - base.translation.vector).norm() < 1e-6);
            let in_hand = |point: [f32; 3]| links[Link::Hand as usize] * nalgebra::Point3::from(point);
            let tcp = world.tcp_pose(arm).translation.vector;
            assert!((in_hand([0.0, 0.0, 0.1034]).coords - tcp).norm() < 1e-5);
            for (finger, side) in [(Link::Finger1, 0.04), (Link::Finger2, -0.04)] {
                let at = links[finger as usize].translation.vector;
                assert!((in_hand([0.0, side, 0.0584]).coords - at).norm() < 1e-5, "open finger at {at}");
            }
        }
    }
}

#[test]
fn whirling_arms_slow_down() {
    // The random policy once reached this state of ScoopBanana, and infinity six control steps later.
    let scene = common::draw(TaskId::ScoopBanana, Perturbation::None, 28);
    let mut world = World::build(&scene, ControlMode::EeDeltaPose);
    let mut state = world.state();
    state.arms[0].qpos = [-2.21, 2.0, -2.17, -1.02, 1.47, 3.76, 0.23, 0.016, 0.037];
    state.arms[0].qvel = [53.4, 45.2, -30.1, -101.8, -24.3, 60.2, -1.8, 24.5, -9.0];
    world.set_state(&state);
    let fastest = |world: &World| world.qvel(0).into_iter().map(f32::abs).fold(0.0, f32::max);
    for _ in 0..100 {
        world.step(&[0.0; 7]);
        assert!(fastest(&world) <= 100.0, "a joint moves at {} rad/s", fastest(&world));
    }
    assert!(world.is_finite() && fastest(&world) < 5.0, "still at {} rad/s", fastest(&world));
}
