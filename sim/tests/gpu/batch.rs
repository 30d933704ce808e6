//! Independence of images from the batch in which they are rendered.

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

#[test]
fn images_do_not_depend_on_the_batch() {
    let Some(mut gpu) = renderer(Samples::One) else { return };
    let is_selected = |scene: &TestScene| SCENES.contains(&scene.name.as_str());
    let scenes: Vec<TestScene> = [false, true]
        .map(|shadows| test_scenes(PerturbationSet::All, shadows))
        .into_iter()
        .flatten()
        .filter(is_selected)
        .collect();
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
fn empty_batch_renders_nothing() {
    let Some(mut gpu) = renderer(Samples::One) else { return };
    gpu.render(&mut []).unwrap();
}

fn render_one_by_one(scene: &TestScene, renderer: &mut dyn Renderer) -> Vec<Vec<u8>> {
    let mut images = scene.blank_images();
    for view in scene.views(&mut images) {
        renderer.render(&mut [view]).unwrap();
    }
    images
}
