//! Cutlery and a spatula, lying along x.

use super::Distractor;
use super::appearance::{BLACK, glossy, matt, pale, pick, srgb, steel, vivid, wood};
use super::builder::{DistractorBuilder, IDENTITY, LABEL_THICKNESS, ellipse, pose};
use crate::stream::Stream;
use crate::{AppearanceSpec, rounded_rectangle};

/// Thickness of sheet metal, in m.
const SHEET_THICKNESS: f64 = 0.003;
/// Thickness of a handle with scales, in m.
const HANDLE_THICKNESS: f64 = 0.009;

/// Samples a fork.
pub(crate) fn fork(stream: &mut Stream) -> Distractor {
    let mut builder = start_with_handle(stream);
    let neck = [[0.0, -0.0035], [0.022, -0.004], [0.034, -0.0125]];
    let mut outline = neck.to_vec();
    for tine in 0..4 {
        let y = -0.0125 + 0.0071 * f64::from(tine);
        outline.extend([[0.084, y + 0.0008], [0.084, y + 0.0028], [0.052, y + 0.0036]]);
        if tine < 3 {
            outline.push([0.052, y + 0.0071]);
        }
    }
    outline.extend(neck.iter().rev().map(|[x, y]| [*x, -y]));
    sheet_metal(&mut builder, &outline);
    builder.collider_box([0.042, 0.0125, SHEET_THICKNESS / 2.0], [0.042, 0.0, SHEET_THICKNESS / 2.0]);
    builder.build(stream)
}

/// Samples a table knife.
pub(crate) fn knife(stream: &mut Stream) -> Distractor {
    let mut builder = start_with_handle(stream);
    let outline = [
        [0.0, -0.007],
        [0.014, -0.008],
        [0.075, -0.0105],
        [0.092, -0.0085],
        [0.102, -0.002],
        [0.105, 0.006],
        [0.1, 0.0085],
        [0.0, 0.0075],
    ];
    sheet_metal(&mut builder, &outline);
    builder.collider_box([0.0525, 0.009, SHEET_THICKNESS / 2.0], [0.0525, -0.001, SHEET_THICKNESS / 2.0]);
    builder.build(stream)
}

/// Samples a spoon with an open bowl.
pub(crate) fn spoon(stream: &mut Stream) -> Distractor {
    let mut builder = start_with_handle(stream);
    sheet_metal(&mut builder, &[[0.0, -0.004], [0.045, -0.003], [0.045, 0.003], [0.0, 0.004]]);
    // The bowl: a bottom plate inside two rings, each wider than the one below it.
    let at = |z| pose([0.066, 0.0, z], IDENTITY);
    let dull = AppearanceSpec { specular: 0.5, ..AppearanceSpec::plain(srgb([148, 150, 156])) };
    builder.extrusion(&ellipse([0.022, 0.014]), &[], 0.001, at(0.001), dull);
    for (outer, inner, z) in
        [([0.026, 0.018], [0.021, 0.0135], 0.003), ([0.03, 0.021], [0.0265, 0.018], 0.0055)]
    {
        builder.extrusion(&ellipse(outer), &[&ellipse(inner)], 0.0015, at(z), steel());
    }
    builder
        .collider_box([0.022, 0.019, 0.0035], [0.066, 0.0, 0.0035])
        .collider_box([0.03, 0.012, 0.0035], [0.066, 0.0, 0.0035]);
    builder.collider_box([0.02, 0.004, SHEET_THICKNESS / 2.0], [0.02, 0.0, SHEET_THICKNESS / 2.0]);
    builder.build(stream)
}

/// Samples a slotted spatula.
pub(crate) fn spatula(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(900.0);
    let plastic = pick(stream, &[BLACK, srgb([30, 110, 110]), srgb([176, 40, 36])]);
    let grip = if stream.unit() < 0.5 { wood(stream) } else { glossy(plastic) };
    let outline = [
        [0.0, -0.02],
        [0.012, -0.034],
        [0.078, -0.036],
        [0.082, -0.033],
        [0.082, 0.033],
        [0.078, 0.036],
        [0.012, 0.034],
        [0.0, 0.02],
    ];
    let slot = |y: f64| {
        rounded_rectangle([0.023, 0.003], 0.0029)
            .iter()
            .map(|[x, dy]| [x + 0.043, dy + y])
            .collect::<Vec<_>>()
    };
    let slots = [-0.02, 0.0, 0.02].map(slot);
    let holes: Vec<_> = slots.iter().map(Vec::as_slice).collect();
    builder.extrusion(
        &outline,
        &holes,
        SHEET_THICKNESS / 2.0,
        pose([0.0, 0.0, SHEET_THICKNESS / 2.0], IDENTITY),
        glossy(plastic),
    );
    builder.collider_box([0.041, 0.0345, SHEET_THICKNESS / 2.0], [0.041, 0.0, SHEET_THICKNESS / 2.0]);
    let height = 0.016;
    builder.rounded_box([0.05, 0.011, height / 2.0], [-0.092, 0.0, height / 2.0], 0.0055, grip);
    // The stem slopes down from the handle to the blade.
    builder.collider_box([0.026, 0.005, 0.003], [-0.02, 0.0, 0.0045]);
    builder.visual_rounded_box([0.032, 0.005, 0.003], [-0.016, 0.0, 0.0045], 0.0025, steel());
    builder.visual_box([0.004, 0.004, LABEL_THICKNESS], [-0.13, 0.0, height], matt([0.2; 3]));
    builder.build(stream)
}

/// Starts a piece of cutlery with its handle, which ends at x = 0: bare steel or with scales of plastic or
/// wood.
fn start_with_handle(stream: &mut Stream) -> DistractorBuilder {
    let mut builder = DistractorBuilder::new(3000.0);
    let length = 0.1;
    if stream.unit() < 0.45 {
        let outline = [
            [0.005, -0.0035],
            [-0.05, -0.0042],
            [-0.085, -0.008],
            [-0.096, -0.007],
            [-0.1, 0.0],
            [-0.096, 0.007],
            [-0.085, 0.008],
            [-0.05, 0.0042],
            [0.005, 0.0035],
        ];
        sheet_metal(&mut builder, &outline);
        builder.collider_box(
            [length / 2.0, 0.007, SHEET_THICKNESS / 2.0],
            [-length / 2.0, 0.0, SHEET_THICKNESS / 2.0],
        );
        return builder;
    }
    let scales = match pick(stream, &[0, 1, 2]) {
        0 => glossy(vivid(stream)),
        1 => glossy(pale(stream)),
        _ => wood(stream),
    };
    let (half, middle) =
        ([length / 2.0, 0.0085, HANDLE_THICKNESS / 2.0], [-length / 2.0, 0.0, HANDLE_THICKNESS / 2.0]);
    builder.rounded_box(half, middle, 0.0035, scales);
    for x in [-0.018, -0.082] {
        builder.visual_rounded_box(
            [0.0022, 0.0022, LABEL_THICKNESS],
            [x, 0.0, HANDLE_THICKNESS],
            LABEL_THICKNESS,
            steel(),
        );
    }
    builder
}

/// Adds a piece of sheet metal lying on the table.
fn sheet_metal(builder: &mut DistractorBuilder, outline: &[[f64; 2]]) {
    builder.extrusion(
        outline,
        &[],
        SHEET_THICKNESS / 2.0,
        pose([0.0, 0.0, SHEET_THICKNESS / 2.0], IDENTITY),
        steel(),
    );
}
