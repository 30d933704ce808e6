//! What is only seen or said changes no trajectory of one who neither looks nor listens, and what is seen is seen.

use ipc_types::ControlMode;
use rayon::prelude::*;
use sim::expert::Expert;
use sim::fingerprint::Fingerprint;
use sim::perturb::Modality;
use sim::physics::World;
use sim::render::{CpuRenderer, RenderScene, Renderer, View};
use sim::scene::{Scene, Snapshot};
use sim::{Perturbation, TaskId};

use crate::common::{applies, nominal, perturbed, seeds};

/// Fingerprint of a whole episode of the expert.
fn trajectory(task: TaskId, scene: &Scene) -> u64 {
    let mut world = World::build(scene, ControlMode::JointPos);
    let mut expert = Expert::new(scene, &(task.task().expert)(scene)).unwrap();
    let mut row = vec![0.0; ControlMode::JointPos.action_dim(task.task().morphology)];
    let mut fingerprint = Fingerprint::default();
    world.absorb(&mut fingerprint);
    for _ in 0..task.task().max_steps {
        expert.act(&world, &mut row);
        world.step(&row);
        fingerprint.write(&row);
        world.absorb(&mut fingerprint);
    }
    fingerprint.finish()
}

/// A seed whose episode the expert has a plan for.
fn seed(task: TaskId) -> u64 {
    let plans = |seed: &u64| {
        let scene = nominal(task).draw(*seed);
        Expert::new(&scene, &(task.task().expert)(&scene)).is_ok()
    };
    seeds(task, 10).find(plans).unwrap()
}

#[test]
fn what_is_only_seen_or_said_leaves_the_experts_trajectory_as_it_is() {
    TaskId::ALL.par_iter().for_each(|&task| {
        let seed = seed(task);
        let unperturbed = trajectory(task, &nominal(task).draw(seed));
        let seen_or_said = Perturbation::ALL.iter().filter(|p| !p.changes_bodies() && applies(**p, task));
        seen_or_said.copied().collect::<Vec<_>>().into_par_iter().for_each(|perturbation| {
            let found = trajectory(task, &perturbed(task, perturbation).draw(seed));
            assert_eq!(found, unperturbed, "{} {}", task.name(), perturbation.name());
        });
    });
}

#[test]
fn bodies_that_differ_move_differently() {
    TaskId::ALL.par_iter().for_each(|&task| {
        let unperturbed = World::build(&nominal(task).draw(seed(task)), ControlMode::JointPos);
        for &perturbation in Perturbation::ALL.iter().filter(|p| p.changes_bodies() && applies(**p, task)) {
            let scene = perturbed(task, perturbation).draw(seed(task));
            let fingerprint = |world: &World| {
                let mut fingerprint = Fingerprint::default();
                world.absorb(&mut fingerprint);
                fingerprint.finish()
            };
            let [start, twin] = [&World::build(&scene, ControlMode::JointPos), &unperturbed].map(fingerprint);
            assert_ne!(start, twin, "{} {}", task.name(), perturbation.name());
        }
    });
}

fn images(scene: &Scene) -> Vec<Vec<u8>> {
    let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
    World::build(scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
    let scene = RenderScene::new(scene);
    let draw = |camera_idx| {
        let side = scene.side(camera_idx);
        let mut rgb = vec![0; side * side * 3];
        let view = View { scene: &scene, snapshot: &snapshot, camera_idx, out: &mut rgb };
        CpuRenderer::new(1).render(&mut [view]).unwrap();
        rgb
    };
    (0..scene.n_cameras()).map(draw).collect()
}

#[test]
fn every_visual_factor_is_seen_and_no_word_is() {
    TaskId::ALL.par_iter().for_each(|&task| {
        let seed = seed(task);
        let unperturbed = images(&nominal(task).draw(seed));
        for &perturbation in Perturbation::ALL.iter().filter(|p| applies(**p, task)) {
            let cell = format!("{} {}", task.name(), perturbation.name());
            let (spec, twin) = (perturbed(task, perturbation), &unperturbed);
            let seen = images(&spec.draw(seed));
            match perturbation.modality() {
                None | Some(Modality::Language) => assert_eq!(&seen, twin, "{cell}"),
                Some(_) => assert_ne!(&seen, twin, "{cell}"),
            }
        }
    });
}
