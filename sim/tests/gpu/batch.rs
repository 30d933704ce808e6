//! A picture depends on its view alone.

use sim::render::Samples;
use sim::render::{Renderer, View};

use crate::common::{Cells, Shot, VISIBILITIES, renderer, shots};

/// Cells whose shots are drawn: one arm and two, plain, patterned and with everything. More would only take longer.
const CELLS: [&str; 6] = [
    "RaiseCube/None",
    "RaiseCube/MO-Texture",
    "RaiseCube/All",
    "DualArmLiftTray/None",
    "DualArmLiftTray/MO-Texture",
    "DualArmLiftTray/All",
];
/// Times that all shots are drawn in one batch: enough for several chunks.
const COPIES: usize = 6;

#[test]
fn bytes_do_not_depend_on_the_batch() {
    for visibility in VISIBILITIES {
        let Some(mut gpu) = renderer(visibility, Samples::One) else { return };
        let is_one = |shot: &Shot| CELLS.contains(&shot.name.as_str());
        let shots: Vec<Shot> = [false, true]
            .map(|shadows| shots(Cells::All, shadows))
            .into_iter()
            .flatten()
            .filter(is_one)
            .collect();
        let alone: Vec<Vec<Vec<u8>>> = shots.iter().map(|shot| images_one_by_one(shot, &mut gpu)).collect();
        for reversed in [false, true] {
            let mut images: Vec<_> = (0..COPIES).flat_map(|_| shots.iter().map(Shot::blank_images)).collect();
            let mut views: Vec<View<'_>> =
                shots.iter().cycle().zip(&mut images).flat_map(|(shot, images)| shot.views(images)).collect();
            if reversed {
                views.reverse();
            }
            gpu.render(&mut views).unwrap();
            for (i, together) in images.iter().enumerate() {
                let name = &shots[i % shots.len()].name;
                assert!(*together == alone[i % shots.len()], "{name}, {visibility:?}, reversed: {reversed}");
            }
        }
    }
}

#[test]
fn an_empty_batch_is_drawn_at_once() {
    for visibility in VISIBILITIES {
        let Some(mut gpu) = renderer(visibility, Samples::One) else { return };
        gpu.render(&mut []).unwrap();
    }
}

fn images_one_by_one(shot: &Shot, renderer: &mut dyn Renderer) -> Vec<Vec<u8>> {
    let mut images = shot.blank_images();
    for view in shot.views(&mut images) {
        renderer.render(&mut [view]).unwrap();
    }
    images
}
