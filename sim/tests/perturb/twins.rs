//! Perturbations that change only images or instructions leave the world, and so the trajectory of a blind
//! policy, unchanged. Every visual perturbation changes the images.

use ipc_types::{ControlMode, ImageSizes};
use rayon::prelude::*;
use sim::expert::Expert;
use sim::perturb::{Composition, Modality, Strength};
use sim::physics::World;
use sim::physics::fingerprint::Fingerprint;
use sim::render::{CpuRenderer, RenderScene, Renderer, View};
use sim::scene::{Appearance, Background, Lights, Scene, Snapshot, Table};
use sim::{Perturbation, Profile, TaskId};

use crate::common::{applies, nominal, perturbed, seeds};

/// Runs an episode of the expert and returns its fingerprint.
fn trajectory(task: TaskId, scene: &Scene) -> u64 {
    let mut world = World::build(scene, ControlMode::JointPos);
    let mut expert = Expert::new(scene, &(task.task().expert)(scene)).unwrap();
    let mut row = vec![0.0; ControlMode::JointPos.action_dim(task.task().morphology)];
    let mut fingerprint = Fingerprint::default();
    world.hash_state(&mut fingerprint);
    for _ in 0..task.task().max_steps {
        expert.act(&world, &mut row);
        world.step(&row);
        fingerprint.write(&row);
        world.hash_state(&mut fingerprint);
    }
    fingerprint.finish()
}

/// Returns a seed for whose scene the expert finds a plan.
fn feasible_seed(task: TaskId) -> u64 {
    let is_feasible = |seed: &u64| {
        let scene = nominal(task).draw(*seed);
        Expert::new(&scene, &(task.task().expert)(&scene)).is_ok()
    };
    seeds(task, 10).find(is_feasible).unwrap()
}

/// Returns the scene reduced to what the physics world is built from.
fn physical(mut scene: Scene) -> Scene {
    let blank = Appearance { color: [0.0; 3], texture: None, specular: 0.0, metallic: 0.0 };
    for body in &mut scene.bodies {
        body.parts.iter_mut().for_each(|part| part.appearance = blank);
        body.visuals.clear();
    }
    let Scene { bodies, physics_hz, robots, table, .. } = scene;
    let kind = table.kind;
    let table = Table { kind, top: blank, legs: blank, lower_top: None, as_block: false };
    let background = Background { floor: blank, walls: None };
    let lights = Lights { ambient: [0.0; 3], directional: Vec::new(), shadows: false };
    Scene {
        sizes: Vec::new(),
        bodies,
        physics_hz,
        robots,
        table,
        background,
        lights,
        cameras: Vec::new(),
        instruction: String::new(),
    }
}

#[test]
fn physical_scene_differs_only_if_bodies_change() {
    for &task in TaskId::ALL {
        let seed = feasible_seed(task);
        let unperturbed = physical(nominal(task).draw(seed));
        for &perturbation in Perturbation::ALL.iter().filter(|p| applies(**p, task)) {
            let differs = physical(perturbed(task, perturbation).draw(seed)) != unperturbed;
            assert_eq!(differs, perturbation.changes_bodies(), "{} {}", task.name(), perturbation.name());
        }
    }
}

/// Tests two perturbations per task, so that every perturbation is tested on several tasks, and all of them
/// combined.
#[test]
fn visual_and_language_perturbations_keep_the_experts_trajectory() {
    TaskId::ALL.par_iter().enumerate().for_each(|(task_idx, &task)| {
        let seed = feasible_seed(task);
        let applying =
            Perturbation::ALL.iter().copied().filter(|p| *p != Perturbation::None && applies(*p, task));
        let candidates: Vec<Perturbation> = applying.filter(|p| !p.changes_bodies()).collect();
        let compatible = candidates
            .iter()
            .copied()
            .filter(|p| p.modality() != Some(Modality::Language) || *p == Perturbation::LanguageParaphrase);
        let combined = Composition::new(&compatible.collect::<Vec<_>>()).unwrap();
        let alone =
            [2 * task_idx, 2 * task_idx + 1].map(|i| Composition::from(candidates[i % candidates.len()]));
        let unperturbed = trajectory(task, &nominal(task).draw(seed));
        for perturbation in [combined].into_iter().chain(alone) {
            let spec = perturbation.spec(task.task(), Profile::Strict, Strength::FULL);
            assert_eq!(trajectory(task, &spec.draw(seed)), unperturbed, "{} {perturbation:?}", task.name());
        }
    });
}

fn images(scene: &Scene) -> Vec<Vec<u8>> {
    let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
    World::build(scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
    let scene = RenderScene::new(scene, ImageSizes::BENCHMARK);
    let render = |camera_idx| {
        let mut rgb = vec![0; scene.size(camera_idx).n_bytes()];
        let view = View { scene: &scene, snapshot: &snapshot, camera_idx, out: &mut rgb };
        CpuRenderer::new(1).render(&mut [view]).unwrap();
        rgb
    };
    (0..scene.n_cameras()).map(render).collect()
}

#[test]
fn images_change_under_all_but_language_perturbations() {
    TaskId::ALL.par_iter().for_each(|&task| {
        let seed = feasible_seed(task);
        let unperturbed = images(&nominal(task).draw(seed));
        for &perturbation in Perturbation::ALL.iter().filter(|p| applies(**p, task)) {
            let cell = format!("{} {}", task.name(), perturbation.name());
            let (spec, twin) = (perturbed(task, perturbation), &unperturbed);
            let rendered = images(&spec.draw(seed));
            match perturbation.modality() {
                None | Some(Modality::Language) => assert_eq!(&rendered, twin, "{cell}"),
                Some(_) => assert_ne!(&rendered, twin, "{cell}"),
            }
        }
    });
}
