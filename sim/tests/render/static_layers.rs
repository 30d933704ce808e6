//! Cached static layers change no byte.

use ipc_types::{ControlMode, ImageSizes};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use sim::physics::World;
use sim::render::{CpuOptions, CpuRenderer, RenderScene, Samples, View};
use sim::scene::stream::episode_seed;
use sim::scene::{Link, Scene, Snapshot};
use sim::{Perturbation, Profile, TaskId};

use crate::common::{first_scene, perturbed};

/// Renders all images of a scene at some snapshots, each with a new renderer.
fn render_independently(scene: &Scene, options: CpuOptions, snapshots: &[Snapshot]) -> Vec<Vec<u8>> {
    let images = |snapshot| {
        CpuRenderer::with_options(1, options)
            .render_cameras(&RenderScene::new(scene, ImageSizes::BENCHMARK), snapshot)
            .into_iter()
    };
    snapshots.iter().flat_map(images).map(|(_, image)| image).collect()
}

/// Renders all images of a scene at some snapshots with one renderer, and another scene in between.
fn render_sequence(scene: &Scene, options: CpuOptions, snapshots: &[Snapshot]) -> Vec<Vec<u8>> {
    let (render_scene, (mut other, other_snapshot)) =
        (RenderScene::new(scene, ImageSizes::BENCHMARK), first_scene(TaskId::DualArmLiftTray));
    other.lights.shadows = scene.lights.shadows;
    let other = RenderScene::new(&other, ImageSizes::BENCHMARK);
    let mut renderer = CpuRenderer::with_options(1, options);
    let mut images = Vec::new();
    let mut draw = |scene: &RenderScene, snapshot: &Snapshot, camera_idx: usize| {
        let mut out = vec![7; scene.size(camera_idx).n_bytes()];
        renderer.draw(&mut [View { scene, snapshot, camera_idx, out: &mut out }]);
        out
    };
    for snapshot in snapshots {
        for camera_idx in 0..render_scene.n_cameras() {
            images.push(draw(&render_scene, snapshot, camera_idx));
        }
        draw(&other, &other_snapshot, 0);
    }
    images
}

/// Returns snapshots in which everything that moves sweeps around the robot base and finally falls through
/// the table. The bases of the arms stay in place.
fn snapshots(start: &Snapshot) -> Vec<Snapshot> {
    let sweep = |step: u16| {
        let mut snapshot = start.clone();
        let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * (0.17 * f32::from(step)));
        let fall = Vector3::z() * -(f32::from(step) * 0.2 - 1.0).max(0.0);
        let motion = Isometry3::from_parts(fall.into(), turn);
        let links = snapshot.arms.iter_mut().flat_map(|links| &mut links[Link::Link1 as usize..]);
        for pose in snapshot.bodies.iter_mut().chain(links) {
            *pose = motion * *pose;
        }
        snapshot
    };
    (0..12).map(sweep).collect()
}

#[test]
fn layers_change_no_byte_while_bodies_move() {
    for &task in TaskId::ALL {
        let (mut scene, start) = first_scene(task);
        let snapshots = snapshots(&start);
        for (shadows, samples) in
            [(false, Samples::One), (true, Samples::One), (false, Samples::Four), (true, Samples::Four)]
        {
            scene.lights.shadows = shadows;
            let [cached, uncached] = [true, false].map(|static_layers| {
                render_sequence(&scene, CpuOptions { static_layers, samples }, &snapshots)
            });
            let expected =
                render_independently(&scene, CpuOptions { static_layers: false, samples }, &snapshots);
            for (i, expected) in expected.iter().enumerate() {
                let case = format!("{task:?}, shadows {shadows}, {samples:?}: image {i}");
                assert!(&cached[i] == expected, "{case}, cached layers");
                assert!(&uncached[i] == expected, "{case}, no layers");
            }
            assert!(cached[0] != cached[cached.len() - scene.cameras.len()], "{task:?}: no image changed");
        }
    }
}

/// Returns scenes of a task under every applicable perturbation: two episodes, and the first of them again
/// with shadows.
fn perturbed_scenes(task: TaskId) -> Vec<(Scene, Snapshot)> {
    let nominal = (task.task().nominal)(Profile::Strict);
    let mut all = Vec::new();
    for &perturbation in Perturbation::ALL.iter().filter(|p| p.applies_to(&nominal).is_ok()) {
        for (episode, shadows) in [(0, false), (1, false), (0, true)] {
            let mut scene = perturbed(task, perturbation).draw(episode_seed(0, task.name(), episode));
            scene.lights.shadows |= shadows;
            let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
            World::build(&scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
            all.push((scene, snapshot));
        }
    }
    all
}

#[test]
fn renderer_keeps_scenes_apart() {
    for task in [TaskId::RaiseCube, TaskId::OpenCabinet, TaskId::DualArmLiftTray] {
        let scenes: Vec<_> = perturbed_scenes(task)
            .into_iter()
            .map(|(scene, at)| (RenderScene::new(&scene, ImageSizes::BENCHMARK), at))
            .collect();
        let mut renderer = CpuRenderer::new(2);
        let mut together: Vec<Vec<Vec<u8>>> = scenes
            .iter()
            .map(|(scene, _)| (0..scene.n_cameras()).map(|c| vec![0; scene.size(c).n_bytes()]).collect())
            .collect();
        let mut views: Vec<View<'_>> = scenes
            .iter()
            .zip(&mut together)
            .flat_map(|((scene, snapshot), images)| {
                let images = images.iter_mut().enumerate();
                images.map(move |(camera_idx, out)| View { scene, snapshot, camera_idx, out })
            })
            .collect();
        renderer.draw(&mut views);
        for (i, ((scene, snapshot), together)) in scenes.iter().zip(&together).enumerate() {
            let options = CpuOptions { static_layers: false, samples: Samples::One };
            let alone = CpuRenderer::with_options(1, options).render_cameras(scene, snapshot);
            for (camera_idx, ((_, alone), together)) in alone.iter().zip(together).enumerate() {
                assert!(alone == together, "{task:?}: scene {i}, camera {camera_idx}");
            }
        }
    }
}
