//! Pictures of more pixels show the same, without seams.

use sim::TaskId;
use sim::render::{CpuRenderer, RenderScene};
use sim::scene::Primitive;
use sim::show::HighResScene;

use crate::common::{BLUE, as_placed, body, bounds, drawn, empty_room, is_blue, pixels};

/// As in `inspect`: a cube of 24 × 24 pixels.
#[test]
fn edges_are_where_they_were_to_a_part_of_a_pixel() {
    let mut scene = empty_room([1.0, 0.0, 0.5], [0.0, 0.0, 0.5]);
    scene.bodies.push(body("cube", Primitive::Box { half: [0.1; 3] }, [0.0, 0.0, 0.5], BLUE));
    let snapshot = as_placed(&scene);
    for times in [1, 2, 3, 8] {
        let images = HighResScene::new(&scene, times).photograph(&mut CpuRenderer::new(1), &snapshot);
        let [(side, image)] = &images[..] else { panic!("{} cameras", images.len()) };
        assert_eq!((*side, image.len()), (224 * times, (224 * times).pow(2) * 3));
        let blue = pixels(image, *side, is_blue);
        // 0.9 m away, 0.2 m wide, 112 px per metre at 1 m.
        let width = 0.2 * 112.0 / 0.9 * times as f64;
        let [[left, top], [right, bottom]] = bounds(&blue);
        for (first, last) in [(left, right), (top, bottom)] {
            assert!(((last - first + 1) as f64 - width).abs() <= 1.0, "{first} to {last} in {times} times");
            assert!((first + last).abs_diff(side - 1) <= 1, "{first} to {last} of {side}");
        }
        assert_eq!(blue.len(), (right - left + 1) * (bottom - top + 1), "without a gap");
    }
}

#[test]
fn once_is_the_picture_itself_and_three_times_has_it_in_the_middles() {
    for task in [TaskId::PickDishFromRack, TaskId::DualArmPourPot] {
        let (scene, snapshot) = drawn(task);
        let mut renderer = CpuRenderer::new(1);
        let usual = renderer.photograph(&RenderScene::new(&scene), &snapshot);
        assert!(
            HighResScene::new(&scene, 1).photograph(&mut renderer, &snapshot) == usual,
            "{}",
            task.name()
        );
        let large = HighResScene::new(&scene, 3).photograph(&mut renderer, &snapshot);
        for ((side, image), (large_side, large)) in usual.iter().zip(&large) {
            assert_eq!(*large_side, 3 * side);
            // Textures are a little finer, and edges may round to the other side.
            let differs = |[x, y]: [usize; 2]| {
                let (here, there) = ((y * side + x) * 3, ((3 * y + 1) * large_side + 3 * x + 1) * 3);
                (0..3).any(|k| image[here + k].abs_diff(large[there + k]) > 24)
            };
            let n_different = (0..side * side).filter(|pixel| differs([pixel % side, pixel / side])).count();
            assert!(n_different * 200 < side * side, "{}: {n_different} of {}", task.name(), side * side);
        }
    }
}
