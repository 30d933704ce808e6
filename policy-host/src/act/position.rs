//! Fixed two-dimensional sinusoidal position encoding of image tokens (Carion et al., End-to-end object
//! detection with transformers, 2020).

use std::f64::consts::TAU;

use super::architecture::ImageSize;

/// Base of the geometric progression of wavelengths.
const TEMPERATURE: f64 = 10_000.0;

/// Returns the encoding `[h, w, d] f32` of one camera's feature map. The first half of a token encodes its
/// row, the second half its column.
#[must_use]
pub(crate) fn sine_encoding(map: ImageSize, hidden_dim: usize) -> Vec<f32> {
    let half = hidden_dim / 2;
    let mut encoding = vec![0.0; map.n_pixels() * hidden_dim];
    for (token, out) in encoding.chunks_exact_mut(hidden_dim).enumerate() {
        let coordinates = [(token / map.width, map.height), (token % map.width, map.width)];
        for (part, (coordinate, side)) in coordinates.into_iter().enumerate() {
            let angle = (coordinate + 1) as f64 / (side as f64 + 1e-6) * TAU;
            for (idx, x) in out[part * half..(part + 1) * half].iter_mut().enumerate() {
                let phase = angle / libm::pow(TEMPERATURE, (idx / 2 * 2) as f64 / half as f64);
                *x = if idx % 2 == 0 { libm::sin(phase) } else { libm::cos(phase) } as f32;
            }
        }
    }
    encoding
}
