//! An image is a function of its scene, snapshot and camera: it depends on all three and on nothing else.

use ipc_types::ImageSizes;
use sim::TaskId;
use sim::render::{CpuRenderer, RenderScene, Renderer, View};
use sim::scene::{Link, Snapshot};

use crate::common::{bounds, first_scene, n_different_pixels, render};

/// Renders all images of all tasks in one batch on `n_threads` threads, into buffers filled with `garbage`.
fn render_batch(n_threads: usize, reversed: bool, garbage: u8) -> Vec<Vec<u8>> {
    let scenes: Vec<(RenderScene, Snapshot)> = TaskId::ALL
        .iter()
        .map(|task| {
            let (scene, snapshot) = first_scene(*task);
            (RenderScene::new(&scene, ImageSizes::BENCHMARK), snapshot)
        })
        .collect();
    let cameras: Vec<(usize, usize)> = scenes
        .iter()
        .enumerate()
        .flat_map(|(s, (scene, _))| (0..scene.n_cameras()).map(move |c| (s, c)))
        .collect();
    let mut images: Vec<Vec<u8>> =
        cameras.iter().map(|&(s, c)| vec![garbage; scenes[s].0.size(c).n_bytes()]).collect();
    let mut views: Vec<View<'_>> = cameras
        .iter()
        .zip(&mut images)
        .map(|(&(s, camera_idx), out)| View { scene: &scenes[s].0, snapshot: &scenes[s].1, camera_idx, out })
        .collect();
    if reversed {
        views.reverse();
    }
    let mut renderer = CpuRenderer::new(n_threads);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
    pool.install(|| renderer.render(&mut views)).unwrap();
    images
}

#[test]
fn bytes_are_independent_of_threads_batch_and_buffer() {
    let one_by_one: Vec<Vec<u8>> = TaskId::ALL
        .iter()
        .flat_map(|task| {
            let (scene, snapshot) = first_scene(*task);
            (0..scene.cameras.len()).map(move |c| render(&scene, &snapshot, c)).collect::<Vec<_>>()
        })
        .collect();
    for (n_threads, reversed, garbage) in [(1, false, 0), (1, true, 7), (2, false, 255), (3, true, 255)] {
        assert!(
            render_batch(n_threads, reversed, garbage) == one_by_one,
            "{n_threads} threads, reversed: {reversed}"
        );
    }
}

#[test]
fn moving_a_body_changes_only_its_surroundings() {
    let (scene, before) = first_scene(TaskId::RaiseCube);
    let mut after = before.clone();
    after.bodies[0].translation.x += 0.03;
    for camera_idx in 0..2 {
        let side = RenderScene::new(&scene, ImageSizes::BENCHMARK).size(camera_idx).width;
        let (old, new) = (render(&scene, &before, camera_idx), render(&scene, &after, camera_idx));
        let changed: Vec<[usize; 2]> = old
            .chunks_exact(3)
            .zip(new.chunks_exact(3))
            .enumerate()
            .filter(|(_, (a, b))| a != b)
            .map(|(i, _)| [i % side, i / side])
            .collect();
        let [min, max] = bounds(&changed);
        // A cube of 4 cm moves by 3 cm, at least 0.2 m from the camera.
        assert!(changed.len() > 20, "{} pixels", changed.len());
        for axis in 0..2 {
            assert!(max[axis] - min[axis] < 50, "{min:?} to {max:?}");
        }
    }
}

#[test]
fn hand_camera_follows_hand_and_sees_fingers() {
    let (scene, open) = first_scene(TaskId::RaiseCube);
    let mut closed = open.clone();
    let hand = open.arms[0][Link::Hand as usize];
    for finger in [Link::Finger1, Link::Finger2] {
        closed.arms[0][finger as usize] = hand * nalgebra::Isometry3::translation(0.0, 0.0, 0.0584);
    }
    let changed = n_different_pixels(&render(&scene, &open, 2), &render(&scene, &closed, 2));
    assert!((300..6000).contains(&changed), "{changed} pixels change as the fingers close");
    let mut higher = open.clone();
    for link in &mut higher.arms[0] {
        link.translation.z += 0.1;
    }
    let changed = n_different_pixels(&render(&scene, &open, 2), &render(&scene, &higher, 2));
    assert!(changed > 6000, "{changed} pixels change as the hand rises");
}
