//! Behaviour after a device failure, and when unused meshes are removed.

use super::{AdapterKind, GpuOptions, GpuRenderer};
use crate::perturb::{Composition, Strength};
use crate::render::{RenderScene, Renderer, View};
use crate::scene::Snapshot;
use crate::{Perturbation, Profile, TaskId};

#[test]
fn render_fails_permanently_after_device_loss() {
    let Ok(mut renderer) = GpuRenderer::open(AdapterKind::Software, &GpuOptions::default()) else { return };
    let scene = (TaskId::RaiseCube.task().nominal)().draw(3);
    let snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
    let scene = RenderScene::new(&scene);
    let mut out = vec![0; scene.side(0).pow(2) * 3];
    let mut render = |renderer: &mut GpuRenderer| {
        renderer.render(&mut [View { scene: &scene, snapshot: &snapshot, camera_idx: 0, out: &mut out }])
    };
    render(&mut renderer).unwrap();
    renderer.gpu.device.destroy();
    for _ in 0..2 {
        let error = render(&mut renderer).unwrap_err().to_string();
        assert!(error.contains("render on") && error.contains("lost"), "{error}");
    }
}

#[test]
fn images_survive_removal_of_meshes() {
    let Ok(mut renderer) = GpuRenderer::open(AdapterKind::Software, &GpuOptions::default()) else { return };
    let render = |renderer: &mut GpuRenderer, seed: u64| {
        let task = TaskId::StackCube.task();
        let spec = Composition::from(Perturbation::MoSize).spec(task, Profile::Strict, Strength::FULL);
        // Every other episode has distractors, whose meshes come and go.
        let spec = if seed.is_multiple_of(2) { spec } else { (task.nominal)() };
        let scene = spec.draw(seed);
        let snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        let scene = RenderScene::new(&scene);
        let mut out = vec![0; scene.side(0).pow(2) * 3];
        let mut views = [View { scene: &scene, snapshot: &snapshot, camera_idx: 0, out: &mut out }];
        renderer.render(&mut views).unwrap();
        out
    };
    let expected: Vec<Vec<u8>> = (0..6).map(|seed| render(&mut renderer, seed)).collect();
    assert!(expected.windows(2).all(|pair| pair[0] != pair[1]), "other seeds, other images");
    let n_all = renderer.pipeline.shared.assets.n_vertices();
    renderer.pipeline.shared.assets.min_eviction_vertices = 1;
    let mut fewest = n_all;
    for seed in (0..6).chain((0..6).rev()) {
        assert!(render(&mut renderer, seed) == expected[seed as usize], "image {seed} changed");
        fewest = fewest.min(renderer.pipeline.shared.assets.n_vertices());
    }
    assert!(fewest < n_all, "no mesh was removed of {n_all} vertices");
}
