//! Keeping what stands still saves work and changes no byte.

use sim::TaskId;
use sim::render::{CpuOptions, CpuRenderer, RenderScene, View};
use sim::scene::Snapshot;

use crate::common::drawn;

/// All images of a scene at some moments, one after the other by one renderer.
fn film(task: TaskId, keep_layers: bool, moments: &[Snapshot]) -> Vec<Vec<u8>> {
    let render = RenderScene::new(&drawn(task).0);
    let mut renderer = CpuRenderer::with_options(1, CpuOptions { keep_layers, ..CpuOptions::default() });
    let mut images = Vec::new();
    for snapshot in moments {
        for camera_idx in 0..render.n_cameras() {
            let mut out = vec![7; render.side(camera_idx).pow(2) * 3];
            renderer.draw(&mut [View { scene: &render, snapshot, camera_idx, out: &mut out }]);
            images.push(out);
        }
    }
    images
}

#[test]
fn layers_change_no_byte_as_things_move() {
    for &task in TaskId::ALL {
        let (_, start) = drawn(task);
        let moments: Vec<Snapshot> = (0..4)
            .map(|step| {
                let mut snapshot = start.clone();
                let far = 0.013 * step as f32;
                for body in &mut snapshot.bodies {
                    body.translation.x += far;
                    body.translation.z += far;
                }
                for link in snapshot.arms.iter_mut().flatten() {
                    link.translation.y -= far;
                }
                snapshot
            })
            .collect();
        let (kept, drawn_anew) = (film(task, true, &moments), film(task, false, &moments));
        assert!(kept == drawn_anew, "{task:?}");
        assert!(kept[0] != kept[kept.len() - drawn(task).0.cameras.len()], "{task:?}: nothing moved");
    }
}
