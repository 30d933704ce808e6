//! Workshop tools, lying flat.

use core::f64::consts::SQRT_2;

use super::Distractor;
use super::appearance::{
    BLACK, WHITE, glossy, iron, matt, pick, srgb, steel, vary_brightness, vivid, vivid_colors, wood,
};
use super::builder::{
    DistractorBuilder, IDENTITY, LABEL_THICKNESS, Y_TO_Z, Z_TO_X, Z_TO_Y, arc, ellipse, pose,
};
use crate::stream::Stream;
use crate::{AppearanceSpec, Primitive, VisualShape, rounded_rectangle};

/// Samples a cordless drill on its side: its chuck along x, its grip along −y.
pub(crate) fn drill(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(900.0);
    let colors = [
        srgb([222, 96, 22]),
        srgb([236, 186, 24]),
        srgb([24, 116, 130]),
        srgb([176, 28, 30]),
        srgb([30, 80, 160]),
    ];
    let shell = glossy(pick(stream, &colors));
    let (rubber, thick) = (matt(BLACK), 0.027);
    builder.rounded_box([0.05, 0.026, thick], [-0.03, 0.0, 0.0], 0.013, shell);
    builder.rounded_box([0.019, 0.045, 0.018], [-0.042, -0.06, 0.0], 0.01, shell);
    builder.rounded_box([0.038, 0.019, thick], [-0.034, -0.119, 0.0], 0.006, rubber);
    // The gear box, the chuck and the bit.
    let nose = [
        [0.0, -0.003],
        [0.023, -0.003],
        [0.021, 0.018],
        [0.0175, 0.019],
        [0.0175, 0.043],
        [0.013, 0.05],
        [0.006, 0.057],
        [0.0, 0.057],
    ];
    builder.lathe(&nose, pose([0.02, 0.0, 0.0], Z_TO_X), rubber);
    builder.visual_cylinder_along_x(0.0178, [0.046, 0.05], steel()).visual_cylinder_along_x(
        0.003,
        [0.076, 0.105],
        steel(),
    );
    builder.collider(Primitive::Cylinder { radius: 0.02, half_height: 0.02 }, pose([0.04, 0.0, 0.0], Z_TO_X));
    builder.collider(
        Primitive::Cylinder { radius: 0.009, half_height: 0.0225 },
        pose([0.0825, 0.0, 0.0], Z_TO_X),
    );
    // The trigger, the rubber grip, the vents and the name plate.
    builder.visual_rounded_box([0.006, 0.014, 0.008], [-0.021, -0.043, 0.0], 0.004, rubber);
    builder.visual_rounded_box([0.008, 0.03, 0.0185], [-0.053, -0.062, 0.0], 0.006, rubber);
    for vent in 0..4 {
        let x = -0.07 + 0.005 * f64::from(vent);
        builder.visual_box([0.001, 0.01, LABEL_THICKNESS], [x, 0.0, thick], rubber);
    }
    builder.visual_box([0.018, 0.008, LABEL_THICKNESS], [-0.032, 0.0, thick], matt(WHITE));
    builder.visual_box([0.02, 0.006, LABEL_THICKNESS], [-0.034, -0.121, thick], shell);
    builder.build(stream)
}

/// Samples a wooden block.
pub(crate) fn wood_block(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(560.0);
    let half = [0.1, 0.0425, 0.0425];
    builder.rounded_box(half, [0.0; 3], 0.0015, wood(stream));
    builder.build(stream)
}

/// Tangent of 22.5°, the half-angle of an eighth of a turn.
const EIGHTH: f64 = SQRT_2 - 1.0;

/// Samples a screwdriver.
pub(crate) fn screwdriver(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(1100.0);
    let [main, other] = vivid_colors(stream);
    let radius = 0.0155;
    let handle = [
        [0.0, -0.1],
        [0.009, -0.1],
        [0.0145, -0.094],
        [0.0155, -0.08],
        [0.0155, -0.03],
        [0.0105, -0.02],
        [0.0105, -0.012],
        [0.0135, -0.006],
        [0.01, 0.0],
        [0.0, 0.0],
    ];
    let along = pose([0.0; 3], Z_TO_X);
    builder.lathe(&handle, along, glossy(main)).visual_cylinder_along_x(
        radius + LABEL_THICKNESS - 0.0006,
        [-0.076, -0.066],
        glossy(other),
    );
    // Grip ribs, as thick as the handle.
    for turn in [IDENTITY, [1.0, EIGHTH, 0.0, 0.0], Y_TO_Z, [1.0, -EIGHTH, 0.0, 0.0]] {
        let rib = VisualShape::RoundedBox { half: [0.016, 0.0022, radius], edge_radius: 0.0015 };
        builder.visual(rib, pose([-0.046, 0.0, 0.0], turn), glossy(other));
    }
    let tip = [[0.0, 0.0], [0.0032, 0.0], [0.0032, 0.094], [0.002, 0.1], [0.0, 0.1]];
    builder.lathe(&tip, along, steel());
    builder.collider_bar_along_x(radius, [-0.1, 0.0]).collider_box([0.05, 0.0032, 0.0032], [0.05, 0.0, 0.0]);
    builder.build(stream)
}

/// Samples an adjustable wrench.
pub(crate) fn wrench(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(5000.0);
    let half = 0.006;
    let metal = pick(stream, &[steel(), iron()]);
    let flat = pose([0.0, 0.0, half], IDENTITY);
    let bar = [
        [-0.11, -0.008],
        [-0.105, -0.0115],
        [0.05, -0.0085],
        [0.062, -0.02],
        [0.078, -0.026],
        [0.105, -0.022],
        [0.106, -0.013],
        [0.083, -0.01],
        [0.079, 0.002],
        [0.074, 0.018],
        [0.06, 0.018],
        [0.05, 0.0085],
        [-0.105, 0.0115],
        [-0.11, 0.008],
    ];
    let hole: Vec<_> =
        rounded_rectangle([0.006, 0.004], 0.0039).iter().map(|[x, y]| [x - 0.098, *y]).collect();
    builder.extrusion(&bar, &[&hole], half, flat, metal);
    let jaw = [[0.076, 0.003], [0.106, 0.006], [0.107, 0.014], [0.094, 0.019], [0.074, 0.019]];
    builder.extrusion(&jaw, &[], half - 0.001, flat, metal);
    let worm = Primitive::Cylinder { radius: half, half_height: 0.007 };
    builder.visual(VisualShape::Primitive(worm), pose([0.064, 0.005, half], Z_TO_X), iron());
    if stream.unit() < 0.5 {
        let grip = matt(vivid(stream));
        builder.visual_rounded_box([0.04, 0.0125, half + 0.0015], [-0.05, 0.0, half + 0.0015], 0.003, grip);
    } else {
        builder.visual_rounded_box(
            [0.045, 0.0045, half + LABEL_THICKNESS],
            [-0.03, 0.0, half + LABEL_THICKNESS],
            0.001,
            iron(),
        );
    }
    let thick = half + 0.0006;
    builder.collider_box([0.0825, 0.0105, thick], [-0.0275, 0.0, thick]);
    builder
        .collider_box([0.0135, 0.0215, half], [0.0675, -0.0035, half])
        .collider_box([0.0135, 0.006, half], [0.0925, -0.0185, half]);
    builder.collider_box([0.0135, 0.0065, half], [0.0925, 0.012, half]);
    builder.build(stream)
}

/// Samples a hammer. The end of its handle is as thick as its head, so that it lies level.
pub(crate) fn hammer(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(1500.0);
    let thick = 0.0135;
    let (metal, [main, other]) = (pick(stream, &[steel(), iron()]), vivid_colors(stream));
    let wooden = stream.unit() < 0.5;
    let grip = if wooden { wood(stream) } else { glossy(main) };
    builder.rounded_box([0.055, 0.012, thick], [-0.06, 0.0, 0.0], 0.006, grip);
    let neck = if wooden { grip } else { glossy(other) };
    builder.rounded_box([0.052, 0.009, 0.0085], [0.045, 0.0, 0.0], 0.004, neck);
    builder.rounded_box([0.0125, 0.015, thick], [0.0955, 0.0, 0.0], 0.003, metal);
    let face = [
        [0.0, 0.01],
        [0.009, 0.01],
        [0.009, 0.024],
        [0.0132, 0.028],
        [0.0132, 0.04],
        [0.0115, 0.043],
        [0.0, 0.043],
    ];
    builder.lathe(&face, pose([0.0955, 0.0, 0.0], Z_TO_Y), metal);
    builder.collider_box([0.012, 0.015, 0.0125], [0.0955, 0.028, 0.0]);
    let claw = [
        [0.107, -0.012],
        [0.109, -0.03],
        [0.1, -0.046],
        [0.082, -0.058],
        [0.08, -0.056],
        [0.09, -0.042],
        [0.087, -0.012],
    ];
    builder.extrusion(&claw, &[], 0.01, pose([0.0; 3], IDENTITY), metal);
    builder
        .collider_box([0.011, 0.0145, 0.01], [0.097, -0.0285, 0.0])
        .collider_box([0.009, 0.0075, 0.01], [0.089, -0.05, 0.0]);
    builder.build(stream)
}

/// Samples a screw clamp lying flat, with its frame open towards −y.
pub(crate) fn clamp(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(3000.0);
    let half = 0.009;
    let frame =
        glossy(if stream.unit() < 0.5 { vivid(stream) } else { vary_brightness(stream, srgb([70, 72, 76])) });
    let outline = [
        [-0.05, -0.045],
        [-0.036, -0.045],
        [-0.036, 0.006],
        [-0.028, 0.014],
        [0.028, 0.014],
        [0.036, 0.006],
        [0.036, -0.045],
        [0.05, -0.045],
        [0.05, 0.012],
        [0.034, 0.03],
        [-0.034, 0.03],
        [-0.05, 0.012],
    ];
    builder.extrusion(&outline, &[], half, pose([0.0; 3], IDENTITY), frame);
    let screw = |builder: &mut DistractorBuilder, radius, between| {
        builder.visual_cylinder_along_x_at(radius, between, -0.035, steel());
    };
    screw(&mut builder, 0.0055, [-0.005, 0.09]);
    screw(&mut builder, 0.0088, [-0.011, -0.004]);
    screw(&mut builder, 0.0085, [0.048, 0.057]);
    screw(&mut builder, 0.0075, [0.085, 0.096]);
    let bar = Primitive::Capsule { radius: 0.003, half_height: 0.022 };
    builder.visual(VisualShape::Primitive(bar), pose([0.0905, -0.035, 0.0], Z_TO_Y), steel());
    builder.collider_box([0.05, 0.0085, half], [0.0, 0.0215, 0.0]);
    builder
        .collider_box([0.007, 0.029, half], [-0.043, -0.016, 0.0])
        .collider_box([0.007, 0.029, half], [0.043, -0.016, 0.0]);
    builder
        .collider_box([0.0515, 0.006, 0.006], [0.0405, -0.035, 0.0])
        .collider_box([0.004, 0.025, 0.0035], [0.0905, -0.035, 0.0]);
    builder.build(stream)
}

/// Samples a closed padlock lying flat.
pub(crate) fn padlock(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(2600.0);
    let brass = AppearanceSpec { specular: 0.6, ..glossy(srgb([196, 152, 62])) };
    let body = pick(stream, &[brass, steel(), glossy(BLACK), glossy(srgb([28, 60, 140]))]);
    let half = [0.022, 0.0185, 0.0095];
    builder.rounded_box(half, [0.0; 3], 0.0035, body);
    let bow = |radius: f64| {
        let ends = [[[radius, 0.01]], [[-radius, 0.01]]];
        let round: Vec<_> = arc(radius, 0..=24).into_iter().map(|[x, y]| [x, y + 0.028]).collect();
        [&ends[0][..], &round[..], &ends[1][..]].concat()
    };
    let shackle: Vec<_> = bow(0.0185).into_iter().chain(bow(0.0125).into_iter().rev()).collect();
    builder.extrusion(&shackle, &[], 0.003, pose([0.0; 3], IDENTITY), steel());
    builder
        .collider_box([0.003, 0.01, 0.003], [0.0155, 0.028, 0.0])
        .collider_box([0.003, 0.01, 0.003], [-0.0155, 0.028, 0.0]);
    builder.collider_box([0.0135, 0.0045, 0.003], [0.0, 0.042, 0.0]);
    builder.visual_box([0.02, 0.001, LABEL_THICKNESS], [0.0, 0.008, half[2]], iron());
    // The lock and its keyhole.
    builder.visual_cylinder(0.006, [0.0, half[2] + LABEL_THICKNESS], iron());
    builder.visual_box([0.0008, 0.003, 2.0 * LABEL_THICKNESS], [0.0, 0.0, half[2]], matt(BLACK));
    builder.build(stream)
}

/// Samples a pair of scissors, slightly open, with the finger rings towards −x.
pub(crate) fn scissors(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(2500.0);
    let plastic = glossy(vivid(stream));
    let ring = |side: f64| {
        let around =
            |axes| ellipse(axes).iter().map(|[x, y]| [x - 0.06, y + side * 0.0215]).collect::<Vec<_>>();
        (around([0.028, 0.019]), around([0.02, 0.0115]))
    };
    for (side, z) in [(1.0, 0.005), (-1.0, 0.007)] {
        let (outer, inner) = ring(side);
        builder.extrusion(&outer, &[&inner], 0.005, pose([0.0, 0.0, 0.005], IDENTITY), plastic);
        // From the finger ring through the pivot to the tip on the other side.
        let shank =
            [[-0.046, side * 0.008], [0.004, -side * 0.008], [0.012, side * 0.004], [-0.038, side * 0.014]];
        builder.extrusion(&shank, &[], 0.0028, pose([0.0, 0.0, z - 0.001], IDENTITY), plastic);
        let edge =
            [[-0.006, side * 0.003], [0.006, -side * 0.0085], [0.1, -side * 0.0125], [0.012, side * 0.0035]];
        builder.extrusion(&edge, &[], 0.001, pose([0.0, 0.0, z], IDENTITY), steel());
        builder.collider_box([0.028, 0.0145, 0.005], [-0.06, side * 0.0255, 0.005]);
    }
    builder.visual_cylinder(0.004, [0.003, 0.0096], steel());
    builder
        .collider_box([0.03, 0.011, 0.0048], [-0.012, 0.0, 0.0048])
        .collider_box([0.041, 0.0115, 0.004], [0.059, 0.0, 0.004]);
    builder.build(stream)
}

/// Samples a roll of adhesive tape.
pub(crate) fn tape(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(430.0);
    let color = pick(
        stream,
        &[srgb([150, 152, 156]), BLACK, srgb([206, 172, 116]), srgb([180, 30, 34]), srgb([236, 232, 214])],
    );
    let ([inner, core, outer], height) = ([0.0335, 0.036, 0.052], 0.046);
    builder.collider_cylinder(outer, [0.0, height]);
    let ring = |from: f64, to: f64, low: f64, high: f64| {
        [[from, low], [to, low], [to, high], [from, high], [from, low]]
    };
    builder.lathe_about_z(&ring(inner, core, 0.0005, height - 0.0005), matt(srgb([178, 140, 96])));
    builder.lathe_about_z(&ring(core, outer, 0.0, height), glossy(vary_brightness(stream, color)));
    builder.build(stream)
}

/// Samples a marker pen with its cap on.
pub(crate) fn marker(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(950.0);
    let ink = vivid(stream);
    let barrel = if stream.unit() < 0.5 { WHITE } else { ink };
    let radius = 0.0095;
    let body = [[0.0, -0.06], [0.0075, -0.06], [0.0088, -0.058], [0.0088, 0.02], [0.0, 0.02]];
    let cap =
        [[0.0, 0.012], [0.0093, 0.012], [0.0095, 0.014], [0.0085, 0.058], [0.0065, 0.062], [0.0, 0.062]];
    let along = pose([0.0; 3], Z_TO_X);
    builder.lathe(&body, along, glossy(barrel)).lathe(&cap, along, glossy(ink));
    builder.visual_cylinder_along_x(
        0.0088 + LABEL_THICKNESS,
        [-0.045, -0.005],
        matt(if barrel == WHITE { ink } else { WHITE }),
    );
    builder.visual_cylinder_along_x(0.0077, [-0.0605, -0.056], glossy(ink));
    builder.visual_rounded_box([0.016, 0.0018, 0.0012], [0.033, 0.0, 0.0094], 0.0008, glossy(ink));
    builder.collider_bar_along_x(radius, [-0.0605, 0.062]);
    builder.build(stream)
}
