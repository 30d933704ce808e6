//! Printed cardboard boxes.

use super::Distractor;
use super::appearance::{BLACK, matt, pale, pick, textured, vivid_colors};
use super::builder::{DistractorBuilder, LABEL_THICKNESS, Z_TO_X, ellipse, pose};
use crate::stream::Stream;
use crate::{AppearanceSpec, Texture};

/// Samples an upright cracker box.
pub(crate) fn crackers(stream: &mut Stream) -> Distractor {
    carton(stream, [0.03, 0.079, 0.105], 205.0, &[FRONT, BACK]).build(stream)
}

/// Samples an upright sugar box.
pub(crate) fn sugar(stream: &mut Stream) -> Distractor {
    carton(stream, [0.019, 0.0445, 0.0875], 850.0, &[FRONT, BACK]).build(stream)
}

/// Samples a pudding box lying on its back.
pub(crate) fn pudding(stream: &mut Stream) -> Distractor {
    let mut builder = carton(stream, [0.0175, 0.055, 0.0445], 540.0, &[BACK]);
    builder.rotated(Z_TO_X);
    builder.build(stream)
}

/// Samples a small gelatine box lying on its back.
pub(crate) fn gelatine(stream: &mut Stream) -> Distractor {
    let mut builder = carton(stream, [0.014, 0.0425, 0.0365], 550.0, &[BACK]);
    builder.rotated(Z_TO_X);
    builder.build(stream)
}

/// The printed sides of an upright box: +x is the front, and −x is the back, which faces up once the box is
/// tipped.
const FRONT: f64 = 1.0;
const BACK: f64 = -1.0;

/// Starts an upright box with half-extents `half`, centred on the origin, with the same print on each of
/// `sides`.
fn carton(stream: &mut Stream, half: [f64; 3], density: f64, sides: &[f64]) -> DistractorBuilder {
    let [x, y, z] = half;
    let mut builder = DistractorBuilder::new(density);
    let [main, other, third] = vivid_colors(stream);
    let light = pale(stream);
    builder.friction(0.4).rounded_box(half, [0.0; 3], 0.0008, matt(main));
    let mut print = |layer: f64, fraction: [f64; 2], at: [f64; 2], appearance: AppearanceSpec| {
        for side in sides {
            let half = [layer * LABEL_THICKNESS, y * fraction[0], z * fraction[1]];
            builder.visual_box(half, [side * x, y * at[0], z * at[1]], appearance);
        }
    };
    match pick(stream, &[0, 1, 2]) {
        // A coloured base and a title above a picture.
        0 => {
            print(1.0, [0.99, 0.22], [0.0, -0.76], matt(other));
            print(1.0, [0.8, 0.18], [0.0, 0.66], matt(light));
            print(2.0, [0.66, 0.08], [0.0, 0.68], matt(other));
            print(2.0, [0.6, 0.04], [0.0, -0.7], matt(light));
            print(2.0, [0.4, 0.03], [0.0, -0.84], matt(light));
        }
        // A light panel in a frame, with lines of text.
        1 => {
            print(1.0, [0.88, 0.92], [0.0, 0.0], matt(light));
            print(2.0, [0.7, 0.12], [0.0, 0.66], matt(main));
            print(2.0, [0.5, 0.04], [-0.2, 0.44], matt(BLACK));
            print(2.0, [0.3, 0.1], [0.45, -0.72], matt(third));
            print(2.0, [0.3, 0.03], [-0.4, -0.68], matt(BLACK));
            print(2.0, [0.3, 0.03], [-0.4, -0.78], matt(BLACK));
        }
        // A textured band.
        _ => {
            let texture =
                pick(stream, &[Texture::Gingham, Texture::Waves, Texture::Chevrons, Texture::Stars]);
            print(1.0, [0.99, 0.34], [0.0, -0.62], textured(texture, light));
            print(2.0, [0.72, 0.16], [0.0, 0.62], matt(other));
            print(3.0, [0.6, 0.07], [0.0, 0.62], matt(light));
            print(3.0, [0.5, 0.08], [0.0, -0.74], matt(main));
        }
    }
    let picture = 0.42 * y.min(z);
    let spots = [(1.0, picture, third), (2.0, 0.72 * picture, light), (3.0, 0.4 * picture, other)];
    for (layer, radius, color) in spots {
        let outline = ellipse([0.9 * radius, 1.15 * radius]);
        for side in sides {
            let middle = pose([side * x, 0.0, 0.04 * z], Z_TO_X);
            builder.extrusion(&outline, &[], (layer + 1.0) * LABEL_THICKNESS, middle, matt(color));
        }
    }
    flap(&mut builder, half, light);
    builder
}

/// Adds the seam of the lid across the top.
fn flap(builder: &mut DistractorBuilder, [x, y, z]: [f64; 3], color: [f64; 3]) {
    builder.visual_box([0.25 * x, 0.96 * y, LABEL_THICKNESS], [0.3 * x, 0.0, z], matt(color));
}
