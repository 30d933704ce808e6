//! Fruit. Round ones stand on a small flat foot, as real ones do, and roll when they are pushed off it.

use super::Thing;
use super::model::{ALONG_X, AS_IS, Model, arc, pose};
use super::paint::{PEEL, matt, patterned, pick, rgb, shade};
use crate::scene::{Form, PaintSpec, Primitive, Texture};
use crate::stream::Stream;

/// An apple's distance from its axis and height, in radii, from the dimple below to that above.
pub(crate) const APPLE: [[f64; 2]; 12] = [
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

/// An apple with its stalk.
pub(super) fn apple(stream: &mut Stream) -> Thing {
    let skin = pick(stream, &[rgb([186, 28, 32]), rgb([138, 178, 56]), rgb([222, 180, 60])]);
    let skin = peel(shade(stream, skin));
    let radius = 0.0375;
    let mut model = standing(radius);
    model.turned(&APPLE.map(|point| point.map(|x| x * radius)), skin);
    stalk(&mut model, [0.0, 0.0, 0.86 * radius], 0.005);
    model.made(stream)
}

/// A pear that stands.
pub(super) fn pear(stream: &mut Stream) -> Thing {
    let skin = pick(stream, &[rgb([170, 182, 60]), rgb([206, 178, 70]), rgb([150, 110, 50])]);
    let skin = peel(shade(stream, skin));
    let radius = 0.033;
    let mut model = standing(radius);
    let ball = |radius| Primitive::Ball { radius };
    model.solid(ball(0.025), pose([0.0, 0.0, 0.022], AS_IS));
    model.solid(ball(0.0165), pose([0.0, 0.0, 0.045], AS_IS));
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
    model.turned(&profile, skin);
    stalk(&mut model, [0.0, 0.0, 0.0585], 0.003);
    model.made(stream)
}

/// An orange, its pores just to be seen.
pub(super) fn orange(stream: &mut Stream) -> Thing {
    let radius = 0.0365;
    let mut model = standing(radius);
    let color = shade(stream, rgb([246, 140, 24]));
    let ball = Form::Primitive(Primitive::Ball { radius });
    model.form(ball, pose([0.0; 3], AS_IS), patterned(Texture::Plaster, color));
    navel(&mut model, radius);
    model.made(stream)
}

/// A peach: two halves with a seam.
pub(super) fn peach(stream: &mut Stream) -> Thing {
    let mut model = standing(0.0335);
    let color = pick(stream, &[rgb([242, 158, 92]), rgb([226, 104, 72]), rgb([246, 196, 116])]);
    let color = shade(stream, color);
    // The sun has been on one half more than on the other.
    let [red, green, blue] = color;
    halves(&mut model, 0.0335, [matt(color), matt([0.95 * red, 0.76 * green, 0.74 * blue])]);
    navel(&mut model, 0.0335);
    model.made(stream)
}

/// A dark plum: two halves with a seam.
pub(super) fn plum(stream: &mut Stream) -> Thing {
    let mut model = standing(0.026);
    let color = pick(stream, &[rgb([88, 28, 66]), rgb([54, 30, 84]), rgb([128, 30, 50])]);
    halves(&mut model, 0.026, [peel(shade(stream, color)); 2]);
    stalk(&mut model, [0.0, 0.0, 0.025], 0.002);
    model.made(stream)
}

/// A lemon that lies.
pub(super) fn lemon(stream: &mut Stream) -> Thing {
    let skin = pick(stream, &[rgb([240, 208, 40]), rgb([128, 176, 52])]);
    let skin = patterned(Texture::Plaster, shade(stream, skin));
    let radius = 0.027;
    let mut model = Model::new(900.0);
    let ball = |radius| Primitive::Ball { radius };
    model.solid(Primitive::Capsule { radius: 0.025, half_height: 0.004 }, pose([0.0; 3], ALONG_X));
    model
        .solid(ball(0.01), pose([0.024, 0.0, 0.0], AS_IS))
        .solid(ball(0.01), pose([-0.024, 0.0, 0.0], AS_IS));
    // It rests on a flat place, as one does that grew unevenly.
    model.block([0.009, 0.005, radius], [0.0; 3]).rolling();
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
    model.lathe(&profile, pose([0.0; 3], ALONG_X), skin);
    model.made(stream)
}

/// A strawberry that lies, its leaves towards −x.
pub(super) fn strawberry(stream: &mut Stream) -> Thing {
    let radius = 0.0185;
    let mut model = Model::new(900.0);
    let ball = |radius| Primitive::Ball { radius };
    model.solid(ball(0.0175), pose([-0.005, 0.0, 0.0], AS_IS));
    model.solid(ball(0.0085), pose([0.0165, 0.0, 0.0], AS_IS));
    model.block([0.009, 0.005, radius], [-0.003, 0.0, 0.0]).rolling();
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
    let along = pose([0.0; 3], ALONG_X);
    model.lathe(&profile, along, peel(shade(stream, rgb([206, 24, 34]))));
    for (ring, [radius, x]) in (0..).zip([[0.0184, -0.008], [0.0174, 0.002], [0.0138, 0.012]]) {
        for [y, z] in arc(radius, 0..=47).into_iter().skip(4 * (ring % 2)).step_by(8) {
            // A seed at the very bottom would lift it.
            if z > -0.9 * radius {
                let half = [0.0009, 0.0005, 0.0005];
                model.rounded(half, [x, y, z], 0.0004, peel(rgb([232, 196, 96])));
            }
        }
    }
    let star: Vec<_> = arc(1.0, 0..=47)
        .chunks(4)
        .enumerate()
        .map(|(i, point)| point[0].map(|x| x * if i % 2 == 0 { 0.0155 } else { 0.006 }))
        .collect();
    let leaf = peel(rgb([64, 126, 44]));
    model.plate(&star, &[], 0.001, pose([-0.0195, 0.0, 0.0], ALONG_X), leaf);
    let stem = Form::Primitive(Primitive::Capsule { radius: 0.0012, half_height: 0.002 });
    model.form(stem, pose([-0.0215, 0.0, 0.0], ALONG_X), leaf);
    model.made(stream)
}

/// A round fruit around the origin as it collides.
fn standing(radius: f64) -> Model {
    let mut model = Model::new(850.0);
    model.solid(Primitive::Ball { radius }, pose([0.0; 3], AS_IS)).rolling();
    model.column(0.25 * radius, [-radius, -0.7 * radius]);
    model
}

/// Two balls that are nearly one.
fn halves(model: &mut Model, radius: f64, paints: [PaintSpec; 2]) {
    let off = 0.08 * radius;
    let half = Form::Primitive(Primitive::Ball { radius: radius - off });
    for (y, paint) in [off, -off].into_iter().zip(paints) {
        model.form(half.clone(), pose([0.0, y, 0.0], AS_IS), paint);
    }
}

fn stalk(model: &mut Model, middle: [f64; 3], half_height: f64) {
    let stalk = Primitive::Capsule { radius: 0.0018, half_height };
    model.form(Form::Primitive(stalk), pose(middle, AS_IS), peel(rgb([84, 58, 34])));
}

/// Where the stalk has been.
fn navel(model: &mut Model, radius: f64) {
    let scar = Primitive::Cylinder { radius: 0.0032, half_height: 0.0006 };
    model.form(Form::Primitive(scar), pose([0.0, 0.0, radius], AS_IS), peel(rgb([92, 100, 48])));
}

fn peel(color: [f64; 3]) -> PaintSpec {
    PaintSpec { specular: PEEL, ..PaintSpec::plain(color) }
}
