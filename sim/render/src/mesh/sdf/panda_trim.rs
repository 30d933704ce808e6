//! Dark panels of the Panda arm: the parts of the housings on which a function of the position is positive.
//! Measured on the benchmark's arm, without its lettering. Link frames, lengths in m.

use crate::math::affine::Vec3;

/// Returns a function that is positive on the panels of a link.
///
/// # Panics
/// If the link has no panels.
pub(crate) fn region(link: usize) -> impl Fn(Vec3) -> f32 {
    match link {
        3 => |[x, y, z]: Vec3| collar([x - 0.0825, z], y),
        4 => |[x, y, z]: Vec3| collar([x, y], z),
        5 => forearm,
        6 => wrist,
        7 => buttons,
        _ => panic!("link {link} of a Panda has no dark panels"),
    }
}

/// Band around the domed end of a drum, given the position across and along its axis.
fn collar(across: [f32; 2], along: f32) -> f32 {
    (along - 0.0645).min(length(across) - 0.034)
}

/// Strap along the outside of the forearm, around a white field with a notch.
fn forearm([x, y, z]: Vec3) -> f32 {
    let edge_y = if z > -0.052 { 0.066 + (0.0525 - z) * 0.297 } else { 0.097 + (z + 0.052) * 0.16 };
    let field = disc([x, z + 0.004], 0.032).min(capsule([x, z], -0.162, -0.03, 0.016));
    let notch = (x + 0.01).abs().max((z + 0.12).abs() - 0.02) - 0.01;
    let outline = disc([x, z], 0.053).min(capsule([x, z], -0.181, -0.04, 0.0315));
    (y - edge_y).min(field.max(-notch)).min(-outline)
}

/// Ring at the wrist, lid above it around a white field, and cap of joint 7.
fn wrist([x, y, z]: Vec3) -> f32 {
    let ring = (0.004 - z).min(0.052 - length([x, y]));
    let field = disc([x, y], 0.023).min(capsule([y, x], 0.0, 0.025, 0.022));
    let emblem = disc([x, y], 0.0165);
    let lid = (z - 0.0356 - 0.1165 * x).min(field.max(-emblem));
    let cap = (y - 0.06).min(0.037 - length([x - 0.088, z]));
    ring.max(lid).max(cap)
}

/// Buttons on both sides of the grip.
fn buttons([x, y, z]: Vec3) -> f32 {
    let (along, across) = ((x + y) * core::f32::consts::FRAC_1_SQRT_2, (x - y).abs());
    (0.0125 - (along - 0.066).abs()).min(0.013 - (z - 0.081).abs()).min(across - 0.03)
}

/// Signed distance to a disc about the origin.
fn disc(p: [f32; 2], radius: f32) -> f32 {
    length(p) - radius
}

/// Signed distance to the points within `radius` of the segment from `min` to `max` on the second axis.
fn capsule([u, v]: [f32; 2], min: f32, max: f32, radius: f32) -> f32 {
    disc([u, v - v.clamp(min, max)], radius)
}

fn length([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}
