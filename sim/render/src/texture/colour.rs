//! Linear colours and palettes.

use crate::math::srgb;

/// Linear red, green and blue, in [0, 1].
pub(crate) type Rgb = [f32; 3];

/// A pattern: maps a point (u, v) of the tile, both in [0, 1), to linear factors.
pub(crate) type TextureFn = Box<dyn Fn(f32, f32) -> Rgb>;

/// Decodes sRGB codes `0xRRGGBB`.
pub(crate) fn hex<const N: usize>(codes: [u32; N]) -> [Rgb; N] {
    codes.map(|code| [16, 8, 0].map(|shift| srgb::decode(f64::from(code >> shift & 255) / 255.0)))
}

/// Interpolates linearly from `a` at t = 0 to `b` at t = 1.
pub(crate) fn mix(a: Rgb, b: Rgb, t: f32) -> Rgb {
    core::array::from_fn(|c| a[c] + (b[c] - a[c]) * t)
}

/// Multiplies a colour by a light intensity.
pub(crate) fn shade(rgb: Rgb, light: f32) -> Rgb {
    rgb.map(|c| c * light)
}

/// Picks a palette entry by a random number in [0, 1).
pub(crate) fn pick(palette: &[Rgb], random: f32) -> Rgb {
    palette[(random * palette.len() as f32) as usize % palette.len()]
}

/// Interpolates along a palette, from its first colour at t = 0 to its last at t = 1.
pub(crate) fn ramp(palette: &[Rgb], t: f32) -> Rgb {
    let last = palette.len() - 1;
    let at = t.clamp(0.0, 1.0) * last as f32;
    let i = (at as usize).min(last - 1);
    mix(palette[i], palette[i + 1], at - i as f32)
}

/// Interpolates along a cyclic palette with period 1.
pub(crate) fn cyclic_ramp(palette: &[Rgb], t: f32) -> Rgb {
    let at = (t - t.floor()) * palette.len() as f32;
    let i = at as usize % palette.len();
    mix(palette[i], palette[(i + 1) % palette.len()], at - at.floor())
}
