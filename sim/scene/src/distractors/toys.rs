//! Toys and other small objects.

use super::Distractor;
use super::appearance::{
    BLACK, WHITE, glossy, matt, pale, pick, srgb, vary_brightness, vivid, vivid_colors, wood,
};
use super::builder::{
    DistractorBuilder, HALF_TURN_Z, IDENTITY, LABEL_THICKNESS, Quat, Y_TO_Z, Z_TO_X, Z_TO_Y, arc, ellipse,
    pose,
};
use crate::stream::Stream;
use crate::{AppearanceSpec, Primitive, VisualShape, rounded_rectangle};

/// Rotations from the z axis to the visible faces of a cube: the top first, then the sides.
const FACES: [Quat; 5] = [IDENTITY, Z_TO_X, Z_TO_Y, [1.0, 0.0, -1.0, 0.0], Y_TO_Z];

/// Samples a foam brick.
pub(crate) fn foam_brick(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(150.0);
    let color =
        pick(stream, &[srgb([196, 44, 40]), srgb([40, 90, 170]), srgb([234, 190, 60]), srgb([90, 150, 70])]);
    let half = [0.039, 0.026, 0.0255];
    let foam = matt(vary_brightness(stream, color));
    builder.friction(0.7).rounded_box(half, [0.0; 3], 0.002, foam);
    let hollow = matt(color.map(|channel| 0.35 * channel));
    for x in [-0.022, 0.0, 0.022] {
        let hole = Primitive::Cylinder { radius: 0.0065, half_height: LABEL_THICKNESS };
        builder.visual(VisualShape::Primitive(hole), pose([x, 0.0, half[2]], IDENTITY), hollow);
    }
    builder.build(stream)
}

/// Samples a die.
pub(crate) fn die(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(1700.0);
    let [main, _] = vivid_colors(stream);
    let (body, pips) = pick(stream, &[(WHITE, BLACK), (main, WHITE), (BLACK, WHITE)]);
    let half = 0.0125;
    builder.rounded_box([half; 3], [0.0; 3], 0.0022, glossy(body));
    let step = 0.0055;
    let corners = [[-step, -step], [step, step], [-step, step], [step, -step], [-step, 0.0], [step, 0.0]];
    // Five pips on top; two, three, four and six on the sides. The face with one pip lies on the table.
    for (face, count) in FACES.into_iter().zip([5, 2, 3, 4, 6]) {
        let odd = (count % 2 == 1).then_some([0.0, 0.0]);
        for [x, y] in corners.into_iter().take(count / 2 * 2).chain(odd) {
            let dot: Vec<_> =
                arc(0.0021, 0..=47).into_iter().step_by(4).map(|[u, v]| [u + x, v + y]).collect();
            let lifted = pose([0.0; 3], face) * pose([0.0, 0.0, half], IDENTITY);
            builder.extrusion(&dot, &[], LABEL_THICKNESS, lifted, glossy(pips));
        }
    }
    builder.build(stream)
}

/// Pitch of the studs of a toy brick, in m.
const PITCH: f64 = 0.016;
/// Height of a toy brick, in m.
const BRICK_HEIGHT: f64 = 0.0192;
/// Radius and height of a stud, in m.
const STUD: [f64; 2] = [0.0047, 0.0045];

/// Samples a toy brick with 2 × 2 studs.
pub(crate) fn small_brick(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(1300.0);
    let color = vivid(stream);
    brick(&mut builder, [2, 2], 0.0, glossy(color));
    builder.build(stream)
}

/// Samples a toy brick with 2 × 3, 2 × 4 or 2 × 6 studs.
pub(crate) fn long_brick(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(950.0);
    let (length, color) = (pick(stream, &[3, 4, 6]), vivid(stream));
    brick(&mut builder, [length, 2], 0.0, glossy(color));
    builder.build(stream)
}

/// Samples a stack of three toy bricks.
pub(crate) fn brick_tower(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(700.0);
    let colors: [_; 3] = vivid_colors(stream);
    let sizes = pick(stream, &[[[4, 2], [2, 2], [2, 2]], [[4, 2], [4, 2], [2, 2]], [[2, 2], [2, 2], [2, 2]]]);
    for (level, (color, size)) in (0..).zip(colors.into_iter().zip(sizes)) {
        brick(&mut builder, size, f64::from(level) * BRICK_HEIGHT, glossy(color));
    }
    builder.build(stream)
}

/// Adds a brick with studs whose base is at height `foot`.
fn brick(builder: &mut DistractorBuilder, studs: [i32; 2], foot: f64, appearance: AppearanceSpec) {
    let [x, y] = studs.map(|n| f64::from(n) * PITCH / 2.0);
    let half = [x - 0.0001, y - 0.0001, BRICK_HEIGHT / 2.0];
    builder.rounded_box(half, [0.0, 0.0, foot + BRICK_HEIGHT / 2.0], 0.0006, appearance);
    let [radius, height] = STUD;
    let top = foot + BRICK_HEIGHT + height / 2.0;
    builder.collider_box([x - PITCH / 2.0 + radius, y - PITCH / 2.0 + radius, height / 2.0], [0.0, 0.0, top]);
    let outline: Vec<_> = arc(radius, 0..=47).into_iter().step_by(3).collect();
    for i in 0..studs[0] {
        for j in 0..studs[1] {
            let at = [i, j].map(|k| (f64::from(k) + 0.5) * PITCH);
            builder.extrusion(
                &outline,
                &[],
                height / 2.0,
                pose([at[0] - x, at[1] - y, top], IDENTITY),
                appearance,
            );
        }
    }
}

/// Samples the wings and fuselage of a screwed-together toy aeroplane.
pub(crate) fn aeroplane(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(520.0);
    let [hull, wing, other] = vivid_colors(stream).map(glossy);
    let wing_z = 0.022;
    builder.visual_rounded_box([0.085, 0.0175, 0.018], [0.0, 0.0, 0.018], 0.011, hull);
    builder.collider_box([0.085, 0.0125, 0.018], [0.0, 0.0, 0.018]);
    let plan = rounded_rectangle([0.024, 0.095], 0.02);
    builder.extrusion(&plan, &[], 0.0035, pose([0.018, 0.0, wing_z], IDENTITY), wing);
    builder.collider_box([0.024, 0.094, 0.0035], [0.018, 0.0, wing_z]);
    let plan = rounded_rectangle([0.014, 0.04], 0.012);
    builder.extrusion(&plan, &[], 0.003, pose([-0.07, 0.0, 0.026], IDENTITY), wing);
    builder.collider_box([0.014, 0.038, 0.003], [-0.07, 0.0, 0.026]);
    let fin = [[-0.084, 0.03], [-0.084, 0.062], [-0.072, 0.062], [-0.052, 0.03]];
    builder.extrusion(&fin, &[], 0.003, pose([0.0; 3], Y_TO_Z), wing);
    builder.collider_box([0.014, 0.003, 0.0165], [-0.07, 0.0, 0.0455]);
    builder.visual_rounded_box(
        [0.02, 0.0125, 0.01],
        [0.022, 0.0, 0.035],
        0.0095,
        glossy(srgb([150, 196, 214])),
    );
    builder.collider_box([0.018, 0.01, 0.0085], [0.022, 0.0, 0.0365]);
    let nose = [[0.0, 0.0], [0.013, 0.0], [0.012, 0.008], [0.006, 0.014], [0.0, 0.015]];
    builder.lathe(&nose, pose([0.083, 0.0, 0.019], Z_TO_X), other);
    builder.collider_box([0.007, 0.008, 0.008], [0.091, 0.0, 0.019]);
    let blades = rounded_rectangle([0.0175, 0.003], 0.0029);
    builder.extrusion(&blades, &[], 0.001, pose([0.094, 0.0, 0.019], [1.0, -1.0, 1.0, 1.0]), glossy(BLACK));
    for y in [-0.06, 0.06] {
        let screw = Primitive::Cylinder { radius: 0.007, half_height: 0.001 };
        builder.visual(VisualShape::Primitive(screw), pose([0.018, y, wing_z + 0.0042], IDENTITY), other);
    }
    builder.build(stream)
}

/// Samples a scrambled 3 × 3 × 3 cube puzzle.
pub(crate) fn cube_puzzle(stream: &mut Stream) -> Distractor {
    let colors = [
        WHITE,
        srgb([236, 206, 30]),
        srgb([196, 26, 34]),
        srgb([240, 120, 26]),
        srgb([26, 130, 64]),
        srgb([30, 74, 176]),
    ];
    let mut builder = DistractorBuilder::new(480.0);
    let (half, cell) = (0.0285, 0.019);
    builder.rounded_box([half; 3], [0.0; 3], 0.002, glossy(BLACK));
    for (face, color) in FACES.into_iter().zip(colors) {
        let solved = stream.unit() < 0.25;
        for i in 0..9 {
            let [x, y] = [i % 3, i / 3].map(|k| cell * f64::from(k - 1));
            let color = if solved { color } else { pick(stream, &colors) };
            let sticker = VisualShape::Primitive(Primitive::Box { half: [0.0079, 0.0079, LABEL_THICKNESS] });
            let lifted = pose([0.0; 3], face) * pose([x, y, half], IDENTITY);
            builder.visual(sticker, lifted, glossy(color));
        }
    }
    builder.build(stream)
}

/// Samples a kitchen timer: a dial with tick marks and a knob.
pub(crate) fn timer(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(520.0);
    let ([main, other], face) = (vivid_colors(stream), pale(stream));
    builder.collider_cylinder(0.038, [0.0, 0.024]).collider_cylinder(0.0185, [0.024, 0.04]);
    let case = [[0.0, 0.0], [0.036, 0.0], [0.038, 0.002], [0.038, 0.017], [0.034, 0.023], [0.0, 0.023]];
    builder.lathe_about_z(&case, glossy(main)).visual_cylinder(0.0335, [0.02, 0.0236], matt(face));
    for (i, [x, y]) in arc(1.0, 0..=47).into_iter().step_by(4).enumerate() {
        let long = if i % 3 == 0 { 0.0045 } else { 0.0028 };
        let out = 0.0325 - long;
        let turn = if x < -0.99 { HALF_TURN_Z } else { [1.0 + x, 0.0, 0.0, y] };
        let tick = VisualShape::Primitive(Primitive::Box { half: [long, 0.0006, LABEL_THICKNESS] });
        builder.visual(tick, pose([out * x, out * y, 0.0236], turn), matt(BLACK));
    }
    let knob = [[0.0, 0.022], [0.0205, 0.022], [0.0185, 0.027], [0.0165, 0.031], [0.0, 0.031]];
    builder.lathe_about_z(&knob, glossy(other));
    builder.visual_rounded_box([0.0155, 0.004, 0.006], [0.0, 0.0, 0.034], 0.0025, glossy(other));
    builder.visual_box([0.005, 0.0008, 0.0002], [0.0105, 0.0, 0.04], matt(WHITE));
    builder.build(stream)
}

/// Samples a toy car with fixed wheels.
pub(crate) fn car(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(800.0);
    let [body, other] = vivid_colors(stream);
    let roof = if stream.unit() < 0.5 { body } else { other };
    let glass = glossy(srgb([40, 54, 66]));
    builder.visual_rounded_box([0.044, 0.0205, 0.0095], [0.0, 0.0, 0.0155], 0.005, glossy(body));
    builder.collider_box([0.044, 0.0205, 0.0105], [0.0, 0.0, 0.0145]);
    let cab = [[-0.03, 0.022], [-0.022, 0.038], [0.008, 0.038], [0.022, 0.022]];
    builder.extrusion(&cab, &[], 0.0165, pose([0.0; 3], Y_TO_Z), glass);
    builder.visual_rounded_box([0.0155, 0.0168, 0.0015], [-0.007, 0.0, 0.0378], 0.0012, glossy(roof));
    builder.visual_box([0.0015, 0.017, 0.0085], [-0.006, 0.0, 0.03], glossy(roof));
    builder.collider_box([0.021, 0.0165, 0.007], [-0.006, 0.0, 0.0315]);
    for x in [-0.026, 0.026] {
        builder.collider_box([0.006, 0.0225, 0.0095], [x, 0.0, 0.0095]);
        for y in [-0.019, 0.019] {
            let wheel =
                |radius, half_height| VisualShape::Primitive(Primitive::Cylinder { radius, half_height });
            builder.visual(wheel(0.0095, 0.0035), pose([x, y, 0.0095], Z_TO_Y), matt(BLACK));
            builder.visual(
                wheel(0.005, 0.0035 + LABEL_THICKNESS),
                pose([x, y, 0.0095], Z_TO_Y),
                glossy([0.75; 3]),
            );
        }
    }
    // Headlights and tail lights.
    let light = ellipse([0.003, 0.003]);
    for y in [-0.014, 0.014] {
        builder.extrusion(
            &light,
            &[],
            0.044 + LABEL_THICKNESS,
            pose([0.0, y, 0.017], Z_TO_X),
            glossy(srgb([250, 236, 170])),
        );
    }
    builder.build(stream)
}

/// Samples wooden rings on a peg, the largest at the bottom.
pub(crate) fn ring_tower(stream: &mut Stream) -> Distractor {
    let mut builder = DistractorBuilder::new(420.0);
    let timber = wood(stream);
    let colors: [_; 4] = vivid_colors(stream);
    builder.visual_cylinder(0.038, [0.0, 0.008], timber).visual_cylinder(0.0055, [0.008, 0.086], timber);
    builder.collider_cylinder(0.038, [0.0, 0.008]);
    for (i, color) in (0..).zip(colors) {
        let (r, low) = (0.034 - 0.0045 * f64::from(i), 0.008 + 0.016 * f64::from(i));
        let ring = [
            [0.006, low],
            [r - 0.005, low],
            [r - 0.001, low + 0.003],
            [r, low + 0.008],
            [r - 0.001, low + 0.013],
            [r - 0.005, low + 0.016],
            [0.006, low + 0.016],
            [0.006, low],
        ];
        builder.lathe_about_z(&ring, glossy(color)).collider_cylinder(r - 0.0005, [low, low + 0.016]);
    }
    let knob = Primitive::Ball { radius: 0.0075 };
    builder.visual(VisualShape::Primitive(knob), pose([0.0, 0.0, 0.085], IDENTITY), timber);
    builder.collider_cylinder(0.006, [0.072, 0.0925]);
    builder.build(stream)
}
