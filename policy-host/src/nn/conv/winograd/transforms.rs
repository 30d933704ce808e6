//! The transforms of F(2×2, 3×3) and F(4×4, 3×3).
//!
//! They use no fused multiply-add, so the vector width does not change a bit.

use std::f64::consts::SQRT_2;

/// Number of channels transformed at a time. Channel counts must be multiples of it.
pub(crate) const LANES: usize = 8;

pub(crate) type ChannelLanes = [f32; LANES];

/// Kernel transform `G` of F(2×2, 3×3), along one axis.
pub(crate) const G_F2: [[f64; 3]; 4] = [[1.0, 0.0, 0.0], [0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0.0, 0.0, 1.0]];
/// Inner interpolation point of F(4×4, 3×3). The elements are 0, ±√½, ±√2 and infinity; the usual 0, ±1, ±2
/// would have two times (mean) to five times (maximum) the rounding error.
const NEAR: f32 = std::f32::consts::FRAC_1_SQRT_2;
/// Outer interpolation point of F(4×4, 3×3).
const FAR: f32 = std::f32::consts::SQRT_2;
/// Kernel transform `G` of F(4×4, 3×3), along one axis.
pub(crate) const G_F4: [[f64; 3]; 6] = [
    [1.0, 0.0, 0.0],
    [-2.0 / 3.0, -SQRT_2 / 3.0, -1.0 / 3.0],
    [-2.0 / 3.0, SQRT_2 / 3.0, -1.0 / 3.0],
    [1.0 / 6.0, SQRT_2 / 6.0, 1.0 / 3.0],
    [1.0 / 6.0, -SQRT_2 / 6.0, 1.0 / 3.0],
    [0.0, 0.0, 1.0],
];

// Plain loops here and below: closures of `array::from_fn` and `array::map` are not reliably inlined, and
// code that is not inlined is compiled for the baseline instruction set.
#[inline(always)]
fn lanes(f: impl Fn(usize) -> f32) -> ChannelLanes {
    let mut out = [0.0; LANES];
    for (i, x) in out.iter_mut().enumerate() {
        *x = f(i);
    }
    out
}

/// Computes the input transform `Bᵀ · d` along one axis.
#[inline(always)]
fn input_transform_1d<const TILE: usize>(d: [ChannelLanes; TILE]) -> [ChannelLanes; TILE] {
    let mut elements = [[0.0; LANES]; TILE];
    if TILE == 4 {
        elements[0] = lanes(|i| d[0][i] - d[2][i]);
        elements[1] = lanes(|i| d[1][i] + d[2][i]);
        elements[2] = lanes(|i| d[2][i] - d[1][i]);
        elements[3] = lanes(|i| d[1][i] - d[3][i]);
    } else {
        let near = (lanes(|i| d[4][i] - 2.0 * d[2][i]), lanes(|i| NEAR * (d[3][i] - 2.0 * d[1][i])));
        let far = (lanes(|i| d[4][i] - 0.5 * d[2][i]), lanes(|i| FAR * (d[3][i] - 0.5 * d[1][i])));
        elements[0] = lanes(|i| (d[0][i] + d[4][i]) - 2.5 * d[2][i]);
        elements[1] = lanes(|i| near.0[i] + near.1[i]);
        elements[2] = lanes(|i| near.0[i] - near.1[i]);
        elements[3] = lanes(|i| far.0[i] + far.1[i]);
        elements[4] = lanes(|i| far.0[i] - far.1[i]);
        elements[5] = lanes(|i| (d[1][i] + d[5][i]) - 2.5 * d[3][i]);
    }
    elements
}

/// Computes the output transform `Aᵀ · m` along one axis.
#[inline(always)]
fn output_transform_1d<const OUT: usize, const TILE: usize>(m: [ChannelLanes; TILE]) -> [ChannelLanes; OUT] {
    let mut sums = [[0.0; LANES]; OUT];
    if TILE == 4 {
        sums[0] = lanes(|i| (m[0][i] + m[1][i]) + m[2][i]);
        sums[1] = lanes(|i| (m[1][i] - m[2][i]) - m[3][i]);
    } else {
        let near = (lanes(|i| m[1][i] + m[2][i]), lanes(|i| NEAR * (m[1][i] - m[2][i])));
        let far = (lanes(|i| m[3][i] + m[4][i]), lanes(|i| FAR * (m[3][i] - m[4][i])));
        sums[0] = lanes(|i| (m[0][i] + near.0[i]) + far.0[i]);
        sums[1] = lanes(|i| near.1[i] + far.1[i]);
        sums[2] = lanes(|i| 0.5 * near.0[i] + 2.0 * far.0[i]);
        sums[3] = lanes(|i| (0.5 * near.1[i] + 2.0 * far.1[i]) + m[5][i]);
    }
    sums
}

/// Transforms the pixels of a tile and writes its elements to `out`, `stride` apart, starting at `at`.
#[inline(always)]
pub(crate) fn input_transform<const TILE: usize>(
    pixels: &[[&[ChannelLanes]; TILE]; TILE],
    out: &mut [ChannelLanes],
    stride: usize,
    at: usize,
) {
    for group in 0..pixels[0][0].len() {
        let mut half = [[[0.0; LANES]; TILE]; TILE];
        for col in 0..TILE {
            let mut column = [[0.0; LANES]; TILE];
            for row in 0..TILE {
                column[row] = pixels[row][col][group];
            }
            let column = input_transform_1d(column);
            for row in 0..TILE {
                half[row][col] = column[row];
            }
        }
        for row in 0..TILE {
            let elements = input_transform_1d(half[row]);
            for col in 0..TILE {
                out[(row * TILE + col) * stride + at + group] = elements[col];
            }
        }
    }
}

/// Transforms the products of a tile, `stride` apart starting at `at`, and writes its sums `[OUT², c_out]`.
#[inline(always)]
pub(crate) fn output_transform<const OUT: usize, const TILE: usize>(
    products: &[ChannelLanes],
    stride: usize,
    at: usize,
    out: &mut [ChannelLanes],
) {
    let n_groups = out.len() / (OUT * OUT);
    for group in 0..n_groups {
        let mut half = [[[0.0; LANES]; TILE]; OUT];
        for col in 0..TILE {
            let mut column = [[0.0; LANES]; TILE];
            for row in 0..TILE {
                column[row] = products[(row * TILE + col) * stride + at + group];
            }
            let column = output_transform_1d::<OUT, TILE>(column);
            for row in 0..OUT {
                half[row][col] = column[row];
            }
        }
        for row in 0..OUT {
            let sums = output_transform_1d::<OUT, TILE>(half[row]);
            for col in 0..OUT {
                out[(row * OUT + col) * n_groups + group] = sums[col];
            }
        }
    }
}
