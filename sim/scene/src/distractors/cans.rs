//! Cans and a tube of crisps.

use core::f64::consts::SQRT_2;

use super::Distractor;
use super::appearance::{BLACK, GOLD, WHITE, glossy, matt, pale, pick, steel, textured, vivid_colors};
use super::builder::{DistractorBuilder, HALF_TURN_Z, IDENTITY, LABEL_THICKNESS, pose};
use crate::stream::Stream;
use crate::{Texture, rounded_rectangle};

/// Samples a soup can.
pub(crate) fn soup(stream: &mut Stream) -> Distractor {
    tin(stream, 0.034, 0.101, 950.0)
}

/// Samples a flat tuna can.
pub(crate) fn tuna(stream: &mut Stream) -> Distractor {
    tin(stream, 0.0425, 0.033, 900.0)
}

/// Samples a large coffee can with a plastic lid.
pub(crate) fn coffee(stream: &mut Stream) -> Distractor {
    let (radius, height) = (0.05, 0.139);
    let mut builder = DistractorBuilder::new(370.0);
    builder.collider_cylinder(radius, [0.0, height]);
    builder.visual_cylinder(radius - 0.001, [0.0, height - 0.006], steel());
    label(&mut builder, stream, radius - 0.0006, [0.006, height - 0.018]);
    let lid = [
        [0.0, height - 0.013],
        [radius, height - 0.013],
        [radius, height - 0.001],
        [radius - 0.001, height],
        [radius - 0.005, height],
        [radius - 0.006, height - 0.003],
        [0.0, height - 0.003],
    ];
    builder.lathe_about_z(&lid, glossy(pick(stream, &[WHITE, BLACK, GOLD])));
    builder.build(stream)
}

/// Samples a tube of crisps with a plastic lid.
pub(crate) fn crisps(stream: &mut Stream) -> Distractor {
    let (radius, height) = (0.0365, 0.228);
    let mut builder = DistractorBuilder::new(210.0);
    builder.collider_cylinder(radius + 0.001, [0.0, height]);
    builder.visual_cylinder(radius + 0.0005, [0.0, 0.004], steel());
    label(&mut builder, stream, radius, [0.004, height - 0.006]);
    let lid = [
        [0.0, height - 0.009],
        [radius + 0.001, height - 0.009],
        [radius + 0.001, height],
        [radius - 0.003, height],
        [radius - 0.004, height - 0.002],
        [0.0, height - 0.002],
    ];
    builder.lathe_about_z(&lid, glossy(pale(stream)));
    builder.build(stream)
}

/// Samples a potted-meat can: a box with rounded vertical edges.
pub(crate) fn potted_meat(stream: &mut Stream) -> Distractor {
    let ([x, y], height, round) = ([0.025, 0.048], 0.082, 0.012);
    let mut builder = DistractorBuilder::new(950.0);
    // Two crossed boxes cut the vertical edges off where a 45° plane touches the rounding.
    builder.collider_crossed_boxes([x, y, height / 2.0], round * (2.0 - SQRT_2), [0.0, 0.0, height / 2.0]);
    let mut layer = |out: f64, [low, high]: [f64; 2], appearance| {
        let middle = pose([0.0, 0.0, f64::midpoint(low, high)], IDENTITY);
        let outline = rounded_rectangle([x + out, y + out], round + out);
        builder.extrusion(&outline, &[], (high - low) / 2.0, middle, appearance);
    };
    let [main, other] = vivid_colors(stream);
    layer(-0.001, [0.001, height - 0.002], steel());
    layer(0.0, [0.0, 0.003], steel());
    layer(-0.0006, [0.006, height - 0.006], glossy(main));
    layer(-0.0003, [0.012, 0.026], glossy(other));
    layer(-0.0003, [0.058, 0.064], glossy(pale(stream)));
    let rim = rounded_rectangle([x, y], round);
    let inside = rounded_rectangle([x - 0.0025, y - 0.0025], round - 0.0025);
    builder.extrusion(&rim, &[&inside], 0.0015, pose([0.0, 0.0, height - 0.0015], IDENTITY), steel());
    pull_ring(&mut builder, height - 0.0014);
    for x in [x, -x] {
        builder.visual_rounded_box(
            [LABEL_THICKNESS, 0.03, 0.012],
            [x, 0.0, 0.042],
            LABEL_THICKNESS,
            matt(WHITE),
        );
        builder.visual_rounded_box(
            [2.0 * LABEL_THICKNESS, 0.022, 0.004],
            [x, 0.0, 0.045],
            LABEL_THICKNESS,
            matt(other),
        );
    }
    builder.build(stream)
}

/// Samples a round can with a paper label between its rims and a pull ring.
fn tin(stream: &mut Stream, radius: f64, height: f64, density: f64) -> Distractor {
    let mut builder = DistractorBuilder::new(density);
    builder.collider_cylinder(radius, [0.0, height]);
    let waist = radius - 0.0012;
    let metal = [
        [0.0, 0.0],
        [radius - 0.001, 0.0],
        [radius, 0.001],
        [radius, 0.0025],
        [waist, 0.0035],
        [waist, height - 0.0035],
        [radius, height - 0.0025],
        [radius, height - 0.001],
        [radius - 0.001, height],
        [radius - 0.0025, height],
        [radius - 0.003, height - 0.003],
        [0.0, height - 0.003],
    ];
    builder.lathe_about_z(&metal, steel());
    label(&mut builder, stream, waist + LABEL_THICKNESS, [0.0045, height - 0.0045]);
    pull_ring(&mut builder, height - 0.0025);
    builder.build(stream)
}

fn pull_ring(builder: &mut DistractorBuilder, z: f64) {
    let ring = rounded_rectangle([0.012, 0.0065], 0.006);
    let hole: Vec<_> =
        rounded_rectangle([0.005, 0.0042], 0.004).iter().map(|[x, y]| [x - 0.005, *y]).collect();
    builder.extrusion(&ring, &[&hole], 0.0005, pose([0.006, 0.0, z + 0.0005], IDENTITY), steel());
}

/// Adds a printed label around a cylinder between two heights, in one of four designs.
pub(crate) fn label(
    builder: &mut DistractorBuilder,
    stream: &mut Stream,
    radius: f64,
    [low, high]: [f64; 2],
) {
    let at = |fraction: f64| low + (high - low) * fraction;
    let [main, other] = vivid_colors(stream);
    let light = pale(stream);
    let mut band = |layer: u32, from: f64, to: f64, appearance| {
        builder.visual_cylinder(radius + LABEL_THICKNESS * f64::from(layer), [at(from), at(to)], appearance);
    };
    match pick(stream, &[0, 1, 2, 3]) {
        // Two halves.
        0 => {
            band(0, 0.0, 0.52, glossy(light));
            band(0, 0.52, 1.0, glossy(main));
            band(1, 0.5, 0.54, glossy(GOLD));
            front_and_back_labels(builder, radius, 3, [at(0.4), at(0.64)], GOLD);
            text_bar(builder, radius, 4, [at(0.72), at(0.86)], light);
            text_bar(builder, radius, 4, [at(0.14), at(0.26)], main);
        }
        // A central band between stripes.
        1 => {
            band(0, 0.0, 1.0, glossy(main));
            band(1, 0.3, 0.7, glossy(light));
            band(1, 0.08, 0.14, glossy(other));
            band(1, 0.86, 0.92, glossy(other));
            text_bar(builder, radius, 5, [at(0.5), at(0.62)], main);
            text_bar(builder, radius, 3, [at(0.37), at(0.43)], other);
        }
        // A panel with text on the front and back.
        2 => {
            band(0, 0.0, 1.0, glossy(main));
            front_and_back_labels(builder, radius, 6, [at(0.12), at(0.88)], light);
            text_bar(builder, radius, 5, [at(0.66), at(0.8)], other);
            text_bar(builder, radius, 4, [at(0.52), at(0.58)], BLACK);
            text_bar(builder, radius, 3, [at(0.2), at(0.44)], main);
        }
        // A pattern above a plain base.
        _ => {
            let texture =
                pick(stream, &[Texture::Waves, Texture::PolkaDots, Texture::Gingham, Texture::Stripes]);
            band(0, 0.0, 0.3, glossy(other));
            band(0, 0.3, 1.0, textured(texture, light));
            front_and_back_labels(builder, radius, 5, [at(0.42), at(0.84)], main);
            text_bar(builder, radius, 4, [at(0.64), at(0.76)], light);
            text_bar(builder, radius, 3, [at(0.5), at(0.56)], light);
            text_bar(builder, radius, 5, [at(0.1), at(0.2)], light);
        }
    }
}

/// Adds a label on the front and on the back of a cylinder.
pub(crate) fn front_and_back_labels(
    builder: &mut DistractorBuilder,
    radius: f64,
    half_steps: i32,
    between: [f64; 2],
    color: [f64; 3],
) {
    for turn in [IDENTITY, HALF_TURN_Z] {
        builder.curved_label((radius, 2), half_steps, between, turn, glossy(color));
    }
}

/// Adds a bar that resembles text from a distance, above the other print on the front and back.
fn text_bar(
    builder: &mut DistractorBuilder,
    radius: f64,
    half_steps: i32,
    between: [f64; 2],
    color: [f64; 3],
) {
    for turn in [IDENTITY, HALF_TURN_Z] {
        builder.curved_label((radius, 3), half_steps, between, turn, matt(color));
    }
}
