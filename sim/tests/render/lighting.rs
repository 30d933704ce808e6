//! Shadows and anti-aliasing: effects on images, and what they leave unchanged.

use ipc_types::ImageSizes;
use nalgebra::{UnitQuaternion, Vector3};
use sim::render::{CpuOptions, CpuRenderer, RenderScene, Samples, View};
use sim::scene::{DirectionalLight, Primitive, Scene};

use crate::common::{BLUE, body, bounds, empty_room, initial_snapshot};

/// Returns a room seen from above with a directional light at 45° and, optionally, a 10 cm cube in the middle
/// of the table.
fn lit_room(shadows: bool, with_cube: bool) -> Scene {
    let mut scene = empty_room([0.0, 0.0, 1.2], [0.0, 0.0, 0.0]);
    scene.lights.ambient = [0.3; 3];
    scene.lights.directional = vec![DirectionalLight { color: [1.0; 3], direction: [1.0, 0.0, -1.0] }];
    scene.lights.shadows = shadows;
    if with_cube {
        scene.bodies.push(body("cube", Primitive::Box { half: [0.05; 3] }, [0.0, 0.0, 0.05], BLUE));
    }
    scene
}

fn render(scene: &Scene, samples: Samples) -> Vec<u8> {
    let (render_scene, snapshot) = (RenderScene::new(scene, ImageSizes::BENCHMARK), initial_snapshot(scene));
    let mut out = vec![0; render_scene.size(0).n_bytes()];
    let options = CpuOptions { samples, ..CpuOptions::default() };
    let view = View { scene: &render_scene, snapshot: &snapshot, camera_idx: 0, out: &mut out };
    CpuRenderer::with_options(1, options).draw(&mut [view]);
    out
}

#[test]
fn surfaces_do_not_shadow_themselves() {
    let [without, with] = [false, true].map(|shadows| render(&lit_room(shadows, false), Samples::One));
    // The middle of the image shows only the table. Its edge may cast a shadow on the floor elsewhere.
    let side = 224;
    let middle = |image: &[u8]| -> Vec<u8> {
        let inner = side * 3 / 8..side * 5 / 8;
        inner
            .clone()
            .flat_map(|y| image[(y * side + inner.start) * 3..(y * side + inner.end) * 3].to_vec())
            .collect()
    };
    assert!(middle(&without) == middle(&with));
}

#[test]
fn cube_casts_shadow_of_its_height() {
    let [without, with] = [false, true].map(|shadows| render(&lit_room(shadows, true), Samples::One));
    let side = 224;
    let darker: Vec<[usize; 2]> = (0..side * side)
        .filter(|i| i32::from(with[i * 3]) < i32::from(without[i * 3]) - 20)
        .map(|i| [i % side, i / side])
        .filter(|pixel| pixel.iter().all(|i| (side * 3 / 8..side * 5 / 8).contains(i)))
        .collect();
    // The middle shows only the table. The shadow on it measures 10 cm × 10 cm. At 1.2 m with a 90° field of
    // view a pixel is 1.07 cm wide.
    let pixel_m = 2.4 / side as f32;
    let area_m2 = darker.len() as f32 * pixel_m * pixel_m;
    assert!((0.007..0.013).contains(&area_m2), "{area_m2} m²");
    let [min, max] = bounds(&darker);
    let size_m = [0, 1].map(|axis| (max[axis] - min[axis] + 1) as f32 * pixel_m);
    assert!(size_m.iter().all(|size| (0.08..0.13).contains(size)), "{size_m:?} m");
}

#[test]
fn four_samples_change_only_edges() {
    let mut scene = lit_room(false, true);
    scene.bodies[0].pose.rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3);
    let [one, four] = [Samples::One, Samples::Four].map(|samples| render(&scene, samples));
    let pixels = || one.chunks_exact(3).zip(four.chunks_exact(3));
    let changed = pixels().filter(|(a, b)| a != b).count();
    // The edges of table and cube span some hundred pixels; the other 50,000 show surfaces.
    assert!((50..3000).contains(&changed), "{changed} pixels differ");
    let levels = |image: &[u8]| {
        let mut reds: Vec<u8> = image.chunks_exact(3).map(|pixel| pixel[0]).collect();
        reds.sort_unstable();
        reds.dedup();
        reds.len()
    };
    assert!(levels(&four) > levels(&one) + 2, "no intermediate shades");
}
