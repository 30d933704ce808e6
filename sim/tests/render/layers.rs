//! Keeping what stands still saves work and changes no byte.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use sim::TaskId;
use sim::render::{CpuOptions, CpuRenderer, RenderScene, Samples, View};
use sim::scene::{Scene, Snapshot};

use crate::common::drawn;

/// All images of a scene at some moments, one after the other by one renderer, which makes some of another scene in between.
fn film(scene: &Scene, options: CpuOptions, moments: &[Snapshot]) -> Vec<Vec<u8>> {
    let (render, (mut other, elsewhere)) = (RenderScene::new(scene), drawn(TaskId::DualArmLiftTray));
    other.lights.shadows = scene.lights.shadows;
    let other = RenderScene::new(&other);
    let mut renderer = CpuRenderer::with_options(1, options);
    let mut images = Vec::new();
    let mut draw = |scene: &RenderScene, snapshot: &Snapshot, camera_idx: usize| {
        let mut out = vec![7; scene.side(camera_idx).pow(2) * 3];
        renderer.draw(&mut [View { scene, snapshot, camera_idx, out: &mut out }]);
        out
    };
    for snapshot in moments {
        for camera_idx in 0..render.n_cameras() {
            images.push(draw(&render, snapshot, camera_idx));
        }
        draw(&other, &elsewhere, 0);
    }
    images
}

/// The start, then everything that moves sweeps around the robot's base, and falls through the table in the end.
fn moments(start: &Snapshot) -> Vec<Snapshot> {
    let sweep = |step: u16| {
        let mut snapshot = start.clone();
        let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * (0.17 * f32::from(step)));
        let fall = Vector3::z() * -(f32::from(step) * 0.2 - 1.0).max(0.0);
        let motion = Isometry3::from_parts(fall.into(), turn);
        for pose in snapshot.bodies.iter_mut().chain(snapshot.arms.iter_mut().flatten()) {
            *pose = motion * *pose;
        }
        snapshot
    };
    (0..12).map(sweep).collect()
}

#[test]
fn layers_change_no_byte_as_things_move() {
    for &task in TaskId::ALL {
        let (mut scene, start) = drawn(task);
        let moments = moments(&start);
        for (shadows, samples) in
            [(false, Samples::One), (true, Samples::One), (false, Samples::Four), (true, Samples::Four)]
        {
            scene.lights.shadows = shadows;
            let [kept, drawn_anew] =
                [true, false].map(|keep_layers| film(&scene, CpuOptions { keep_layers, samples }, &moments));
            for (i, (kept, drawn_anew)) in kept.iter().zip(&drawn_anew).enumerate() {
                assert!(kept == drawn_anew, "{task:?}, shadows {shadows}, {samples:?}: image {i}");
            }
            assert!(kept[0] != kept[kept.len() - scene.cameras.len()], "{task:?}: nothing moved");
        }
    }
}
