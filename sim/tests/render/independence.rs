//! A picture is a function of its scene, snapshot and camera: of nothing else, and of all of them.

use sim::TaskId;
use sim::render::{CpuRenderer, RenderScene, Renderer, View};
use sim::scene::{Link, Snapshot};

use crate::common::{drawn, image};

/// All images of all tasks, rendered in one batch on this many threads, into buffers that start as `garbage`.
fn batch(n_threads: usize, reversed: bool, garbage: u8) -> Vec<Vec<u8>> {
    let scenes: Vec<(RenderScene, Snapshot)> = TaskId::ALL
        .iter()
        .map(|task| {
            let (scene, snapshot) = drawn(*task);
            (RenderScene::new(&scene), snapshot)
        })
        .collect();
    let cameras: Vec<(usize, usize)> = scenes
        .iter()
        .enumerate()
        .flat_map(|(s, (scene, _))| (0..scene.n_cameras()).map(move |c| (s, c)))
        .collect();
    let mut images: Vec<Vec<u8>> =
        cameras.iter().map(|&(s, c)| vec![garbage; scenes[s].0.side(c).pow(2) * 3]).collect();
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
fn bytes_do_not_depend_on_threads_batch_order_or_what_was_there() {
    let one_by_one: Vec<Vec<u8>> = TaskId::ALL
        .iter()
        .flat_map(|task| {
            let (scene, snapshot) = drawn(*task);
            (0..scene.cameras.len()).map(move |c| image(&scene, &snapshot, c)).collect::<Vec<_>>()
        })
        .collect();
    for (n_threads, reversed, garbage) in [(1, false, 0), (1, true, 7), (2, false, 255), (3, true, 255)] {
        assert!(
            batch(n_threads, reversed, garbage) == one_by_one,
            "{n_threads} threads, reversed: {reversed}"
        );
    }
}

#[test]
fn moving_a_body_changes_the_image_where_the_body_is() {
    let (scene, before) = drawn(TaskId::RaiseCube);
    let mut after = before.clone();
    after.bodies[0].translation.x += 0.03;
    for camera_idx in 0..2 {
        let render = RenderScene::new(&scene);
        let side = render.side(camera_idx);
        let (old, new) = (image(&scene, &before, camera_idx), image(&scene, &after, camera_idx));
        let changed: Vec<[usize; 2]> = old
            .chunks_exact(3)
            .zip(new.chunks_exact(3))
            .enumerate()
            .filter(|(_, (a, b))| a != b)
            .map(|(i, _)| [i % side, i / side])
            .collect();
        let [least, greatest] = crate::common::bounds(&changed);
        // A cube of 4 cm that moves 3 cm, seen from no nearer than 0.2 m.
        assert!(changed.len() > 20, "{} pixels", changed.len());
        for axis in 0..2 {
            assert!(greatest[axis] - least[axis] < 50, "{least:?} to {greatest:?}");
        }
    }
}

#[test]
fn the_hand_camera_moves_with_the_hand_and_sees_the_fingers() {
    let (scene, open) = drawn(TaskId::RaiseCube);
    let mut closed = open.clone();
    let hand = open.arms[0][Link::Hand as usize];
    for finger in [Link::Finger1, Link::Finger2] {
        closed.arms[0][finger as usize] = hand * nalgebra::Isometry3::translation(0.0, 0.0, 0.0584);
    }
    let changed = differing(&image(&scene, &open, 2), &image(&scene, &closed, 2));
    assert!((300..6000).contains(&changed), "{changed} pixels change as the fingers close");
    let mut higher = open.clone();
    for link in &mut higher.arms[0] {
        link.translation.z += 0.1;
    }
    let changed = differing(&image(&scene, &open, 2), &image(&scene, &higher, 2));
    assert!(changed > 6000, "{changed} pixels change as the hand rises");
}

/// Pixels that differ.
pub(crate) fn differing(a: &[u8], b: &[u8]) -> usize {
    a.chunks_exact(3).zip(b.chunks_exact(3)).filter(|(a, b)| a != b).count()
}
