//! Shadows and samples: what they change, and what they leave alone.

use nalgebra::{UnitQuaternion, Vector3};
use sim::render::{CpuOptions, CpuRenderer, RenderScene, Samples, View};
use sim::scene::{DirectionalLight, Primitive, Scene};

use crate::common::{BLUE, as_placed, body, empty_room};

/// A room seen from above, a light from the side at 45° and, if wanted, a cube of 10 cm in the middle of the table.
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

fn image(scene: &Scene, samples: Samples) -> Vec<u8> {
    let (render, snapshot) = (RenderScene::new(scene), as_placed(scene));
    let mut out = vec![0; render.side(0).pow(2) * 3];
    let options = CpuOptions { samples, ..CpuOptions::default() };
    let view = View { scene: &render, snapshot: &snapshot, camera_idx: 0, out: &mut out };
    CpuRenderer::with_options(1, options).draw(&mut [view]);
    out
}

#[test]
fn nothing_shades_itself() {
    let [without, with] = [false, true].map(|shadows| image(&lit_room(shadows, false), Samples::One));
    // The middle of the picture shows the table alone, whose edge casts a shadow on the floor.
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
fn a_cube_casts_a_shadow_as_long_as_it_is_high_away_from_the_light() {
    let [without, with] = [false, true].map(|shadows| image(&lit_room(shadows, true), Samples::One));
    let side = 224;
    let darker: Vec<[usize; 2]> = (0..side * side)
        .filter(|i| i32::from(with[i * 3]) < i32::from(without[i * 3]) - 20)
        .map(|i| [i % side, i / side])
        .filter(|[x, y]| (side / 4..side * 3 / 4).contains(x) && (side / 4..side * 3 / 4).contains(y))
        .collect();
    // The shadow on the table is 10 cm by 10 cm; at 1.2 m and 90° a pixel is 1.07 cm wide.
    let pixel_m = 2.4 / side as f32;
    let area_m2 = darker.len() as f32 * pixel_m * pixel_m;
    assert!((0.007..0.013).contains(&area_m2), "{area_m2} m²");
    let [least, greatest] = crate::common::bounds(&darker);
    let size_m = [0, 1].map(|axis| (greatest[axis] - least[axis] + 1) as f32 * pixel_m);
    assert!(size_m.iter().all(|size| (0.08..0.13).contains(size)), "{size_m:?} m");
}

#[test]
fn four_samples_smooth_edges_and_leave_surfaces_alone() {
    let mut scene = lit_room(false, true);
    scene.bodies[0].pose.rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3);
    let [one, four] = [Samples::One, Samples::Four].map(|samples| image(&scene, samples));
    let pixels = || one.chunks_exact(3).zip(four.chunks_exact(3));
    let changed = pixels().filter(|(a, b)| a != b).count();
    // Edges of the table and the cube are some hundred pixels long; surfaces make up the other 50,000.
    assert!((50..3000).contains(&changed), "{changed} pixels differ");
    let levels = |image: &[u8]| {
        let mut reds: Vec<u8> = image.chunks_exact(3).map(|pixel| pixel[0]).collect();
        reds.sort_unstable();
        reds.dedup();
        reds.len()
    };
    assert!(levels(&four) > levels(&one) + 2, "no shades between");
}
