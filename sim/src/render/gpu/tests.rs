//! How the device fails.

use super::{AdapterKind, GpuOptions, GpuRenderer};
use crate::TaskId;
use crate::render::{RenderScene, Renderer, View};
use crate::scene::Snapshot;

#[test]
fn a_lost_device_is_an_error_and_stays_one() {
    let Ok(mut renderer) = GpuRenderer::open(AdapterKind::Software, &GpuOptions::default()) else { return };
    let scene = (TaskId::RaiseCube.task().nominal)().draw(3);
    let snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
    let scene = RenderScene::new(&scene);
    let mut out = vec![0; scene.side(0).pow(2) * 3];
    let mut draw = |renderer: &mut GpuRenderer| {
        renderer.render(&mut [View { scene: &scene, snapshot: &snapshot, camera_idx: 0, out: &mut out }])
    };
    draw(&mut renderer).unwrap();
    renderer.gpu.device.destroy();
    for _ in 0..2 {
        let error = draw(&mut renderer).unwrap_err().to_string();
        assert!(error.contains("render on") && error.contains("lost"), "{error}");
    }
}
