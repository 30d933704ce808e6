//! Behaviour after a device failure, and when unused meshes are removed.

use ipc_types::ControlMode;

use super::{AdapterKind, GpuOptions, GpuRenderer};
use crate::TaskId;
use crate::physics::World;
use crate::render::{RenderScene, Renderer, View};
use crate::scene::Snapshot;

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
    // Other tasks have other meshes.
    let tasks = [TaskId::RaiseCube, TaskId::PlaceDishInRack, TaskId::HammerNail, TaskId::ScoopBanana];
    let render = |renderer: &mut GpuRenderer, task: TaskId| {
        let scene = (task.task().nominal)().draw(3);
        let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        World::build(&scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
        let scene = RenderScene::new(&scene);
        let mut out = vec![0; scene.side(0).pow(2) * 3];
        let mut views = [View { scene: &scene, snapshot: &snapshot, camera_idx: 0, out: &mut out }];
        renderer.render(&mut views).unwrap();
        out
    };
    let expected = tasks.map(|task| render(&mut renderer, task));
    assert!(expected.windows(2).all(|pair| pair[0] != pair[1]), "other tasks, other images");
    let n_all = renderer.pipeline.shared.assets.n_vertices();
    renderer.pipeline.shared.assets.min_eviction_vertices = 1;
    let mut fewest = n_all;
    for (task, expected) in tasks.iter().zip(&expected).chain(tasks.iter().zip(&expected).rev()) {
        assert!(render(&mut renderer, *task) == *expected, "the image of {task:?} changed");
        fewest = fewest.min(renderer.pipeline.shared.assets.n_vertices());
    }
    assert!(fewest < n_all, "no mesh was removed of {n_all} vertices");
}
