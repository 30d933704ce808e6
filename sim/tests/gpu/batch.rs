//! Independence of images from the batch in which they are rendered.

use ipc_types::ImageSizes;
use sim::render::Samples;
use sim::render::{Renderer, View};

use crate::common::{PerturbationSet, TestScene, renderer, test_scenes};

/// Scenes that are rendered: one arm and two, unperturbed, textured, and with all perturbations. More would
/// only take longer.
const SCENES: [&str; 6] = [
    "RaiseCube/None",
    "RaiseCube/MO-Texture",
    "RaiseCube/All",
    "DualArmLiftTray/None",
    "DualArmLiftTray/MO-Texture",
    "DualArmLiftTray/All",
];
/// Copies of all scenes in one batch: enough for several chunks.
const COPIES: usize = 6;

/// Scene with more large triangles than any other. Their list once overflowed with four samples per pixel,
/// and what single threads then drew depended on the order in which the threads ran.
const MOST_LARGE_TRIANGLES: &str = "DualArmDrawerOpen/Language-Other-Task";

#[test]
#[ignore = "needs a Vulkan driver"]
fn images_do_not_depend_on_the_batch() {
    assert_independent_of_batch(Samples::One, PerturbationSet::All, ImageSizes::BENCHMARK, &SCENES);
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn four_samples_do_not_depend_on_the_batch() {
    for sizes in [ImageSizes::BENCHMARK, "640x480,wrist=99x65".parse().unwrap()] {
        assert_independent_of_batch(
            Samples::Four,
            PerturbationSet::OnePerTask,
            sizes,
            &[MOST_LARGE_TRIANGLES],
        );
    }
}

/// Asserts that selected scenes give the same images one by one and in a batch with copies of all of them.
fn assert_independent_of_batch(samples: Samples, set: PerturbationSet, sizes: ImageSizes, names: &[&str]) {
    let mut gpu = renderer(samples, sizes);
    let scenes: Vec<TestScene> = [false, true]
        .into_iter()
        .flat_map(|shadows| test_scenes(set, shadows, sizes))
        .filter(|scene| names.contains(&scene.name.as_str()))
        .collect();
    assert_eq!(scenes.len(), 2 * names.len(), "scenes without and with shadows");
    let alone: Vec<Vec<Vec<u8>>> = scenes.iter().map(|scene| render_one_by_one(scene, &mut gpu)).collect();
    for reversed in [false, true] {
        let mut images: Vec<_> =
            (0..COPIES).flat_map(|_| scenes.iter().map(TestScene::blank_images)).collect();
        let mut views: Vec<View<'_>> =
            scenes.iter().cycle().zip(&mut images).flat_map(|(scene, images)| scene.views(images)).collect();
        if reversed {
            views.reverse();
        }
        gpu.render(&mut views).unwrap();
        for (i, together) in images.iter().enumerate() {
            let name = &scenes[i % scenes.len()].name;
            assert!(*together == alone[i % scenes.len()], "{name}, reversed: {reversed}");
        }
    }
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn empty_batch_renders_nothing() {
    let mut gpu = renderer(Samples::One, ImageSizes::BENCHMARK);
    gpu.render(&mut []).unwrap();
}

fn render_one_by_one(scene: &TestScene, renderer: &mut dyn Renderer) -> Vec<Vec<u8>> {
    let mut images = scene.blank_images();
    for view in scene.views(&mut images) {
        renderer.render(&mut [view]).unwrap();
    }
    images
}
