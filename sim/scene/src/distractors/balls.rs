//! Sports balls. The visuals stay within the single sphere that collides.

use nalgebra::Vector3;

use super::Distractor;
use super::appearance::{BLACK, WHITE, glossy, matt, pick, srgb, vary_brightness, vivid, vivid_colors};
use super::builder::{COS_SIN_STEP, DistractorBuilder, IDENTITY, arc, pose, z_axis_to};
use crate::stream::Stream;
use crate::{AppearanceSpec, Primitive, VisualShape};

/// Height of surface details above a ball's base surface, in m.
const RELIEF: f64 = 0.0004;

/// Samples a small football with dark patches.
pub(crate) fn football(stream: &mut Stream) -> Distractor {
    // Coordinates of the icosahedron's vertices: (1, φ) / √(1 + φ²) with the golden ratio φ.
    const SHORT: f64 = 0.525_731_112_119_133_6;
    const LONG: f64 = 0.850_650_808_352_039_9;
    let radius = 0.066;
    let light = pick(stream, &[WHITE, WHITE, srgb([240, 220, 90])]);
    let mut builder = ball(radius, 105.0, glossy(light));
    let patch = glossy(if stream.unit() < 0.5 { BLACK } else { vivid(stream) });
    for [a, b] in [[SHORT, LONG], [-SHORT, LONG], [SHORT, -LONG], [-SHORT, -LONG]] {
        for towards in [[0.0, a, b], [a, b, 0.0], [b, 0.0, a]] {
            cap(&mut builder, radius, towards, patch);
        }
    }
    builder.build(stream)
}

/// Samples a baseball with red stitches.
pub(crate) fn baseball(stream: &mut Stream) -> Distractor {
    let radius = 0.0367;
    let mut builder = ball(radius, 690.0, matt(vary_brightness(stream, srgb([236, 230, 216]))));
    seam(&mut builder, radius, [0.0009, 0.0026], matt(srgb([176, 26, 30])));
    builder.build(stream)
}

/// Samples a tennis ball with its seam.
pub(crate) fn tennis_ball(stream: &mut Stream) -> Distractor {
    let radius = 0.033;
    let felt = pick(stream, &[srgb([204, 226, 50]), srgb([204, 226, 50]), srgb([232, 120, 50])]);
    let mut builder = ball(radius, 385.0, matt(vary_brightness(stream, felt)));
    seam(&mut builder, radius, [0.0031, 0.0011], matt(WHITE));
    builder.build(stream)
}

/// Samples a golf ball.
pub(crate) fn golf_ball(stream: &mut Stream) -> Distractor {
    let radius = 0.0214;
    let color = pick(stream, &[WHITE, WHITE, srgb([236, 240, 80]), srgb([250, 150, 60])]);
    let mut builder = ball(radius, 1120.0, glossy(color));
    builder.friction(0.4);
    // Some of the dimples, as darker spots, and one coloured mark.
    let dimple = glossy(color.map(|channel| 0.88 * channel));
    for (i, height) in [-0.7, -0.42, -0.14, 0.14, 0.42, 0.7_f64].into_iter().enumerate() {
        let around = (1.0 - height * height).sqrt();
        for [x, y] in arc(around, 0..=47).into_iter().skip(3 * (i % 2)).step_by(6) {
            spot(&mut builder, radius, [x, y, height], 0.0014, dimple);
        }
    }
    cap(&mut builder, radius, [0.0, 0.0, 1.0], glossy(vivid(stream)));
    builder.build(stream)
}

/// Samples a rubber racquetball made of two halves with a seam between them.
pub(crate) fn racquetball(stream: &mut Stream) -> Distractor {
    let radius = 0.0285;
    let [main, other] = vivid_colors(stream);
    let mut builder = ball(radius, 400.0, glossy(main));
    let belt = [
        [0.8 * radius, -0.0008],
        [radius, -0.0008],
        [radius, 0.0008],
        [0.8 * radius, 0.0008],
        [0.8 * radius, -0.0008],
    ];
    let tilted = pose([0.0; 3], [1.0, 0.35, 0.2, 0.0]);
    builder.lathe(&belt, tilted, glossy(main.map(|channel| 0.6 * channel)));
    cap(&mut builder, radius, [0.6, 0.0, 0.8], glossy(other));
    builder.build(stream)
}

/// Starts a plain ball whose visual is smaller than its collision shape by `RELIEF`, to make room for
/// details.
fn ball(radius: f64, density: f64, appearance: AppearanceSpec) -> DistractorBuilder {
    let mut builder = DistractorBuilder::new(density);
    let (solid, seen) = (Primitive::Ball { radius }, Primitive::Ball { radius: radius - RELIEF });
    builder.collider(solid, pose([0.0; 3], IDENTITY)).rolling_resistance();
    builder.visual(VisualShape::Primitive(seen), pose([0.0; 3], IDENTITY), appearance);
    builder
}

/// Adds a round patch with the curvature of the ball, spanning 15° to each side of `towards`.
fn cap(builder: &mut DistractorBuilder, radius: f64, towards: [f64; 3], appearance: AppearanceSpec) {
    // Points on the unit sphere at 15°, 10°, 5° and 0° from the patch centre; the first two are hidden inside
    // the ball.
    let profile = [
        [0.0, 0.93],
        [0.2588, 0.9659 - 0.006],
        [0.2588, 0.9659],
        [0.1736, 0.9848],
        [0.0872, 0.9962],
        [0.0, 1.0],
    ];
    builder.lathe(
        &profile.map(|point| point.map(|x| x * radius)),
        pose([0.0; 3], z_axis_to(towards)),
        appearance,
    );
}

/// Adds a small flat disc of radius `size` at the unit vector `towards`.
fn spot(
    builder: &mut DistractorBuilder,
    radius: f64,
    towards: [f64; 3],
    size: f64,
    appearance: AppearanceSpec,
) {
    let outline: Vec<_> = arc(size, 0..=47).into_iter().step_by(6).collect();
    let at = towards.map(|x| x * (radius - RELIEF));
    builder.extrusion(&outline, &[], 0.0002, pose(at, z_axis_to(towards)), appearance);
}

/// Adds short strips along the seam of a ball sewn from two halves; `along` and `across` are their
/// half-extents.
fn seam(builder: &mut DistractorBuilder, radius: f64, [along, across]: [f64; 2], appearance: AppearanceSpec) {
    // Seam curve on the sphere of radius a + b:
    // x = a cos t + b cos 3t, y = a sin t − b sin 3t, z = 2 √(a b) sin 2t.
    const A: f64 = 0.72;
    const B: f64 = 0.28;
    let seam_point = |[cos, sin]: [f64; 2]| {
        let (cos3, sin3) = (cos * (4.0 * cos * cos - 3.0), sin * (3.0 - 4.0 * sin * sin));
        [A * cos + B * cos3, A * sin - B * sin3, 2.0 * (A * B).sqrt() * 2.0 * sin * cos]
    };
    for at in arc(1.0, 0..=47) {
        let next = seam_point([
            COS_SIN_STEP[0] * at[0] - COS_SIN_STEP[1] * at[1],
            COS_SIN_STEP[0] * at[1] + COS_SIN_STEP[1] * at[0],
        ]);
        let up = Vector3::from(seam_point(at));
        let outwards = pose((up * (radius - RELIEF)).into(), z_axis_to(up.into()));
        let onwards = outwards.inverse_transform_vector(&(Vector3::from(next) - up));
        // The strip is symmetric, so its direction may be flipped towards +x, where the half-angle quaternion
        // below is well defined.
        let [x, y] = [onwards.x.abs(), onwards.y * onwards.x.signum()];
        let turn = [x + (x * x + y * y).sqrt(), 0.0, 0.0, y];
        let strip = VisualShape::Primitive(Primitive::Box { half: [along, across, RELIEF] });
        builder.visual(strip, outwards * pose([0.0; 3], turn), appearance);
    }
}
