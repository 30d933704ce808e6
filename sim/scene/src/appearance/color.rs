//! Colours. Those of scenes are linear RGB with channels in [0, 1]; these functions convert to it.

/// Converts a linear colour from 8-bit channels. The benchmark's code states its colours in this form.
#[must_use]
pub const fn rgb([r, g, b]: [u8; 3]) -> [f64; 3] {
    [r as f64 / 255.0, g as f64 / 255.0, b as f64 / 255.0]
}

/// Converts an sRGB colour from 8-bit channels, as read off a picture.
#[must_use]
pub const fn srgb(channels: [u8; 3]) -> [f64; 3] {
    let [r, g, b] = rgb(channels);
    [decode_srgb(r), decode_srgb(g), decode_srgb(b)]
}

/// Decodes an sRGB channel in [0, 1] to linear light in [0, 1] (IEC 61966-2-1).
#[must_use]
pub const fn decode_srgb(channel: f64) -> f64 {
    if channel <= 0.040_45 {
        return channel / 12.92;
    }
    // y^2.4 = y² · ⁵√y². Newton's method computes the root, because `powf` differs between systems.
    let y = (channel + 0.055) / 1.055;
    let square = y * y;
    let mut root = 1.0;
    let mut i = 0;
    while i < 40 {
        let fourth = root * root * root * root;
        root -= (root * fourth - square) / (5.0 * fourth);
        i += 1;
    }
    square * root
}
