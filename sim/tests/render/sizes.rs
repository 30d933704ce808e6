//! Images of any size: all of them show the same scene, and those of one height the same picture.

use ipc_types::{ImageSize, ImageSizes};
use sim::TaskId;
use sim::render::{CpuOptions, CpuRenderer, RenderScene, Samples, Segment, View};
use sim::scene::{Primitive, Scene, Snapshot};
use sim::show::scaled;

use crate::common::{BLUE, body, bounds, empty_room, first_scene, initial_snapshot, is_blue, pixels_where};

const TASKS: [TaskId; 3] = [TaskId::RaiseCube, TaskId::PickDishFromRack, TaskId::DualArmPourPot];

fn sizes(text: &str) -> ImageSizes {
    text.parse().unwrap()
}

/// Renders all images of a scene.
fn images(scene: &Scene, snapshot: &Snapshot, sizes: ImageSizes) -> Vec<(ImageSize, Vec<u8>)> {
    CpuRenderer::new(1).render_cameras(&RenderScene::new(scene, sizes), snapshot)
}

/// The cube of `inspect`, which covers 24 × 24 pixels of an observation.
fn scene_with_cube() -> (Scene, Snapshot) {
    let mut scene = empty_room([1.0, 0.0, 0.5], [0.0, 0.0, 0.5]);
    scene.bodies.push(body("cube", Primitive::Box { half: [0.1; 3] }, [0.0, 0.0, 0.5], BLUE));
    let snapshot = initial_snapshot(&scene);
    (scene, snapshot)
}

#[test]
fn cube_has_the_size_that_the_height_implies() {
    let (scene, snapshot) = scene_with_cube();
    let benchmark = ImageSizes::BENCHMARK;
    let scales = [1, 2, 3, 8].map(|scale| scaled(benchmark, scale));
    let others = ["640x480", "1280x960", "99x65", "64x64", "1280x64", "64x960"].map(sizes);
    for sizes in scales.into_iter().chain(others) {
        let images = images(&scene, &snapshot, sizes);
        let [(size, image)] = &images[..] else { panic!("{} cameras", images.len()) };
        assert_eq!((*size, image.len()), (sizes.external, sizes.external.n_bytes()));
        let blue = pixels_where(image, size.width, is_blue);
        // The cube is 0.9 m away and 0.2 m wide; a metre at 1 m spans half the height.
        let px = 0.2 * size.height as f64 / 2.0 / 0.9;
        let [[left, top], [right, bottom]] = bounds(&blue);
        for (first, last, n_px) in [(left, right, size.width), (top, bottom, size.height)] {
            assert!(
                ((last - first + 1) as f64 - px.min(n_px as f64)).abs() <= 1.0,
                "{first} to {last} of {size}"
            );
            assert!((first + last).abs_diff(n_px - 1) <= 1, "{first} to {last} of {size}");
        }
        assert_eq!(blue.len(), (right - left + 1) * (bottom - top + 1), "a gap in the cube");
        let segments = CpuRenderer::new(1).inspect(&RenderScene::new(&scene, sizes), &snapshot, 0).segments;
        assert_eq!(segments.len(), size.n_pixels());
        let cube = |pixel: &usize| segments[*pixel] == Segment::Body(0);
        let cube = (0..segments.len()).filter(cube).map(|pixel| [pixel % size.width, pixel / size.width]);
        assert!(cube.eq(blue), "the segmentation of {size}");
    }
}

#[test]
fn narrow_image_is_centre_of_wide_one() {
    // Everything at the edges of the narrow image is well within the wide one, so both are culled and clipped
    // correctly. Their widths differ by an even number, so that their pixels coincide.
    let pairs = [("480x480", "640x480"), ("640x480", "1280x480"), ("99x65", "131x65"), ("64x64", "66x64")];
    for task in TASKS {
        let (mut scene, snapshot) = first_scene(task);
        scene.lights.shadows = true;
        for (narrow, wide) in pairs {
            let [narrow, wide] = [narrow, wide].map(|text| images(&scene, &snapshot, sizes(text)));
            for (camera_idx, ((size, narrow), (wide_size, wide))) in narrow.iter().zip(&wide).enumerate() {
                let left = (wide_size.width - size.width) / 2;
                let rows = narrow.chunks_exact(size.width * 3).zip(wide.chunks_exact(wide_size.width * 3));
                let pixels = rows
                    .flat_map(|(narrow, wide)| narrow.chunks_exact(3).zip(wide[left * 3..].chunks_exact(3)));
                // Vertices may round differently.
                let n_different =
                    pixels.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 2)).count();
                assert!(
                    n_different * 500 < size.n_pixels(),
                    "{}, camera {camera_idx}: {n_different} pixels of {size} in {wide_size}",
                    task.name()
                );
            }
        }
    }
}

#[test]
fn tripled_image_samples_the_same_scene() {
    for task in TASKS {
        let (scene, snapshot) = first_scene(task);
        let base = images(&scene, &snapshot, sizes("99x65,wrist=128x128"));
        let large = images(&scene, &snapshot, scaled(sizes("99x65,wrist=128x128"), 3));
        for ((size, image), (large_size, large)) in base.iter().zip(&large) {
            let differs = |[x, y]: [usize; 2]| {
                let (base, enlarged) =
                    ((y * size.width + x) * 3, ((3 * y + 1) * large_size.width + 3 * x + 1) * 3);
                (0..3).any(|k| image[base + k].abs_diff(large[enlarged + k]) > 24)
            };
            let pixels = 0..size.n_pixels();
            let n_different = pixels.filter(|i| differs([i % size.width, i / size.width])).count();
            assert!(n_different * 100 < size.n_pixels(), "{}: {n_different} pixels of {size}", task.name());
        }
    }
}

#[test]
fn largest_image_is_the_same_with_four_samples() {
    let (scene, snapshot) = first_scene(TaskId::RaiseCube);
    let scene = RenderScene::new(&scene, scaled(ImageSizes::BENCHMARK, 8));
    let image = |samples| {
        let options = CpuOptions { samples, ..CpuOptions::default() };
        CpuRenderer::with_options(1, options).render_camera_range(&scene, &snapshot, 0..1).remove(0).1
    };
    let [one, four] = [Samples::One, Samples::Four].map(image);
    let pixels = one.chunks_exact(3).zip(four.chunks_exact(3));
    let n_changed = pixels.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 2)).count();
    // Edges, and the fine grain of the floor.
    assert!((1000..60_000).contains(&n_changed), "{n_changed} of {} pixels", one.len() / 3);
}

/// Renders scenes in one batch, with or without static layers, into one buffer whose images begin at odd
/// offsets.
fn render_batch(
    scenes: &[(RenderScene, Snapshot)],
    options: CpuOptions,
    n_threads: usize,
    reversed: bool,
) -> Vec<Vec<u8>> {
    let views = scenes.iter().flat_map(|(scene, at)| (0..scene.n_cameras()).map(move |i| (scene, at, i)));
    let n_bytes: usize = views.clone().map(|(scene, _, i)| scene.size(i).n_bytes() + 1).sum();
    let mut buffer = vec![0xA5; n_bytes];
    let mut rest = &mut buffer[..];
    let mut views: Vec<View<'_>> = views
        .map(|(scene, snapshot, camera_idx)| {
            let (image, after) =
                core::mem::take(&mut rest).split_at_mut(scene.size(camera_idx).n_bytes() + 1);
            rest = after;
            View { scene, snapshot, camera_idx, out: &mut image[1..] }
        })
        .collect();
    if reversed {
        views.reverse();
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
    pool.install(|| CpuRenderer::with_options(n_threads, options).draw(&mut views));
    if reversed {
        views.reverse();
    }
    views.into_iter().map(|view| view.out.to_vec()).collect()
}

#[test]
fn bytes_are_independent_of_threads_batch_and_layers() {
    for samples in [Samples::One, Samples::Four] {
        for sizes in
            ["640x480", "1280x960,wrist=64x64", "99x65,wrist=250x250", "64x64,wrist=65x99"].map(sizes)
        {
            let prepare = |task| {
                let (mut scene, snapshot) = first_scene(task);
                scene.lights.shadows = true;
                (RenderScene::new(&scene, sizes), snapshot)
            };
            let scenes = TASKS.map(prepare);
            let [plain, layers] = [false, true].map(|static_layers| CpuOptions { static_layers, samples });
            let alone =
                scenes.iter().flat_map(|scene| render_batch(core::slice::from_ref(scene), plain, 1, false));
            let alone: Vec<Vec<u8>> = alone.collect();
            for (options, n_threads, reversed) in [(plain, 2, true), (layers, 1, true), (layers, 2, false)] {
                let together = render_batch(&scenes, options, n_threads, reversed);
                assert!(together == alone, "{sizes}, {samples:?}, {options:?}, {n_threads} threads");
            }
        }
    }
}
