//! What a person would notice at once.

use sim::TaskId;
use sim::render::RenderScene;

use crate::common::{drawn, image, is_blue, pixels};
use crate::independence::differing;

/// Task, arm and external camera of those views of the benchmark's that look past an arm at first.
const LOOK_PAST: [(TaskId, usize, usize); 6] = [
    (TaskId::DualArmBottleHandover, 0, 1),
    (TaskId::DualArmBottleHandover, 1, 1),
    (TaskId::DualArmLiftPot, 0, 1),
    (TaskId::DualArmPourPot, 0, 1),
    (TaskId::DualArmPenCap, 0, 1),
    (TaskId::DualArmPenCap, 1, 1),
];

#[test]
fn the_robot_is_visible_in_every_external_view() {
    let mut past = Vec::new();
    for &task in TaskId::ALL {
        let (scene, with) = drawn(task);
        for arm in 0..scene.robots.len() {
            let mut without = with.clone();
            for link in &mut without.arms[arm] {
                link.translation.z -= 1000.0;
            }
            for camera_idx in 0..2 {
                let images = [&with, &without].map(|snapshot| image(&scene, snapshot, camera_idx));
                let share = differing(&images[0], &images[1]) as f64 / (224.0 * 224.0);
                if share <= 0.015 {
                    past.push((task, arm, camera_idx));
                }
            }
        }
    }
    assert_eq!(past, LOOK_PAST);
}

/// Least mean of an image's bytes: the hand camera of PickSodaFromCabinet looks into the cabinet.
const DARKEST: f64 = 50.0;

#[test]
fn images_are_neither_dark_nor_burnt_and_full_of_detail() {
    for &task in TaskId::ALL {
        let (scene, snapshot) = drawn(task);
        for camera_idx in 0..scene.cameras.len() {
            let image = image(&scene, &snapshot, camera_idx);
            let mean = image.iter().map(|b| f64::from(*b)).sum::<f64>() / image.len() as f64;
            let burnt = image.iter().filter(|b| **b == 255).count() as f64 / image.len() as f64;
            let mut colors: Vec<&[u8]> = image.chunks_exact(3).collect();
            colors.sort_unstable();
            colors.dedup();
            let name = task.name();
            assert!((DARKEST..200.0).contains(&mean), "{name}, camera {camera_idx}: mean {mean}");
            assert!(burnt < 0.02, "{name}, camera {camera_idx}: {burnt} of the bytes are 255");
            assert!(colors.len() > 150, "{name}, camera {camera_idx}: {} colours", colors.len());
        }
    }
}

#[test]
fn walls_hide_the_black_beyond_the_floor() {
    let (mut scene, snapshot) = drawn(TaskId::RaiseCube);
    let black = |image: &[u8]| pixels(image, 224, |rgb| rgb == [0; 3]).len();
    let open = black(&image(&scene, &snapshot, 0));
    scene.background.walls = Some(scene.table.top);
    let walled = black(&image(&scene, &snapshot, 0));
    assert!(open > 1000 && walled < open / 2, "{open} black pixels without walls, {walled} with");
}

#[test]
fn colour_light_and_texture_reach_the_image() {
    let (mut scene, snapshot) = drawn(TaskId::RaiseCube);
    let plain = image(&scene, &snapshot, 0);
    scene.bodies[0].parts[0].appearance.color = [0.9, 0.8, 0.1];
    assert!(differing(&plain, &image(&scene, &snapshot, 0)) > 30, "the cube keeps its colour");
    scene.table.top.texture = None;
    assert!(differing(&plain, &image(&scene, &snapshot, 0)) > 5000, "the table keeps its texture");
    scene.lights.directional.clear();
    scene.lights.ambient = [0.0, 0.0, 1.0];
    let lit_blue = image(&scene, &snapshot, 0);
    assert_eq!(pixels(&lit_blue, 224, |rgb| rgb != [0; 3] && !is_blue(rgb)), Vec::<[usize; 2]>::new());
}

#[test]
fn a_scene_has_a_sensible_number_of_triangles() {
    let (scene, _) = drawn(TaskId::RaiseCube);
    let n = RenderScene::new(&scene).n_triangles();
    assert!((10_000..25_000).contains(&n), "{n} triangles");
}
