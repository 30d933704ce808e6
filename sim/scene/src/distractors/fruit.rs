//! Fruit. Round fruit stands on a small flat base, as real fruit does, and rolls once it is pushed off it.

use super::Distractor;
use super::appearance::{PEEL_SPECULAR, matt, pick, srgb, textured, vary_brightness};
use super::builder::{DistractorBuilder, IDENTITY, Z_TO_X, arc, pose};
use crate::stream::Stream;
use crate::{AppearanceSpec, Primitive, Texture, VisualShape};

/// Profile (r, z) of an apple from the lower to the upper dimple, in units of its radius.
pub const APPLE_PROFILE: [[f64; 2]; 12] = [
    [0.0, -0.9],
    [0.18, -0.98],
    [0.4, -0.95],
    [0.72, -0.7],
    [0.93, -0.32],
    [1.0, 0.1],
    [0.95, 0.48],
    [0.75, 0.82],
    [0.48, 0.97],
    [0.22, 0.92],
    [0.06, 0.74],
    [0.0, 0.7],
];

/// Samples an apple with its stem.
pub(crate) fn apple(stream: &mut Stream) -> Distractor {
    let skin = pick(stream, &[srgb([186, 28, 32]), srgb([138, 178, 56]), srgb([222, 180, 60])]);
    let skin = skin_appearance(vary_brightness(stream, skin));
    let radius = 0.0375;
    let mut builder = start_round(radius);
    builder.lathe_about_z(&APPLE_PROFILE.map(|point| point.map(|x| x * radius)), skin);
    stem(&mut builder, [0.0, 0.0, 0.86 * radius], 0.005);
    builder.build(stream)
}

/// Samples an upright pear.
pub(crate) fn pear(stream: &mut Stream) -> Distractor {
    let skin = pick(stream, &[srgb([170, 182, 60]), srgb([206, 178, 70]), srgb([150, 110, 50])]);
    let skin = skin_appearance(vary_brightness(stream, skin));
    let radius = 0.033;
    let mut builder = start_round(radius);
    let ball = |radius| Primitive::Ball { radius };
    builder.collider(ball(0.025), pose([0.0, 0.0, 0.022], IDENTITY));
    builder.collider(ball(0.0165), pose([0.0, 0.0, 0.045], IDENTITY));
    let profile = [
        [0.0, -0.030],
        [0.008, -0.0325],
        [0.016, -0.029],
        [0.027, -0.018],
        [0.0325, -0.003],
        [0.031, 0.012],
        [0.026, 0.026],
        [0.0195, 0.042],
        [0.0155, 0.053],
        [0.009, 0.0595],
        [0.0, 0.060],
    ];
    builder.lathe_about_z(&profile, skin);
    stem(&mut builder, [0.0, 0.0, 0.0585], 0.003);
    builder.build(stream)
}

/// Samples an orange with faintly visible pores.
pub(crate) fn orange(stream: &mut Stream) -> Distractor {
    let radius = 0.0365;
    let mut builder = start_round(radius);
    let color = vary_brightness(stream, srgb([246, 140, 24]));
    let ball = VisualShape::Primitive(Primitive::Ball { radius });
    builder.visual(ball, pose([0.0; 3], IDENTITY), textured(Texture::Plaster, color));
    stem_scar(&mut builder, radius);
    builder.build(stream)
}

/// Samples a peach: two halves with a seam.
pub(crate) fn peach(stream: &mut Stream) -> Distractor {
    let mut builder = start_round(0.0335);
    let color = pick(stream, &[srgb([242, 158, 92]), srgb([226, 104, 72]), srgb([246, 196, 116])]);
    let color = vary_brightness(stream, color);
    // One half is redder, as if it had received more sun.
    let [red, green, blue] = color;
    halves(&mut builder, 0.0335, [matt(color), matt([0.95 * red, 0.76 * green, 0.74 * blue])]);
    stem_scar(&mut builder, 0.0335);
    builder.build(stream)
}

/// Samples a dark plum: two halves with a seam.
pub(crate) fn plum(stream: &mut Stream) -> Distractor {
    let mut builder = start_round(0.026);
    let color = pick(stream, &[srgb([88, 28, 66]), srgb([54, 30, 84]), srgb([128, 30, 50])]);
    halves(&mut builder, 0.026, [skin_appearance(vary_brightness(stream, color)); 2]);
    stem(&mut builder, [0.0, 0.0, 0.025], 0.002);
    builder.build(stream)
}

/// Samples a lemon lying on its side.
pub(crate) fn lemon(stream: &mut Stream) -> Distractor {
    let skin = pick(stream, &[srgb([240, 208, 40]), srgb([128, 176, 52])]);
    let skin = textured(Texture::Plaster, vary_brightness(stream, skin));
    let radius = 0.027;
    let mut builder = DistractorBuilder::new(900.0);
    let ball = |radius| Primitive::Ball { radius };
    builder.collider(Primitive::Capsule { radius: 0.025, half_height: 0.004 }, pose([0.0; 3], Z_TO_X));
    builder
        .collider(ball(0.01), pose([0.024, 0.0, 0.0], IDENTITY))
        .collider(ball(0.01), pose([-0.024, 0.0, 0.0], IDENTITY));
    // A narrow box as wide as the lemon gives it a flat spot to rest on.
    builder.collider_box([0.009, 0.005, radius], [0.0; 3]).rolling_resistance();
    let profile = [
        [0.0, -0.034],
        [0.005, -0.033],
        [0.009, -0.029],
        [0.017, -0.022],
        [0.0245, -0.011],
        [0.0268, 0.0],
        [0.0245, 0.011],
        [0.017, 0.022],
        [0.009, 0.029],
        [0.006, 0.034],
        [0.0, 0.035],
    ];
    builder.lathe(&profile, pose([0.0; 3], Z_TO_X), skin);
    builder.build(stream)
}

/// Samples a strawberry lying on its side, its leaves towards −x.
pub(crate) fn strawberry(stream: &mut Stream) -> Distractor {
    let radius = 0.0185;
    let mut builder = DistractorBuilder::new(900.0);
    let ball = |radius| Primitive::Ball { radius };
    builder.collider(ball(0.0175), pose([-0.005, 0.0, 0.0], IDENTITY));
    builder.collider(ball(0.0085), pose([0.0165, 0.0, 0.0], IDENTITY));
    builder.collider_box([0.009, 0.005, radius], [-0.003, 0.0, 0.0]).rolling_resistance();
    let profile = [
        [0.0, -0.019],
        [0.009, -0.020],
        [0.016, -0.015],
        [0.0184, -0.006],
        [0.0172, 0.003],
        [0.0135, 0.013],
        [0.008, 0.0215],
        [0.0, 0.025],
    ];
    let along = pose([0.0; 3], Z_TO_X);
    builder.lathe(&profile, along, skin_appearance(vary_brightness(stream, srgb([206, 24, 34]))));
    for (ring, [radius, x]) in (0..).zip([[0.0184, -0.008], [0.0174, 0.002], [0.0138, 0.012]]) {
        for [y, z] in arc(radius, 0..=47).into_iter().skip(4 * (ring % 2)).step_by(8) {
            // A seed at the very bottom would lift the strawberry.
            if z > -0.9 * radius {
                let half = [0.0009, 0.0005, 0.0005];
                builder.visual_rounded_box(half, [x, y, z], 0.0004, skin_appearance(srgb([232, 196, 96])));
            }
        }
    }
    let star: Vec<_> = arc(1.0, 0..=47)
        .chunks(4)
        .enumerate()
        .map(|(i, point)| point[0].map(|x| x * if i % 2 == 0 { 0.0155 } else { 0.006 }))
        .collect();
    let leaf = skin_appearance(srgb([64, 126, 44]));
    builder.extrusion(&star, &[], 0.001, pose([-0.0195, 0.0, 0.0], Z_TO_X), leaf);
    let stem = VisualShape::Primitive(Primitive::Capsule { radius: 0.0012, half_height: 0.002 });
    builder.visual(stem, pose([-0.0215, 0.0, 0.0], Z_TO_X), leaf);
    builder.build(stream)
}

/// Starts a round fruit centred on the origin, with its collision shapes.
fn start_round(radius: f64) -> DistractorBuilder {
    let mut builder = DistractorBuilder::new(850.0);
    builder.collider(Primitive::Ball { radius }, pose([0.0; 3], IDENTITY)).rolling_resistance();
    builder.collider_cylinder(0.25 * radius, [-radius, -0.7 * radius]);
    builder
}

/// Adds two nearly coincident balls.
fn halves(builder: &mut DistractorBuilder, radius: f64, appearances: [AppearanceSpec; 2]) {
    let offset = 0.08 * radius;
    let half = VisualShape::Primitive(Primitive::Ball { radius: radius - offset });
    for (y, appearance) in [offset, -offset].into_iter().zip(appearances) {
        builder.visual(half.clone(), pose([0.0, y, 0.0], IDENTITY), appearance);
    }
}

fn stem(builder: &mut DistractorBuilder, middle: [f64; 3], half_height: f64) {
    let shape = Primitive::Capsule { radius: 0.0018, half_height };
    builder.visual(
        VisualShape::Primitive(shape),
        pose(middle, IDENTITY),
        skin_appearance(srgb([84, 58, 34])),
    );
}

/// Adds the scar left by the stem.
fn stem_scar(builder: &mut DistractorBuilder, radius: f64) {
    let scar = Primitive::Cylinder { radius: 0.0032, half_height: 0.0006 };
    builder.visual(
        VisualShape::Primitive(scar),
        pose([0.0, 0.0, radius], IDENTITY),
        skin_appearance(srgb([92, 100, 48])),
    );
}

fn skin_appearance(color: [f64; 3]) -> AppearanceSpec {
    AppearanceSpec { specular: PEEL_SPECULAR, ..AppearanceSpec::plain(color) }
}
