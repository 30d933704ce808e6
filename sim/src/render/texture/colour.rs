//! Colours as linear factors, and how two of them or a whole palette mix.

use crate::render::math::srgb;

/// Linear red, green and blue, in [0, 1].
pub(super) type Rgb = [f32; 3];

/// Colours of sRGB codes `0xRRGGBB`.
pub(super) fn hex<const N: usize>(codes: [u32; N]) -> [Rgb; N] {
    codes.map(|code| [16, 8, 0].map(|shift| srgb::decode(f64::from(code >> shift & 255) / 255.0)))
}

/// `a` at 0, `b` at 1.
pub(super) fn mix(a: Rgb, b: Rgb, t: f32) -> Rgb {
    core::array::from_fn(|c| a[c] + (b[c] - a[c]) * t)
}

/// The colour under more or less light.
pub(super) fn lit(rgb: Rgb, light: f32) -> Rgb {
    rgb.map(|c| c * light)
}

/// The colour that a lot in [0, 1) draws from a palette.
pub(super) fn pick(palette: &[Rgb], lot: f32) -> Rgb {
    palette[(lot * palette.len() as f32) as usize % palette.len()]
}

/// Through a palette from its first colour at 0 to its last at 1.
pub(super) fn ramp(palette: &[Rgb], t: f32) -> Rgb {
    let last = palette.len() - 1;
    let at = t.clamp(0.0, 1.0) * last as f32;
    let i = (at as usize).min(last - 1);
    mix(palette[i], palette[i + 1], at - i as f32)
}

/// Round a palette, which begins anew at every whole `t`.
pub(super) fn wheel(palette: &[Rgb], t: f32) -> Rgb {
    let at = (t - t.floor()) * palette.len() as f32;
    let i = at as usize % palette.len();
    mix(palette[i], palette[(i + 1) % palette.len()], at - at.floor())
}
