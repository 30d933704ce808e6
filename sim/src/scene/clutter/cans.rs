//! Cans and a tube of crisps.

use core::f64::consts::SQRT_2;

use super::Thing;
use super::model::{AS_IS, HALF_TURN, LABEL, Model, pose};
use super::paint::{BLACK, GOLD, WHITE, gloss, matt, pale, patterned, pick, steel, vivids};
use crate::scene::{Texture, rounded_rectangle};
use crate::stream::Stream;

/// A can of soup.
pub(super) fn soup(stream: &mut Stream) -> Thing {
    tin(stream, 0.034, 0.101, 950.0)
}

/// A flat can of tuna.
pub(super) fn tuna(stream: &mut Stream) -> Thing {
    tin(stream, 0.0425, 0.033, 900.0)
}

/// A large can of coffee under a plastic lid.
pub(super) fn coffee(stream: &mut Stream) -> Thing {
    let (radius, height) = (0.05, 0.139);
    let mut model = Model::new(370.0);
    model.column(radius, [0.0, height]);
    model.drum(radius - 0.001, [0.0, height - 0.006], steel());
    label(&mut model, stream, radius - 0.0006, [0.006, height - 0.018]);
    let lid = [
        [0.0, height - 0.013],
        [radius, height - 0.013],
        [radius, height - 0.001],
        [radius - 0.001, height],
        [radius - 0.005, height],
        [radius - 0.006, height - 0.003],
        [0.0, height - 0.003],
    ];
    model.turned(&lid, gloss(pick(stream, &[WHITE, BLACK, GOLD])));
    model.made(stream)
}

/// A tube of crisps under a plastic lid.
pub(super) fn crisps(stream: &mut Stream) -> Thing {
    let (radius, height) = (0.0365, 0.228);
    let mut model = Model::new(210.0);
    model.column(radius + 0.001, [0.0, height]);
    model.drum(radius + 0.0005, [0.0, 0.004], steel());
    label(&mut model, stream, radius, [0.004, height - 0.006]);
    let lid = [
        [0.0, height - 0.009],
        [radius + 0.001, height - 0.009],
        [radius + 0.001, height],
        [radius - 0.003, height],
        [radius - 0.004, height - 0.002],
        [0.0, height - 0.002],
    ];
    model.turned(&lid, gloss(pale(stream)));
    model.made(stream)
}

/// A can of potted meat: a box with round edges.
pub(super) fn potted_meat(stream: &mut Stream) -> Thing {
    let ([x, y], height, round) = ([0.025, 0.048], 0.082, 0.012);
    let mut model = Model::new(950.0);
    // Two crossed boxes cut the edges where the round ones are met at 45°.
    model.crossed([x, y, height / 2.0], round * (2.0 - SQRT_2), [0.0, 0.0, height / 2.0]);
    let mut layer = |out: f64, [low, high]: [f64; 2], paint| {
        let middle = pose([0.0, 0.0, f64::midpoint(low, high)], AS_IS);
        let outline = rounded_rectangle([x + out, y + out], round + out);
        model.plate(&outline, &[], (high - low) / 2.0, middle, paint);
    };
    let [main, other] = vivids(stream);
    layer(-0.001, [0.001, height - 0.002], steel());
    layer(0.0, [0.0, 0.003], steel());
    layer(-0.0006, [0.006, height - 0.006], gloss(main));
    layer(-0.0003, [0.012, 0.026], gloss(other));
    layer(-0.0003, [0.058, 0.064], gloss(pale(stream)));
    let rim = rounded_rectangle([x, y], round);
    let inside = rounded_rectangle([x - 0.0025, y - 0.0025], round - 0.0025);
    model.plate(&rim, &[&inside], 0.0015, pose([0.0, 0.0, height - 0.0015], AS_IS), steel());
    pull_ring(&mut model, height - 0.0014);
    for x in [x, -x] {
        model.rounded([LABEL, 0.03, 0.012], [x, 0.0, 0.042], LABEL, matt(WHITE));
        model.rounded([2.0 * LABEL, 0.022, 0.004], [x, 0.0, 0.045], LABEL, matt(other));
    }
    model.made(stream)
}

/// A round can with a paper label between its rims, and a ring to open it.
fn tin(stream: &mut Stream, radius: f64, height: f64, density: f64) -> Thing {
    let mut model = Model::new(density);
    model.column(radius, [0.0, height]);
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
    model.turned(&metal, steel());
    label(&mut model, stream, waist + LABEL, [0.0045, height - 0.0045]);
    pull_ring(&mut model, height - 0.0025);
    model.made(stream)
}

fn pull_ring(model: &mut Model, z: f64) {
    let ring = rounded_rectangle([0.012, 0.0065], 0.006);
    let hole: Vec<_> =
        rounded_rectangle([0.005, 0.0042], 0.004).iter().map(|[x, y]| [x - 0.005, *y]).collect();
    model.plate(&ring, &[&hole], 0.0005, pose([0.006, 0.0, z + 0.0005], AS_IS), steel());
}

/// A printed label around a drum between two heights, in one of some designs.
pub(super) fn label(model: &mut Model, stream: &mut Stream, radius: f64, [low, high]: [f64; 2]) {
    let at = |share: f64| low + (high - low) * share;
    let [main, other] = vivids(stream);
    let light = pale(stream);
    let mut band = |layer: u32, from: f64, to: f64, paint| {
        model.drum(radius + LABEL * f64::from(layer), [at(from), at(to)], paint);
    };
    match pick(stream, &[0, 1, 2, 3]) {
        // Two halves.
        0 => {
            band(0, 0.0, 0.52, gloss(light));
            band(0, 0.52, 1.0, gloss(main));
            band(1, 0.5, 0.54, gloss(GOLD));
            both_sides(model, radius, 3, [at(0.4), at(0.64)], GOLD);
            writing(model, radius, 4, [at(0.72), at(0.86)], light);
            writing(model, radius, 4, [at(0.14), at(0.26)], main);
        }
        // A belt between stripes.
        1 => {
            band(0, 0.0, 1.0, gloss(main));
            band(1, 0.3, 0.7, gloss(light));
            band(1, 0.08, 0.14, gloss(other));
            band(1, 0.86, 0.92, gloss(other));
            writing(model, radius, 5, [at(0.5), at(0.62)], main);
            writing(model, radius, 3, [at(0.37), at(0.43)], other);
        }
        // A window with writing in it.
        2 => {
            band(0, 0.0, 1.0, gloss(main));
            both_sides(model, radius, 6, [at(0.12), at(0.88)], light);
            writing(model, radius, 5, [at(0.66), at(0.8)], other);
            writing(model, radius, 4, [at(0.52), at(0.58)], BLACK);
            writing(model, radius, 3, [at(0.2), at(0.44)], main);
        }
        // A pattern above a plain foot.
        _ => {
            let texture =
                pick(stream, &[Texture::Waves, Texture::PolkaDots, Texture::Gingham, Texture::Stripes]);
            band(0, 0.0, 0.3, gloss(other));
            band(0, 0.3, 1.0, patterned(texture, light));
            both_sides(model, radius, 5, [at(0.42), at(0.84)], main);
            writing(model, radius, 4, [at(0.64), at(0.76)], light);
            writing(model, radius, 3, [at(0.5), at(0.56)], light);
            writing(model, radius, 5, [at(0.1), at(0.2)], light);
        }
    }
}

/// A sheet on the front and on the back of a drum.
pub(super) fn both_sides(
    model: &mut Model,
    radius: f64,
    half_steps: i32,
    between: [f64; 2],
    color: [f64; 3],
) {
    for turn in [AS_IS, HALF_TURN] {
        model.sheet((radius, 2), half_steps, between, turn, gloss(color));
    }
}

/// What stands for writing from afar: a bar above what else is printed on the front and on the back.
fn writing(model: &mut Model, radius: f64, half_steps: i32, between: [f64; 2], color: [f64; 3]) {
    for turn in [AS_IS, HALF_TURN] {
        model.sheet((radius, 3), half_steps, between, turn, matt(color));
    }
}
