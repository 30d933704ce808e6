//! The ceiling and the floor: experts succeed within the episode's limit, idleness never does.

use ipc_types::ControlMode;
use rayon::prelude::*;
use sim::expert::{Expert, Move, PlanError};
use sim::physics::World;
use sim::predicate::first_unmet;
use sim::{Perturbation, Profile, TaskId};

use super::common;

/// Episodes per task and perturbation.
const N_EPISODES: u32 = 6;

/// First step after which the task has succeeded, if any; `None` for the plan holds still.
fn first_success(task: TaskId, perturbation: Perturbation, episode_idx: u32, expert: bool) -> Option<u32> {
    let scene = common::draw(task, perturbation, episode_idx);
    let success = (task.task().success)(&scene, Profile::Strict);
    let moves = if expert { (task.task().expert)(&scene) } else { vec![Move::Hold { steps: 1 }] };
    let mut expert = Expert::new(&scene, &moves).expect("the plan is within reach");
    let mut world = World::build(&scene, ControlMode::JointPos);
    assert!(first_unmet(&success, &world).is_some(), "{}: success at reset", task.name());
    let mut row = common::zeros(&scene, ControlMode::JointPos);
    (1..=task.task().max_steps).find(|_| {
        expert.act(&world, &mut row);
        world.step(&row);
        first_unmet(&success, &world).is_none()
    })
}

fn all_cases() -> Vec<(TaskId, Perturbation)> {
    TaskId::ALL.iter().flat_map(|&task| Perturbation::ALL.iter().map(move |&p| (task, p))).collect()
}

#[test]
fn experts_succeed_under_every_perturbation() {
    all_cases().into_iter().for_each(|(task, perturbation)| {
        let failed: Vec<u32> = (0..N_EPISODES)
            .into_par_iter()
            .filter(|episode_idx| first_success(task, perturbation, *episode_idx, true).is_none())
            .collect();
        assert!(failed.is_empty(), "{} {}: episodes {failed:?} failed", task.name(), perturbation.name());
    });
}

#[test]
fn experts_take_about_as_long_as_the_benchmarks_demonstrations() {
    for (task, demo_steps) in
        [(TaskId::RaiseCube, 78.0), (TaskId::StackCube, 107.0), (TaskId::DualArmLiftTray, 105.0)]
    {
        let steps: usize = (0..N_EPISODES)
            .map(|episode_idx| {
                let scene = common::draw(task, Perturbation::None, episode_idx);
                Expert::new(&scene, &(task.task().expert)(&scene)).expect("reachable").n_steps()
            })
            .sum();
        let ratio = steps as f64 / f64::from(N_EPISODES) / demo_steps;
        assert!((0.65..1.35).contains(&ratio), "{}: {ratio} of the demonstrations' length", task.name());
    }
}

#[test]
fn idleness_never_succeeds() {
    all_cases().into_par_iter().for_each(|(task, perturbation)| {
        assert_eq!(
            first_success(task, perturbation, 0, false),
            None,
            "{} {}",
            task.name(),
            perturbation.name()
        );
    });
}

#[test]
fn a_plan_out_of_reach_names_its_move() {
    let scene = common::draw(TaskId::RaiseCube, Perturbation::None, 0);
    let mut tcp = sim::expert::grasp::start_tcp(&scene, 0);
    tcp.translation.vector.x = 2.0;
    let moves = [Move::Hold { steps: 2 }, Move::straight(0, tcp)];
    let error = Expert::new(&scene, &moves).expect_err("two metres away");
    assert!(matches!(error, PlanError { move_idx: 1, name: "straight", arm: 0, .. }), "{error:?}");
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
