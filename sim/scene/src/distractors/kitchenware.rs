//! Kitchenware. Vessels collide as if they were solid, since no task puts anything into them.

use super::Distractor;
use super::appearance::{
    BLACK, WHITE, glossy, iron, matt, pale, pick, srgb, steel, textured, vivid, vivid_colors,
};
use super::builder::{DistractorBuilder, LABEL_THICKNESS, Y_TO_Z, pose};
use super::cans::front_and_back_labels;
use crate::stream::Stream;
use crate::{AppearanceSpec, Texture};

/// Samples a plastic tumbler.
pub(crate) fn cup(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(170.0);
    let ([low, high], height) = ([0.031, 0.039], 0.105);
    let [main, other] = vivid_colors(stream);
    builder.collider_cylinder(0.034, [0.0, 0.055]).collider_cylinder(0.038, [0.055, height]);
    open_vessel(&mut builder, [low, high], [0.0, height], 0.002, glossy(main));
    if stream.unit() < 0.5 {
        builder.lathe_about_z(&band_profile([low, high], [0.0, height], [0.55, 0.8]), glossy(other));
        builder.lathe_about_z(&band_profile([low, high], [0.0, height], [0.44, 0.49]), glossy(other));
    }
    builder.build(stream)
}

/// Samples a stack of three cups.
pub(crate) fn stacking_cups(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(220.0);
    builder.collider_cylinder(0.034, [0.0, 0.05]).collider_cylinder(0.0315, [0.05, 0.088]);
    let colors: [_; 3] = vivid_colors(stream);
    let cups =
        [([0.031, 0.0345], [0.0, 0.052]), ([0.0295, 0.033], [0.012, 0.07]), ([0.028, 0.0315], [0.02, 0.088])];
    for (color, (radii, between)) in colors.into_iter().zip(cups) {
        open_vessel(&mut builder, radii, between, 0.0016, glossy(color));
        // The bead around the rim.
        let (r, z) = (radii[1], between[1]);
        ring(&mut builder, [r - 0.001, r + 0.0012], [z - 0.005, z - 0.001], glossy(color));
    }
    builder.build(stream)
}

/// Samples a mug with its handle.
pub(crate) fn mug(stream: &mut Stream) -> Distractor {
    let (radius, height) = (0.0405, 0.088);
    let mut builder = DistractorBuilder::new(520.0);
    let [main, other] = vivid_colors(stream);
    let body = if stream.unit() < 0.4 { pale(stream) } else { main };
    builder
        .collider_cylinder(radius, [0.0, height])
        .collider_box([0.0135, 0.005, 0.029], [radius + 0.0135, 0.0, 0.046]);
    open_vessel(&mut builder, [radius - 0.001, radius], [0.0, height], 0.0035, glossy(body));
    let grip = [
        [0.037, 0.075],
        [0.058, 0.075],
        [0.0665, 0.068],
        [0.0675, 0.05],
        [0.064, 0.034],
        [0.055, 0.022],
        [0.037, 0.017],
    ];
    let inside = [
        [0.037, 0.066],
        [0.0545, 0.066],
        [0.0585, 0.061],
        [0.059, 0.05],
        [0.0555, 0.037],
        [0.05, 0.03],
        [0.037, 0.026],
    ];
    let outline: Vec<_> = grip.iter().chain(inside.iter().rev()).copied().collect();
    builder.extrusion(&outline, &[], 0.005, pose([0.0; 3], Y_TO_Z), glossy(body));
    match pick(stream, &[0, 1, 2]) {
        0 => {}
        1 => band(&mut builder, radius, [0.06, 0.074], glossy(other)),
        _ => {
            let texture = pick(stream, &[Texture::PolkaDots, Texture::Stripes, Texture::Flowers]);
            let color = pale(stream);
            band(&mut builder, radius, [0.012, 0.05], textured(texture, color));
        }
    }
    builder.build(stream)
}

/// Samples a bowl, glazed inside and out.
pub(crate) fn bowl(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(170.0);
    let [main, other] = vivid_colors(stream);
    let inside = if stream.unit() < 0.5 { pale(stream) } else { main };
    builder
        .collider_cylinder(0.045, [0.0, 0.013])
        .collider_cylinder(0.065, [0.013, 0.029])
        .collider_cylinder(0.079, [0.029, 0.054]);
    let outer = [
        [0.0, 0.0],
        [0.039, 0.0],
        [0.041, 0.005],
        [0.056, 0.013],
        [0.069, 0.026],
        [0.0765, 0.041],
        [0.0795, 0.054],
        [0.0785, 0.055],
    ];
    let inner = [[0.0745, 0.042], [0.067, 0.0285], [0.055, 0.0165], [0.038, 0.008], [0.0, 0.006]];
    builder.lathe_about_z(&[&outer[..], &inner[..], &[[0.0, 0.0]]].concat(), glossy(main));
    // The lining protrudes from the inside by the thickness of a label.
    let lining: Vec<_> =
        inner.iter().map(|[r, z]| [(r - LABEL_THICKNESS).max(0.0), z + LABEL_THICKNESS]).collect();
    let back = inner.iter().rev().map(|[r, z]| [*r, z - 0.0005]);
    builder.lathe_about_z(&lining.into_iter().chain(back).rev().collect::<Vec<_>>(), glossy(inside));
    if stream.unit() < 0.5 {
        ring(&mut builder, [0.0762, 0.0801], [0.047, 0.0515], glossy(other));
    }
    builder.build(stream)
}

/// Samples a dinner plate.
pub(crate) fn plate(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(600.0);
    let (glaze, edge) = (pale(stream), vivid(stream));
    builder.collider_cylinder(0.072, [0.0, 0.011]).collider_cylinder(0.105, [0.011, 0.022]);
    let profile = [
        [0.0, 0.002],
        [0.06, 0.002],
        [0.0605, 0.0],
        [0.065, 0.0],
        [0.0725, 0.005],
        [0.104, 0.018],
        [0.105, 0.0205],
        [0.103, 0.021],
        [0.074, 0.0105],
        [0.066, 0.006],
        [0.0, 0.0055],
    ];
    builder.lathe_about_z(&profile, glossy(glaze));
    if stream.unit() < 0.6 {
        let stripe = |from: f64, to: f64| {
            let above = |r: f64| [r, 0.0105 + (r - 0.074) * 0.3621 + LABEL_THICKNESS];
            let below = |r: f64| [r, above(r)[1] - 0.001];
            [below(from), below(to), above(to), above(from), below(from)]
        };
        builder.lathe_about_z(&stripe(0.096, 0.1015), glossy(edge));
        builder.lathe_about_z(&stripe(0.09, 0.0915), glossy(edge));
    }
    builder.build(stream)
}

/// Samples a pan lid of glass in a steel rim, with a knob.
pub(crate) fn pan_lid(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(420.0);
    let knob = glossy(pick(stream, &[BLACK, srgb([120, 30, 28]), srgb([60, 62, 66])]));
    let cover = pick(stream, &[glossy(srgb([150, 168, 172])), steel(), iron(), glossy(srgb([90, 22, 24]))]);
    builder
        .collider_cylinder(0.1, [0.0, 0.012])
        .collider_cylinder(0.072, [0.012, 0.025])
        .collider_cylinder(0.015, [0.025, 0.052]);
    let dome = [
        [0.0, 0.002],
        [0.096, 0.002],
        [0.096, 0.01],
        [0.084, 0.0165],
        [0.066, 0.0225],
        [0.04, 0.0265],
        [0.0, 0.028],
    ];
    builder.lathe_about_z(&dome, cover);
    ring(&mut builder, [0.093, 0.1], [0.0, 0.011], steel());
    let handle = [
        [0.0, 0.027],
        [0.011, 0.027],
        [0.0075, 0.032],
        [0.008, 0.037],
        [0.015, 0.042],
        [0.0155, 0.048],
        [0.012, 0.052],
        [0.0, 0.052],
    ];
    builder.lathe_about_z(&handle, knob);
    builder.build(stream)
}

/// Samples a sponge with a scouring side.
pub(crate) fn sponge(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(150.0);
    let foam = pick(
        stream,
        &[srgb([244, 206, 66]), srgb([236, 140, 160]), srgb([110, 180, 220]), srgb([244, 150, 60])],
    );
    let scourer = pick(stream, &[srgb([40, 100, 52]), srgb([60, 62, 66]), srgb([36, 70, 130])]);
    builder.friction(0.7).collider_box([0.055, 0.036, 0.0155], [0.0, 0.0, 0.0155]);
    builder.visual_rounded_box([0.055, 0.036, 0.0115], [0.0, 0.0, 0.0115], 0.003, matt(foam));
    builder.visual_rounded_box([0.0548, 0.0358, 0.0045], [0.0, 0.0, 0.0265], 0.0015, matt(scourer));
    builder.build(stream)
}

/// Samples a salt or pepper shaker with a steel cap.
pub(crate) fn shaker(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(650.0);
    let (glass, label) = (pick(stream, &[WHITE, srgb([58, 46, 40]), srgb([188, 214, 220])]), vivid(stream));
    builder.collider_cylinder(0.021, [0.0, 0.066]).collider_cylinder(0.017, [0.066, 0.09]);
    let body = [[0.0, 0.0], [0.019, 0.0], [0.021, 0.002], [0.021, 0.05], [0.0155, 0.066], [0.0, 0.066]];
    builder.lathe_about_z(&body, glossy(glass));
    builder.visual_cylinder(0.021 + LABEL_THICKNESS, [0.012, 0.044], matt(label));
    front_and_back_labels(&mut builder, 0.021, 4, [0.018, 0.038], WHITE);
    let cap = [[0.0, 0.064], [0.017, 0.064], [0.017, 0.08], [0.0145, 0.086], [0.008, 0.0895], [0.0, 0.09]];
    builder.lathe_about_z(&cap, steel());
    for [x, y] in [[0.0, 0.0], [0.0045, 0.0], [-0.0045, 0.0], [0.0, 0.0045], [0.0, -0.0045]] {
        builder.visual_box([0.0007, 0.0007, 0.0006], [x, y, 0.09 - 0.07 * (x.abs() + y.abs())], matt(BLACK));
    }
    builder.build(stream)
}

/// Adds an open vessel between two heights; `low` and `high` are its outer radii at the base and at the rim.
fn open_vessel(
    builder: &mut DistractorBuilder,
    [low, high]: [f64; 2],
    [foot, mouth]: [f64; 2],
    wall: f64,
    appearance: AppearanceSpec,
) {
    let profile = [
        [0.0, foot],
        [low - 0.002, foot],
        [low, foot + 0.002],
        [high, mouth - 0.0005],
        [high - 0.0005, mouth],
        [high - wall + 0.0005, mouth],
        [high - wall, mouth - 0.0005],
        [low - wall, foot + 0.004],
        [0.0, foot + 0.003],
    ];
    builder.lathe_about_z(&profile, appearance);
}

/// Returns the profile of a band around a vessel between two fractions of its height.
fn band_profile([low, high]: [f64; 2], [foot, mouth]: [f64; 2], fractions: [f64; 2]) -> [[f64; 2]; 5] {
    let on =
        |fraction: f64, out: f64| [low + (high - low) * fraction + out, foot + (mouth - foot) * fraction];
    let [from, to] = fractions;
    [on(from, -0.001), on(from, 0.0006), on(to, 0.0006), on(to, -0.001), on(from, -0.001)]
}

/// Adds a band around a straight vessel between two heights.
fn band(builder: &mut DistractorBuilder, radius: f64, [low, high]: [f64; 2], appearance: AppearanceSpec) {
    ring(builder, [radius - 0.002, radius + LABEL_THICKNESS], [low, high], appearance);
}

/// Adds a ring between two radii and two heights.
fn ring(
    builder: &mut DistractorBuilder,
    [inner, outer]: [f64; 2],
    [low, high]: [f64; 2],
    appearance: AppearanceSpec,
) {
    builder
        .lathe_about_z(&[[inner, low], [outer, low], [outer, high], [inner, high], [inner, low]], appearance);
}
