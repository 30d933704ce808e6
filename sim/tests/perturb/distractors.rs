//! Distractor objects: clear of everything else, at rest, and varied.

use std::collections::BTreeSet;

use ipc_types::ControlMode;
use rayon::prelude::*;
use sim::physics::World;
use sim::scene::{Body, Role, Scene};
use sim::{Perturbation, TaskId};

use crate::common::{nominal, perturbed, seeds};

fn distractors(scene: &Scene) -> impl Iterator<Item = &Body> {
    scene.bodies.iter().filter(|body| body.role == Role::Distractor)
}

#[test]
fn distractors_rest_within_their_placement_region() {
    for &task in TaskId::ALL {
        let region = nominal(task).distractors;
        let spec = perturbed(task, Perturbation::DistractorObjects);
        let n_seeds = 200;
        let mut n = 0;
        for seed in seeds(task, n_seeds) {
            for body in distractors(&spec.draw(seed)) {
                let at = body.pose.translation;
                assert!(region.x.contains(at.x) && region.y.contains(at.y), "{}: {at:?}", task.name());
                let lowest = body.aabb(&body.pose).min.z;
                assert!((lowest - region.surface_z_m).abs() < 1e-6, "{}: {lowest}", task.name());
                n += 1;
            }
        }
        let expected = f64::from(n_seeds) * region.n as f64;
        assert!(f64::from(n) > 0.97 * expected, "{}: {n} of {expected} were placed", task.name());
    }
}

#[test]
fn distractors_stay_at_rest_without_initial_contact() {
    TaskId::ALL.par_iter().for_each(|&task| {
        let spec = perturbed(task, Perturbation::DistractorObjects);
        for seed in seeds(task, 6) {
            let scene = spec.draw(seed);
            let mut world = World::build(&scene, ControlMode::JointPos);
            let mut row = vec![0.0; ControlMode::JointPos.action_dim(task.task().morphology)];
            for (arm, row) in row.chunks_exact_mut(8).enumerate() {
                row[..7].copy_from_slice(&world.qpos(arm)[..7]);
                row[7] = 1.0;
            }
            let poses = |world: &World| -> Vec<_> {
                let idxs = (0..scene.bodies.len()).filter(|idx| scene.bodies[*idx].role == Role::Distractor);
                idxs.map(|idx| world.body_pose(idx)).collect()
            };
            let start = poses(&world);
            for step in 0..20 {
                world.step(&row);
                if step == 0 {
                    // The wrist camera may touch the chest of PlaceCubeInDrawer at the start.
                    assert!(world.max_penetration() < 2e-3, "{}: {}", task.name(), world.max_penetration());
                }
            }
            for (pose, before) in poses(&world).iter().zip(&start) {
                let moved = (pose.translation.vector - before.translation.vector).norm();
                let turned = pose.rotation.angle_to(&before.rotation);
                assert!(moved < 1e-3 && turned < 0.01, "{}: {moved} m, {turned} rad", task.name());
            }
        }
    });
}

#[test]
fn distractors_are_of_many_kinds() {
    let spec = perturbed(TaskId::RaiseCube, Perturbation::DistractorObjects);
    let mut kinds = BTreeSet::new();
    let mut solids = BTreeSet::new();
    for seed in seeds(TaskId::RaiseCube, 2000) {
        for body in distractors(&spec.draw(seed)) {
            // Kinds are distinguished by the types of their parts and visuals, in order.
            let type_name = |text: String| text.split([' ', '{', '(']).next().unwrap_or_default().to_owned();
            let parts: Vec<String> =
                body.parts.iter().map(|part| type_name(format!("{:?}", part.shape))).collect();
            let visuals: Vec<String> =
                body.visuals.iter().map(|v| type_name(format!("{:?}", v.shape))).collect();
            solids.insert(format!(
                "{:?}",
                body.parts.iter().map(|part| part.shape.clone()).collect::<Vec<_>>()
            ));
            kinds.insert((parts, visuals));
        }
    }
    assert!(kinds.len() >= 20, "{} kinds", kinds.len());
    assert!(solids.len() > 1000, "{} distinct sets of parts", solids.len());
}

#[test]
fn distractors_of_one_episode_rarely_coincide() {
    let spec = perturbed(TaskId::RaiseCube, Perturbation::DistractorObjects);
    let mut n_alike = 0;
    for seed in seeds(TaskId::RaiseCube, 300) {
        let scene = spec.draw(seed);
        if let [a, b] = distractors(&scene).collect::<Vec<_>>()[..] {
            n_alike += usize::from(a.parts == b.parts);
        }
    }
    assert!(n_alike < 6, "{n_alike} of 300 episodes have two equal distractors");
}
