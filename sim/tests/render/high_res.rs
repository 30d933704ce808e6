//! High-resolution renderings show the same scene, without seams between tiles.

use sim::TaskId;
use sim::render::{CpuRenderer, RenderScene};
use sim::scene::Primitive;
use sim::show::HighResScene;

use crate::common::{BLUE, body, bounds, empty_room, first_scene, initial_snapshot, is_blue, pixels_where};

/// The cube of `inspect`, which covers 24 × 24 pixels at the base resolution.
#[test]
fn edges_stay_within_one_pixel() {
    let mut scene = empty_room([1.0, 0.0, 0.5], [0.0, 0.0, 0.5]);
    scene.bodies.push(body("cube", Primitive::Box { half: [0.1; 3] }, [0.0, 0.0, 0.5], BLUE));
    let snapshot = initial_snapshot(&scene);
    for factor in [1, 2, 3, 8] {
        let images = HighResScene::new(&scene, factor).render_cameras(&mut CpuRenderer::new(1), &snapshot);
        let [(side, image)] = &images[..] else { panic!("{} cameras", images.len()) };
        assert_eq!((*side, image.len()), (224 * factor, (224 * factor).pow(2) * 3));
        let blue = pixels_where(image, *side, is_blue);
        // The cube is 0.9 m away and 0.2 m wide; a metre at 1 m spans 112 px at the base resolution.
        let width = 0.2 * 112.0 / 0.9 * factor as f64;
        let [[left, top], [right, bottom]] = bounds(&blue);
        for (first, last) in [(left, right), (top, bottom)] {
            assert!(((last - first + 1) as f64 - width).abs() <= 1.0, "{first} to {last} at factor {factor}");
            assert!((first + last).abs_diff(side - 1) <= 1, "{first} to {last} of {side}");
        }
        assert_eq!(blue.len(), (right - left + 1) * (bottom - top + 1), "a gap in the cube");
    }
}

#[test]
fn factor_one_is_identical_and_three_samples_centres() {
    for task in [TaskId::PickDishFromRack, TaskId::DualArmPourPot] {
        let (scene, snapshot) = first_scene(task);
        let mut renderer = CpuRenderer::new(1);
        let base = renderer.render_cameras(&RenderScene::new(&scene), &snapshot);
        assert!(
            HighResScene::new(&scene, 1).render_cameras(&mut renderer, &snapshot) == base,
            "{}",
            task.name()
        );
        let large = HighResScene::new(&scene, 3).render_cameras(&mut renderer, &snapshot);
        for ((side, image), (large_side, large)) in base.iter().zip(&large) {
            assert_eq!(*large_side, 3 * side);
            // Edges may round differently.
            let differs = |[x, y]: [usize; 2]| {
                let (base, enlarged) = ((y * side + x) * 3, ((3 * y + 1) * large_side + 3 * x + 1) * 3);
                (0..3).any(|k| image[base + k].abs_diff(large[enlarged + k]) > 24)
            };
            let n_different = (0..side * side).filter(|pixel| differs([pixel % side, pixel / side])).count();
            assert!(n_different * 200 < side * side, "{}: {n_different} of {}", task.name(), side * side);
        }
    }
}
