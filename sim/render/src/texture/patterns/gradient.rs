//! Colour gradients, periodic like all textures.

use crate::texture::colour::{TextureFn, cyclic_ramp, hex, mix, ramp};
use crate::texture::shaping::{length, smooth_wave};

/// From night blue to gold and back, along v.
pub(crate) fn sunset() -> TextureFn {
    let palette = hex([0x2B1B4F, 0x7B2D6B, 0xD3534F, 0xF49A4A, 0xFFE08A]);
    Box::new(move |_, v| ramp(&palette, smooth_wave(v)))
}

/// Diagonal gradient through the colours of deep and shallow water.
pub(crate) fn ocean() -> TextureFn {
    let palette = hex([0x0B2C4D, 0x12638A, 0x2FA7A8, 0xB6E3CF, 0x4FB3C4, 0x17568C]);
    Box::new(move |u, v| cyclic_ramp(&palette, u + v))
}

/// A radial gradient from a bright centre to dark.
pub(crate) fn glow() -> TextureFn {
    let palette = hex([0xFFF3C9, 0xF7B267, 0xD9566B, 0x5B2A6E, 0x1E1638]);
    Box::new(move |u, v| {
        // The gradient ends where the circle touches the sides of the tile.
        ramp(&palette, 2.0 * length([u - 0.5, v - 0.5]))
    })
}

/// All hues along u, paler in the middle of v.
pub(crate) fn rainbow() -> TextureFn {
    let palette = hex([0xD9453D, 0xE8963A, 0xE6D04B, 0x58B15A, 0x3E86C6, 0x7B53A6]);
    let white = hex([0xF4EFE8])[0];
    Box::new(move |u, v| mix(cyclic_ramp(&palette, u), white, 0.45 * smooth_wave(v)))
}
