//! Metal sheets.

use crate::math::trig::on_circle;
use crate::texture::colour::{TextureFn, hex, mix, ramp, shade};
use crate::texture::noise::{Fbm, Noise, Warp};
use crate::texture::shaping::{fract, length, smooth_step, smooth_wave};
use crate::texture::voronoi::VoronoiCells;

/// Fine streaks along u.
pub(crate) fn brushed() -> TextureFn {
    let (fine, broad) = (Noise::new(6, [8, 128]), Noise::new(7, [3, 64]));
    Box::new(move |u, v| {
        let tone = 0.80 + 0.22 * (fine.at(u, v) - 0.5) + 0.16 * (broad.at(u, v) - 0.5);
        [tone, tone, tone * 1.01]
    })
}

/// Tread plate: raised lozenges, rotated by 90° from row to row.
pub(crate) fn diamond_plate() -> TextureFn {
    let (places, scratches) = (VoronoiCells::new(900, [6, 6], 0.0), Fbm::new(904, [12, 40], 3, 0.6));
    let [steel, bright, dark] = hex([0x8E9499, 0xE4E8EA, 0x3B4045]);
    Box::new(move |u, v| {
        let place = places.at(u, v);
        let [x, y] = place.offset;
        let (along, across) = if place.id[1] & 1 == 0 { (x + y, x - y) } else { (x - y, x + y) };
        // A pointed oval: the width shrinks with the square of the distance from the centre.
        let (along, across) = (along / 0.125, across / 0.034);
        let inside = 1.0 - along * along - across.abs();
        let ground = shade(steel, 0.75 + 0.5 * scratches.at(u, v));
        let side = if across < 0.0 { bright } else { dark };
        let bump = mix(side, bright, 0.35 * smooth_step(0.2, 0.8, inside));
        mix(ground, bump, smooth_step(0.0, 0.12, inside))
    })
}

/// Rust with patches of bare steel.
pub(crate) fn rust() -> TextureFn {
    let (warp, patches, pits) =
        (Warp::new(910, 4, 2, 0.2), Fbm::new(950, [5, 5], 4, 0.7), Fbm::new(956, [32, 32], 2, 0.6));
    let palette = hex([0x2E1A14, 0x6B2F16, 0xA34A1A, 0xC9702B, 0x8A7F78, 0x7D8085]);
    Box::new(move |u, v| {
        let (x, y) = warp.at(u, v);
        ramp(&palette, 2.3 * patches.at(x, y) - 0.72 + 0.5 * (pits.at(u, v) - 0.5))
    })
}

/// Zinc spangle: large crystals, each with its own direction of streaks.
pub(crate) fn galvanised() -> TextureFn {
    let crystals = VoronoiCells::new(960, [9, 10], 0.95);
    let [light, dark] = hex([0xC3CCD1, 0x7F8A92]);
    Box::new(move |u, v| {
        let crystal = crystals.at(u, v);
        let (x, y) = on_circle((crystal.random * 16.0) as usize, 16);
        let streak = smooth_wave(24.0 * (x * crystal.offset[0] + y * crystal.offset[1]));
        let tone = fract(5.0 * crystal.random);
        mix(dark, light, 0.7 * tone + 0.3 * streak)
    })
}

/// A sheet with round holes over black.
pub(crate) fn perforated() -> TextureFn {
    let (holes, streaks) = (VoronoiCells::new(970, [9, 10], 0.0), Fbm::new(974, [3, 60], 2, 0.6));
    let [sheet, rim, behind] = hex([0x9FA8B5, 0xE6EBF0, 0x14171C]);
    Box::new(move |u, v| {
        let [x, y] = holes.at(u, v).offset;
        let radius = length([x, y]);
        // The lower right of the rim of a hole faces the light.
        let facing = smooth_step(-0.02, 0.03, x + y);
        let ground = shade(sheet, 0.75 + 0.5 * streaks.at(u, v));
        let edge = mix(shade(sheet, 0.55), rim, facing);
        mix(mix(behind, edge, smooth_step(0.030, 0.033, radius)), ground, smooth_step(0.037, 0.040, radius))
    })
}

/// Hammered copper with verdigris in the hollows.
pub(crate) fn copper() -> TextureFn {
    let (dents, stain) = (VoronoiCells::new(980, [9, 10], 0.9), Fbm::new(984, [4, 4], 4, 0.6));
    let palette = hex([0x5A2A18, 0x9A4E2B, 0xC9763F, 0xF0B98A]);
    let verdigris = hex([0x5FA890])[0];
    Box::new(move |u, v| {
        let dent = dents.at(u, v);
        let [x, y] = dent.offset;
        let ground = ramp(&palette, 0.55 + 4.0 * (x + y) + 0.3 * (dent.random - 0.5));
        let hollow =
            smooth_step(0.5, 0.62, stain.at(u, v)) * (1.0 - smooth_step(0.0, 0.035, dent.border_distance()));
        mix(ground, verdigris, hollow)
    })
}
