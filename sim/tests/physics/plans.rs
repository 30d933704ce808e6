//! Plans: what is out of reach, what comes after the end, and places that are passed without a stop.

use ipc_types::ControlMode;
use sim::expert::{Expert, MotionPlanError, Move, TcpGoal, first_feasible, grasp};
use sim::physics::World;
use sim::{Perturbation, TaskId};

use super::common;

#[test]
fn a_plan_out_of_reach_names_its_move() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let mut tcp = grasp::start_tcp(&scene, 0);
    tcp.translation.vector.x = 2.0;
    let moves = [Move::Hold { steps: 2 }, Move::straight(0, tcp)];
    let error = Expert::new(&scene, &moves).expect_err("two metres away");
    assert!(matches!(error, MotionPlanError { move_idx: 1, name: "straight", arm: 0, .. }), "{error:?}");
    assert!(error.to_string().starts_with("move 1 (straight): arm 1 has no joint positions"), "{error}");
}

#[test]
fn an_ended_plan_keeps_its_last_row() {
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
fn places_are_passed_without_a_stop() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let start = grasp::start_tcp(&scene, 0);
    let places = [[0.03, 0.0, 0.0], [0.06, 0.01, 0.0], [0.09, 0.03, 0.0]]
        .map(|by| grasp::translated(&start, &by.into()))
        .map(|tcp| vec![TcpGoal { arm: 0, tcp }]);
    let stopping: Vec<Move> = places.iter().cloned().map(Move::Straight).collect();
    let n_steps = |moves: &[Move]| Expert::new(&scene, moves).expect("reachable").n_steps();
    let passing = [Move::Waypoints(places.to_vec())];
    assert!(n_steps(&passing) + 10 < n_steps(&stopping));
    let mut nearest = [f64::INFINITY; 3];
    let end = common::play(&scene, &passing, 20, |_, world| {
        for (nearest, place) in nearest.iter_mut().zip(&places) {
            let miss = world.tcp_pose(0).cast::<f64>().translation.vector - place[0].tcp.translation.vector;
            *nearest = nearest.min(miss.norm());
        }
    });
    assert!(nearest.iter().all(|miss| *miss < 0.01), "{nearest:?}");
    let last = end.tcp_pose(0).cast::<f64>().translation.vector - places[2][0].tcp.translation.vector;
    assert!(last.norm() < 1e-3, "{last}");
}

#[test]
fn the_first_plan_in_reach_and_in_time_is_taken() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let out_of_reach =
        vec![Move::straight(0, grasp::translated(&grasp::start_tcp(&scene, 0), &[2.0, 0.0, 0.0].into()))];
    let [long, short] = [50, 5].map(|steps| vec![Move::Hold { steps }]);
    let taken = |plans: Vec<Vec<Move>>| first_feasible(&scene, 20, plans.into_iter());
    assert_eq!(taken(vec![out_of_reach.clone(), long.clone(), short.clone()]), short);
    assert_eq!(taken(vec![long.clone(), out_of_reach]), long, "the first of all, as none is in time");
}
