//! Coarse properties of images: visible robots, exposure, detail and the effect of colours, lights and
//! textures.

use ipc_types::ImageSizes;
use sim::TaskId;
use sim::render::RenderScene;

use crate::common::{first_scene, is_blue, n_different_pixels, pixels_where, render};

/// The (task, arm, external camera) triples whose initial view misses the arm, as in the benchmark.
const VIEWS_WITHOUT_ARM: [(TaskId, usize, usize); 10] = [
    (TaskId::DualArmBottleHandover, 0, 1),
    (TaskId::DualArmBottleHandover, 1, 1),
    (TaskId::DualArmLiftPot, 0, 1),
    (TaskId::DualArmPourPot, 0, 1),
    (TaskId::DualArmPenCap, 0, 1),
    (TaskId::DualArmPenCap, 1, 1),
    (TaskId::DualArmStackCube, 0, 1),
    (TaskId::DualArmStackCube, 1, 1),
    (TaskId::DualArmStackTwoCubes, 0, 1),
    (TaskId::DualArmStackTwoCubes, 1, 1),
];

#[test]
fn robot_is_visible_in_external_views() {
    let mut without_arm = Vec::new();
    for &task in TaskId::ALL {
        let (scene, with) = first_scene(task);
        for arm in 0..scene.robots.len() {
            let mut without = with.clone();
            for link in &mut without.arms[arm] {
                link.translation.z -= 1000.0;
            }
            for camera_idx in 0..2 {
                let images = [&with, &without].map(|snapshot| render(&scene, snapshot, camera_idx));
                let share = n_different_pixels(&images[0], &images[1]) as f64 / (224.0 * 224.0);
                if share <= 0.015 {
                    without_arm.push((task, arm, camera_idx));
                }
            }
        }
    }
    assert_eq!(without_arm, VIEWS_WITHOUT_ARM);
}

/// Lower bound on the mean byte of an image. The darkest are those of the hand camera inside
/// PickSodaFromCabinet's cabinet and in front of PlaceBookInShelf's bookcase.
const MIN_MEAN: f64 = 49.0;

/// Lower bound on the number of colours in an image. DualArmPushBox's hand cameras see only the table.
const MIN_COLORS: usize = 60;

#[test]
fn images_are_well_exposed_and_detailed() {
    for &task in TaskId::ALL {
        let (scene, snapshot) = first_scene(task);
        for camera_idx in 0..scene.cameras.len() {
            let image = render(&scene, &snapshot, camera_idx);
            let mean = image.iter().map(|b| f64::from(*b)).sum::<f64>() / image.len() as f64;
            let overexposed = image.iter().filter(|b| **b == 255).count() as f64 / image.len() as f64;
            let mut colors: Vec<&[u8]> = image.chunks_exact(3).collect();
            colors.sort_unstable();
            colors.dedup();
            let name = task.name();
            assert!((MIN_MEAN..200.0).contains(&mean), "{name}, camera {camera_idx}: mean {mean}");
            assert!(overexposed < 0.02, "{name}, camera {camera_idx}: {overexposed} of the bytes are 255");
            assert!(colors.len() > MIN_COLORS, "{name}, camera {camera_idx}: {} colours", colors.len());
        }
    }
}

#[test]
fn walls_occlude_black_background() {
    let (mut scene, snapshot) = first_scene(TaskId::RaiseCube);
    let black = |image: &[u8]| pixels_where(image, 224, |rgb| rgb == [0; 3]).len();
    let open = black(&render(&scene, &snapshot, 0));
    scene.background.walls = Some(scene.table.top);
    let walled = black(&render(&scene, &snapshot, 0));
    assert!(open > 1000 && walled < open / 2, "{open} black pixels without walls, {walled} with");
}

#[test]
fn colour_light_and_texture_affect_image() {
    let (mut scene, snapshot) = first_scene(TaskId::RaiseCube);
    let plain = render(&scene, &snapshot, 0);
    scene.bodies[0].parts[0].appearance.color = [0.9, 0.8, 0.1];
    assert!(
        n_different_pixels(&plain, &render(&scene, &snapshot, 0)) > 30,
        "the colour of the cube has no effect"
    );
    scene.table.top.texture = None;
    assert!(
        n_different_pixels(&plain, &render(&scene, &snapshot, 0)) > 5000,
        "the texture of the table has no effect"
    );
    scene.lights.directional.clear();
    scene.lights.ambient = [0.0, 0.0, 1.0];
    let lit_blue = render(&scene, &snapshot, 0);
    assert_eq!(pixels_where(&lit_blue, 224, |rgb| rgb != [0; 3] && !is_blue(rgb)), Vec::<[usize; 2]>::new());
}

#[test]
fn scene_has_plausible_triangle_count() {
    let (scene, _) = first_scene(TaskId::RaiseCube);
    let n = RenderScene::new(&scene, ImageSizes::BENCHMARK).n_triangles();
    assert!((10_000..25_000).contains(&n), "{n} triangles");
}
