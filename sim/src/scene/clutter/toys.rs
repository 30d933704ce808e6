//! Toys and small things from a drawer.

use super::Thing;
use super::model::{ALONG_X, ALONG_Y, AS_IS, HALF_TURN, LABEL, Model, Turn, UPRIGHT, arc, ellipse, pose};
use super::paint::{BLACK, WHITE, gloss, matt, pale, pick, rgb, shade, vivid, vivids, wood};
use crate::scene::{Form, PaintSpec, Primitive, rounded_rectangle};
use crate::stream::Stream;

/// What takes the z axis to the faces of a cube that can be seen: above first, then around it.
const FACES: [Turn; 5] = [AS_IS, ALONG_X, ALONG_Y, [1.0, 0.0, -1.0, 0.0], UPRIGHT];

/// A brick of foam.
pub(super) fn foam_brick(stream: &mut Stream) -> Thing {
    let mut model = Model::new(150.0);
    let color =
        pick(stream, &[rgb([196, 44, 40]), rgb([40, 90, 170]), rgb([234, 190, 60]), rgb([90, 150, 70])]);
    let half = [0.039, 0.026, 0.0255];
    let foam = matt(shade(stream, color));
    model.friction(0.7).piece(half, [0.0; 3], 0.002, foam);
    let hollow = matt(color.map(|channel| 0.35 * channel));
    for x in [-0.022, 0.0, 0.022] {
        let hole = Primitive::Cylinder { radius: 0.0065, half_height: LABEL };
        model.form(Form::Primitive(hole), pose([x, 0.0, half[2]], AS_IS), hollow);
    }
    model.made(stream)
}

/// A die.
pub(super) fn die(stream: &mut Stream) -> Thing {
    let mut model = Model::new(1700.0);
    let [main, _] = vivids(stream);
    let (body, pips) = pick(stream, &[(WHITE, BLACK), (main, WHITE), (BLACK, WHITE)]);
    let half = 0.0125;
    model.piece([half; 3], [0.0; 3], 0.0022, gloss(body));
    let step = 0.0055;
    let corners = [[-step, -step], [step, step], [-step, step], [step, -step], [-step, 0.0], [step, 0.0]];
    // On top five, to the sides two, three, four and six; the one lies on the table.
    for (face, count) in FACES.into_iter().zip([5, 2, 3, 4, 6]) {
        let odd = (count % 2 == 1).then_some([0.0, 0.0]);
        for [x, y] in corners.into_iter().take(count / 2 * 2).chain(odd) {
            let dot: Vec<_> =
                arc(0.0021, 0..=47).into_iter().step_by(4).map(|[u, v]| [u + x, v + y]).collect();
            let lifted = pose([0.0; 3], face) * pose([0.0, 0.0, half], AS_IS);
            model.plate(&dot, &[], LABEL, lifted, gloss(pips));
        }
    }
    model.made(stream)
}

/// Pitch of the studs and height of a toy brick, and radius and height of a stud, in m.
const PITCH: f64 = 0.016;
const BRICK: f64 = 0.0192;
const STUD: [f64; 2] = [0.0047, 0.0045];

/// A toy brick with two by two studs.
pub(super) fn small_brick(stream: &mut Stream) -> Thing {
    let mut model = Model::new(1300.0);
    let color = vivid(stream);
    brick(&mut model, [2, 2], 0.0, gloss(color));
    model.made(stream)
}

/// A toy brick with two by three, four or six studs.
pub(super) fn long_brick(stream: &mut Stream) -> Thing {
    let mut model = Model::new(950.0);
    let (length, color) = (pick(stream, &[3, 4, 6]), vivid(stream));
    brick(&mut model, [length, 2], 0.0, gloss(color));
    model.made(stream)
}

/// A few toy bricks on one another.
pub(super) fn brick_tower(stream: &mut Stream) -> Thing {
    let mut model = Model::new(700.0);
    let colors: [_; 3] = vivids(stream);
    let sizes = pick(stream, &[[[4, 2], [2, 2], [2, 2]], [[4, 2], [4, 2], [2, 2]], [[2, 2], [2, 2], [2, 2]]]);
    for (level, (color, size)) in (0..).zip(colors.into_iter().zip(sizes)) {
        brick(&mut model, size, f64::from(level) * BRICK, gloss(color));
    }
    model.made(stream)
}

/// A brick with studs on it, whose foot is at a height.
fn brick(model: &mut Model, studs: [i32; 2], foot: f64, paint: PaintSpec) {
    let [x, y] = studs.map(|n| f64::from(n) * PITCH / 2.0);
    let half = [x - 0.0001, y - 0.0001, BRICK / 2.0];
    model.piece(half, [0.0, 0.0, foot + BRICK / 2.0], 0.0006, paint);
    let [radius, height] = STUD;
    let top = foot + BRICK + height / 2.0;
    model.block([x - PITCH / 2.0 + radius, y - PITCH / 2.0 + radius, height / 2.0], [0.0, 0.0, top]);
    let outline: Vec<_> = arc(radius, 0..=47).into_iter().step_by(3).collect();
    for i in 0..studs[0] {
        for j in 0..studs[1] {
            let at = [i, j].map(|k| (f64::from(k) + 0.5) * PITCH);
            model.plate(&outline, &[], height / 2.0, pose([at[0] - x, at[1] - y, top], AS_IS), paint);
        }
    }
}

/// The wings and the hull of a toy aeroplane that is screwed together.
pub(super) fn aeroplane(stream: &mut Stream) -> Thing {
    let mut model = Model::new(520.0);
    let [hull, wing, other] = vivids(stream).map(gloss);
    let wing_z = 0.022;
    model.rounded([0.085, 0.0175, 0.018], [0.0, 0.0, 0.018], 0.011, hull);
    model.block([0.085, 0.0125, 0.018], [0.0, 0.0, 0.018]);
    let plan = rounded_rectangle([0.024, 0.095], 0.02);
    model.plate(&plan, &[], 0.0035, pose([0.018, 0.0, wing_z], AS_IS), wing);
    model.block([0.024, 0.094, 0.0035], [0.018, 0.0, wing_z]);
    let plan = rounded_rectangle([0.014, 0.04], 0.012);
    model.plate(&plan, &[], 0.003, pose([-0.07, 0.0, 0.026], AS_IS), wing);
    model.block([0.014, 0.038, 0.003], [-0.07, 0.0, 0.026]);
    let fin = [[-0.084, 0.03], [-0.084, 0.062], [-0.072, 0.062], [-0.052, 0.03]];
    model.plate(&fin, &[], 0.003, pose([0.0; 3], UPRIGHT), wing);
    model.block([0.014, 0.003, 0.0165], [-0.07, 0.0, 0.0455]);
    model.rounded([0.02, 0.0125, 0.01], [0.022, 0.0, 0.035], 0.0095, gloss(rgb([150, 196, 214])));
    model.block([0.018, 0.01, 0.0085], [0.022, 0.0, 0.0365]);
    let nose = [[0.0, 0.0], [0.013, 0.0], [0.012, 0.008], [0.006, 0.014], [0.0, 0.015]];
    model.lathe(&nose, pose([0.083, 0.0, 0.019], ALONG_X), other);
    model.block([0.007, 0.008, 0.008], [0.091, 0.0, 0.019]);
    let blades = rounded_rectangle([0.0175, 0.003], 0.0029);
    model.plate(&blades, &[], 0.001, pose([0.094, 0.0, 0.019], [1.0, -1.0, 1.0, 1.0]), gloss(BLACK));
    for y in [-0.06, 0.06] {
        let screw = Primitive::Cylinder { radius: 0.007, half_height: 0.001 };
        model.form(Form::Primitive(screw), pose([0.018, y, wing_z + 0.0042], AS_IS), other);
    }
    model.made(stream)
}

/// A puzzle of three by three by three small cubes, scrambled.
pub(super) fn cube_puzzle(stream: &mut Stream) -> Thing {
    let colors = [
        WHITE,
        rgb([236, 206, 30]),
        rgb([196, 26, 34]),
        rgb([240, 120, 26]),
        rgb([26, 130, 64]),
        rgb([30, 74, 176]),
    ];
    let mut model = Model::new(480.0);
    let (half, cell) = (0.0285, 0.019);
    model.piece([half; 3], [0.0; 3], 0.002, gloss(BLACK));
    for (face, color) in FACES.into_iter().zip(colors) {
        let solved = stream.unit() < 0.25;
        for i in 0..9 {
            let [x, y] = [i % 3, i / 3].map(|k| cell * f64::from(k - 1));
            let color = if solved { color } else { pick(stream, &colors) };
            let sticker = Form::Primitive(Primitive::Box { half: [0.0079, 0.0079, LABEL] });
            let lifted = pose([0.0; 3], face) * pose([x, y, half], AS_IS);
            model.form(sticker, lifted, gloss(color));
        }
    }
    model.made(stream)
}

/// A kitchen timer: a dial with ticks around it and a knob.
pub(super) fn timer(stream: &mut Stream) -> Thing {
    let mut model = Model::new(520.0);
    let ([main, other], face) = (vivids(stream), pale(stream));
    model.column(0.038, [0.0, 0.024]).column(0.0185, [0.024, 0.04]);
    let case = [[0.0, 0.0], [0.036, 0.0], [0.038, 0.002], [0.038, 0.017], [0.034, 0.023], [0.0, 0.023]];
    model.turned(&case, gloss(main)).drum(0.0335, [0.02, 0.0236], matt(face));
    for (i, [x, y]) in arc(1.0, 0..=47).into_iter().step_by(4).enumerate() {
        let long = if i % 3 == 0 { 0.0045 } else { 0.0028 };
        let out = 0.0325 - long;
        let turn = if x < -0.99 { HALF_TURN } else { [1.0 + x, 0.0, 0.0, y] };
        let tick = Form::Primitive(Primitive::Box { half: [long, 0.0006, LABEL] });
        model.form(tick, pose([out * x, out * y, 0.0236], turn), matt(BLACK));
    }
    let knob = [[0.0, 0.022], [0.0205, 0.022], [0.0185, 0.027], [0.0165, 0.031], [0.0, 0.031]];
    model.turned(&knob, gloss(other));
    model.rounded([0.0155, 0.004, 0.006], [0.0, 0.0, 0.034], 0.0025, gloss(other));
    model.slab([0.005, 0.0008, 0.0002], [0.0105, 0.0, 0.04], matt(WHITE));
    model.made(stream)
}

/// A toy car; its wheels do not turn.
pub(super) fn car(stream: &mut Stream) -> Thing {
    let mut model = Model::new(800.0);
    let [body, other] = vivids(stream);
    let roof = if stream.unit() < 0.5 { body } else { other };
    let glass = gloss(rgb([40, 54, 66]));
    model.rounded([0.044, 0.0205, 0.0095], [0.0, 0.0, 0.0155], 0.005, gloss(body));
    model.block([0.044, 0.0205, 0.0105], [0.0, 0.0, 0.0145]);
    let cab = [[-0.03, 0.022], [-0.022, 0.038], [0.008, 0.038], [0.022, 0.022]];
    model.plate(&cab, &[], 0.0165, pose([0.0; 3], UPRIGHT), glass);
    model.rounded([0.0155, 0.0168, 0.0015], [-0.007, 0.0, 0.0378], 0.0012, gloss(roof));
    model.slab([0.0015, 0.017, 0.0085], [-0.006, 0.0, 0.03], gloss(roof));
    model.block([0.021, 0.0165, 0.007], [-0.006, 0.0, 0.0315]);
    for x in [-0.026, 0.026] {
        model.block([0.006, 0.0225, 0.0095], [x, 0.0, 0.0095]);
        for y in [-0.019, 0.019] {
            let wheel = |radius, half_height| Form::Primitive(Primitive::Cylinder { radius, half_height });
            model.form(wheel(0.0095, 0.0035), pose([x, y, 0.0095], ALONG_Y), matt(BLACK));
            model.form(wheel(0.005, 0.0035 + LABEL), pose([x, y, 0.0095], ALONG_Y), gloss([0.75; 3]));
        }
    }
    // Lamps ahead and behind.
    let lamp = ellipse([0.003, 0.003]);
    for y in [-0.014, 0.014] {
        model.plate(&lamp, &[], 0.044 + LABEL, pose([0.0, y, 0.017], ALONG_X), gloss(rgb([250, 236, 170])));
    }
    model.made(stream)
}

/// Wooden rings on a peg, the largest below.
pub(super) fn ring_tower(stream: &mut Stream) -> Thing {
    let mut model = Model::new(420.0);
    let timber = wood(stream);
    let colors: [_; 4] = vivids(stream);
    model.drum(0.038, [0.0, 0.008], timber).drum(0.0055, [0.008, 0.086], timber);
    model.column(0.038, [0.0, 0.008]);
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
        model.turned(&ring, gloss(color)).column(r - 0.0005, [low, low + 0.016]);
    }
    let knob = Primitive::Ball { radius: 0.0075 };
    model.form(Form::Primitive(knob), pose([0.0, 0.0, 0.085], AS_IS), timber);
    model.column(0.006, [0.072, 0.0925]);
    model.made(stream)
}
