//! Bottles, a sprayer and a pitcher.

use super::Distractor;
use super::appearance::{BLACK, WHITE, glossy, matt, pale, pick, srgb, vary_brightness, vivid, vivid_colors};
use super::builder::{DistractorBuilder, IDENTITY, X_TO_Y_TO_Z, Y_TO_Z, pose};
use crate::stream::Stream;
use crate::{AppearanceSpec, rounded_rectangle};

/// Samples a mustard squeeze bottle.
pub(crate) fn mustard(stream: &mut Stream) -> Distractor {
    let half = [0.028, 0.0465];
    let mut builder = DistractorBuilder::new(430.0);
    let filling = pick(stream, &[srgb([238, 196, 30]), srgb([186, 28, 24]), srgb([240, 232, 200])]);
    let body = glossy(vary_brightness(stream, filling));
    let [main, cap] = vivid_colors(stream);
    bottle_body(&mut builder, half, 0.145, body);
    builder.collider_cylinder(0.016, [0.145, 0.19]);
    wraparound_label(&mut builder, half, [0.035, 0.108], matt(main));
    label_print(&mut builder, half, [0.05, 0.09], matt(WHITE), matt(cap));
    let nozzle = [
        [0.0, 0.14],
        [0.0165, 0.14],
        [0.0165, 0.158],
        [0.012, 0.161],
        [0.007, 0.166],
        [0.004, 0.19],
        [0.0, 0.19],
    ];
    builder.lathe_about_z(&nozzle, glossy(cap));
    builder.build(stream)
}

/// Samples a cleanser bottle with a screw cap.
pub(crate) fn cleanser(stream: &mut Stream) -> Distractor {
    let half = [0.031, 0.049];
    let mut builder = DistractorBuilder::new(430.0);
    let [main, other] = vivid_colors(stream);
    bottle_body(&mut builder, half, 0.18, glossy(pale(stream)));
    builder.collider_cylinder(0.0165, [0.18, 0.226]);
    wraparound_label(&mut builder, half, [0.025, 0.14], matt(main));
    label_print(&mut builder, half, [0.05, 0.115], matt(WHITE), matt(other));
    builder.visual_cylinder(0.013, [0.175, 0.2], glossy(WHITE));
    let cap = [[0.0, 0.194], [0.017, 0.194], [0.017, 0.2], [0.0155, 0.222], [0.013, 0.226], [0.0, 0.226]];
    builder.lathe_about_z(&cap, glossy(other));
    builder.build(stream)
}

/// Samples a window-cleaner bottle with a spray trigger.
pub(crate) fn sprayer(stream: &mut Stream) -> Distractor {
    let half = [0.026, 0.041];
    let mut builder = DistractorBuilder::new(430.0);
    let [fluid, head, other] = vivid_colors(stream);
    bottle_body(&mut builder, half, 0.145, glossy(fluid));
    builder.collider_cylinder(0.0135, [0.145, 0.19]);
    wraparound_label(&mut builder, half, [0.03, 0.1], matt(WHITE));
    label_print(&mut builder, half, [0.045, 0.085], matt(other), matt(WHITE));
    let collar = [[0.0, 0.138], [0.0145, 0.138], [0.0145, 0.156], [0.011, 0.162], [0.011, 0.2], [0.0, 0.2]];
    builder.lathe_about_z(&collar, glossy(WHITE));
    // Side profiles: the nozzle in front, the hood behind it and the trigger below.
    let hood =
        [[0.046, 0.222], [-0.03, 0.225], [-0.03, 0.212], [-0.012, 0.19], [0.018, 0.19], [0.046, 0.206]];
    let trigger =
        [[0.02, 0.195], [0.032, 0.195], [0.04, 0.176], [0.041, 0.158], [0.036, 0.158], [0.03, 0.176]];
    let stand = pose([0.0; 3], X_TO_Y_TO_Z);
    builder.extrusion(&hood, &[], 0.011, stand, glossy(head));
    builder.extrusion(&trigger, &[], 0.006, stand, glossy(other));
    builder.collider_box([0.011, 0.04, 0.0175], [0.0, 0.01, 0.2075]);
    builder.collider_box([0.006, 0.006, 0.02], [0.0, 0.034, 0.178]);
    builder.visual_rounded_box([0.007, 0.004, 0.006], [0.0, 0.046, 0.214], 0.002, glossy(BLACK));
    builder.build(stream)
}

/// Samples a plastic pitcher with a lid, a spout and a handle.
pub(crate) fn pitcher(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(180.0);
    let (body, lid) = (vivid(stream), pick(stream, &[WHITE, BLACK, srgb([40, 90, 170])]));
    builder
        .collider_cylinder(0.05, [0.0, 0.1])
        .collider_cylinder(0.055, [0.1, 0.215])
        .collider_box([0.025, 0.009, 0.065], [-0.07, 0.0, 0.115]);
    let wall = [[0.0, 0.0], [0.046, 0.0], [0.048, 0.003], [0.055, 0.195], [0.057, 0.2], [0.0, 0.2]];
    builder.lathe_about_z(&wall, glossy(body));
    let cover = [
        [0.0, 0.199],
        [0.056, 0.199],
        [0.056, 0.208],
        [0.052, 0.211],
        [0.02, 0.211],
        [0.018, 0.215],
        [0.0, 0.215],
    ];
    builder.lathe_about_z(&cover, glossy(lid));
    let grip =
        [[-0.045, 0.178], [-0.083, 0.178], [-0.093, 0.166], [-0.093, 0.12], [-0.083, 0.07], [-0.045, 0.052]];
    let hole =
        [[-0.045, 0.162], [-0.075, 0.162], [-0.079, 0.156], [-0.079, 0.12], [-0.071, 0.083], [-0.045, 0.07]];
    let outline: Vec<_> = grip.iter().chain(hole.iter().rev()).copied().collect();
    builder.extrusion(&outline, &[], 0.008, pose([0.0; 3], Y_TO_Z), glossy(body));
    let spout = [[0.05, 0.2], [0.068, 0.2], [0.05, 0.165]];
    builder.extrusion(&spout, &[], 0.012, pose([0.0; 3], Y_TO_Z), glossy(body));
    builder.collider_box([0.008, 0.012, 0.015], [0.06, 0.0, 0.185]);
    builder.build(stream)
}

/// Radius of a bottle's vertical edges and shoulders, in m.
const EDGE_RADIUS: f64 = 0.024;

/// Adds the body of a bottle, with a straight base and rounded shoulders.
fn bottle_body(builder: &mut DistractorBuilder, [x, y]: [f64; 2], height: f64, appearance: AppearanceSpec) {
    let half_height = height / 2.0;
    builder.visual_rounded_box([x, y, half_height], [0.0, 0.0, half_height], EDGE_RADIUS, appearance);
    let foot = rounded_rectangle([x, y], EDGE_RADIUS);
    builder.extrusion(
        &foot,
        &[],
        EDGE_RADIUS / 2.0,
        pose([0.0, 0.0, EDGE_RADIUS / 2.0], IDENTITY),
        appearance,
    );
    let low = height - EDGE_RADIUS / 2.0;
    builder.collider_crossed_boxes([x, y, low / 2.0], EDGE_RADIUS / 2.0, [0.0, 0.0, low / 2.0]);
    builder.collider_box([x / 2.0, y - EDGE_RADIUS / 2.0, half_height], [0.0, 0.0, half_height]);
}

/// Adds a label wrapped all around a bottle between two heights.
fn wraparound_label(
    builder: &mut DistractorBuilder,
    [x, y]: [f64; 2],
    [low, high]: [f64; 2],
    appearance: AppearanceSpec,
) {
    let outline = rounded_rectangle([x + 0.0004, y + 0.0004], EDGE_RADIUS);
    builder.extrusion(
        &outline,
        &[],
        (high - low) / 2.0,
        pose([0.0, 0.0, f64::midpoint(low, high)], IDENTITY),
        appearance,
    );
}

/// Adds the print on the front and back of a wraparound label: a field and a title inside it.
fn label_print(
    builder: &mut DistractorBuilder,
    [x, y]: [f64; 2],
    [low, high]: [f64; 2],
    field: AppearanceSpec,
    title: AppearanceSpec,
) {
    let (flat, middle, half) = (y - EDGE_RADIUS, f64::midpoint(low, high), (high - low) / 2.0);
    builder.visual_box([x + 0.0008, flat, half], [0.0, 0.0, middle], field);
    builder.visual_box([x + 0.0012, 0.8 * flat, 0.3 * half], [0.0, 0.0, middle + 0.4 * half], title);
    builder.visual_box([x + 0.0012, 0.6 * flat, 0.1 * half], [0.0, 0.0, middle - 0.3 * half], title);
}
