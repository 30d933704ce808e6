//! Motion plans: unreachable goals, the end of a plan, and waypoints.

use ipc_types::ControlMode;
use sim::expert::{Expert, MotionPlanError, Move, TcpGoal, first_feasible, grasp};
use sim::physics::World;
use sim::{Perturbation, TaskId};

use super::common;

#[test]
fn unreachable_plan_names_its_move() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let mut tcp = grasp::start_tcp(&scene, 0);
    tcp.translation.vector.x = 2.0;
    let moves = [Move::Hold { steps: 2 }, Move::straight(0, tcp)];
    let error = Expert::new(&scene, &moves).expect_err("the goal is 2 m away");
    assert!(matches!(error, MotionPlanError { move_idx: 1, name: "straight", arm: 0, .. }), "{error:?}");
    assert!(error.to_string().starts_with("move 1 (straight): arm 1 has no joint positions"), "{error}");
}

#[test]
fn ended_plan_repeats_its_last_row() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let world = World::build(&scene, ControlMode::JointPos);
    let mut expert = Expert::new(&scene, &[Move::close(&[0], 3)]).expect("reachable");
    let mut rows = vec![[0.0_f32; 8]; 6];
    for row in &mut rows {
        expert.act(&world, row);
    }
    assert_eq!(rows[5], rows[3]);
    assert_eq!(rows[5][7], -1.0);
}

#[test]
fn waypoints_are_passed_without_stopping() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let start = grasp::start_tcp(&scene, 0);
    let waypoints = [[0.03, 0.0, 0.0], [0.06, 0.01, 0.0], [0.09, 0.03, 0.0]]
        .map(|by| grasp::translated(&start, &by.into()))
        .map(|tcp| vec![TcpGoal { arm: 0, tcp }]);
    let stopping: Vec<Move> = waypoints.iter().cloned().map(Move::Straight).collect();
    let n_steps = |moves: &[Move]| Expert::new(&scene, moves).expect("reachable").n_steps();
    let passing = [Move::Waypoints(waypoints.to_vec())];
    assert!(n_steps(&passing) + 10 < n_steps(&stopping));
    let mut nearest = [f64::INFINITY; 3];
    let end = common::play(&scene, &passing, 20, |_, world| {
        for (nearest, waypoint) in nearest.iter_mut().zip(&waypoints) {
            let miss =
                world.tcp_pose(0).cast::<f64>().translation.vector - waypoint[0].tcp.translation.vector;
            *nearest = nearest.min(miss.norm());
        }
    });
    assert!(nearest.iter().all(|miss| *miss < 0.01), "{nearest:?}");
    let last = end.tcp_pose(0).cast::<f64>().translation.vector - waypoints[2][0].tcp.translation.vector;
    assert!(last.norm() < 1e-3, "{last}");
}

#[test]
fn first_feasible_plan_is_chosen() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let out_of_reach =
        vec![Move::straight(0, grasp::translated(&grasp::start_tcp(&scene, 0), &[2.0, 0.0, 0.0].into()))];
    let [long, short] = [50, 5].map(|steps| vec![Move::Hold { steps }]);
    let chosen = |plans: Vec<Vec<Move>>| first_feasible(&scene, 20, plans.into_iter());
    assert_eq!(chosen(vec![out_of_reach.clone(), long.clone(), short.clone()]), short);
    assert_eq!(chosen(vec![long.clone(), out_of_reach]), long, "the first plan, as none is feasible");
}
