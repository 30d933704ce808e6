//! Behaviour after a device failure.

use super::{AdapterKind, GpuOptions, GpuRenderer};
use crate::TaskId;
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
