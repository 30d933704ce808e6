//! 3×3 convolutions of stride 1 by Winograd's minimal filtering F(2×2, 3×3): 16 products for four pixels in place of 36.
//!
//! A tile is the 4×4 pixels that four neighbouring outputs see. Tiles and kernels are transformed to 16 points, at each of
//! which a convolution is one matrix product over the channels; the way back gives 2×2 sums
//! (Lavin and Gray, *Fast Algorithms for Convolutional Neural Networks*, 2016).

use super::maps::MapShape;
use super::matmul::Into;
use super::packed::Packed;

/// Points of a transformed tile.
const N_POINTS: usize = 16;
/// Side of a tile, and of the outputs it yields.
const TILE_SIDE: usize = 4;
const OUT_SIDE: usize = 2;
/// Channels transformed at a time; channels come in multiples of it.
pub(super) const LANES: usize = 8;
/// Numbers per point in a stripe of tiles, before and after the products: a mebibyte over all points.
const STRIPE_LEN: usize = 1 << 13;
/// Fewest tiles in a stripe, so that reading the weights for each stripe stays cheap.
const STRIPE_MIN_TILES: usize = 48;

/// Numbers left free after each point, a cache line: points of a round number of bytes would all fall on the same few
/// places of the first-level cache.
const GAP: usize = 16;

type Channels = [f32; LANES];

/// Kernels, transformed.
#[derive(Clone, Debug)]
pub(super) struct Winograd {
    /// For each point `[C_in, C_out]`.
    points: Vec<Packed>,
    c_in: usize,
    c_out: usize,
}

/// Working memory.
#[derive(Clone, Debug, Default)]
pub(super) struct WinogradScratch {
    /// `[N_POINTS, tiles · C_in + GAP]`.
    tiles: Vec<f32>,
    /// `[N_POINTS, tiles · C_out + GAP]`.
    products: Vec<f32>,
    /// `[4, C_out]`: the sums of one tile.
    sums: Vec<f32>,
    /// `[C_in]`, zero: what lies beyond a map.
    zeros: Vec<f32>,
}

impl Winograd {
    /// From kernels `[3, 3, C_in, C_out]`; both numbers of channels are multiples of [`LANES`].
    pub(super) fn new(kernels: &[f32], c_in: usize, c_out: usize) -> Self {
        assert_eq!((c_in % LANES, c_out % LANES), (0, 0), "channels {c_in} and {c_out}");
        let mut points = vec![vec![0.0; c_in * c_out]; N_POINTS];
        for idx in 0..c_in * c_out {
            let taps: [[f64; 3]; 3] = std::array::from_fn(|row| {
                std::array::from_fn(|col| f64::from(kernels[(row * 3 + col) * c_in * c_out + idx]))
            });
            let down: [[f64; 3]; TILE_SIDE] =
                transposed(&[0, 1, 2].map(|col| filter([taps[0][col], taps[1][col], taps[2][col]])));
            for (row, taps) in down.into_iter().enumerate() {
                for (col, x) in filter(taps).into_iter().enumerate() {
                    points[row * TILE_SIDE + col][idx] = x as f32;
                }
            }
        }
        let points = points.iter().map(|point| Packed::new(point, c_in, c_out)).collect();
        Self { points, c_in, c_out }
    }

    fn n_tiles(shape: MapShape) -> usize {
        let across = shape.side.div_ceil(OUT_SIDE);
        shape.n_maps * across * across
    }

    fn stripe(&self, shape: MapShape) -> usize {
        (STRIPE_LEN / (self.c_in + self.c_out)).max(STRIPE_MIN_TILES).min(Self::n_tiles(shape))
    }

    /// Lets `scratch` grow to what [`run`](Self::run) needs for this input.
    pub(super) fn reserve(&self, input: MapShape, scratch: &mut WinogradScratch) {
        let n_tiles = self.stripe(input);
        let grow = |buffer: &mut Vec<f32>, len: usize| buffer.resize(buffer.len().max(len), 0.0);
        grow(&mut scratch.tiles, N_POINTS * (n_tiles * self.c_in + GAP));
        grow(&mut scratch.products, N_POINTS * (n_tiles * self.c_out + GAP));
        grow(&mut scratch.sums, OUT_SIDE * OUT_SIDE * self.c_out);
        grow(&mut scratch.zeros, self.c_in);
    }

    /// Convolves `input`, whose border is one pixel wide, and hands the sums of each pixel to
    /// `take(map_idx, row, col, sums [C_out])`.
    ///
    /// The transforms only add, so wider registers change no bit.
    pub(super) fn run(
        &self,
        input: &[f32],
        shape: MapShape,
        scratch: &mut WinogradScratch,
        take: impl FnMut(usize, usize, usize, &[f32]),
    ) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { self.run_avx2(input, shape, scratch, take) };
        }
        self.run_any(input, shape, scratch, take);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn run_avx2(
        &self,
        input: &[f32],
        shape: MapShape,
        scratch: &mut WinogradScratch,
        take: impl FnMut(usize, usize, usize, &[f32]),
    ) {
        self.run_any(input, shape, scratch, take);
    }

    #[inline(always)]
    fn run_any(
        &self,
        input: &[f32],
        shape: MapShape,
        scratch: &mut WinogradScratch,
        mut take: impl FnMut(usize, usize, usize, &[f32]),
    ) {
        assert_eq!(shape.border, 1, "the border is the padding");
        let across = shape.side.div_ceil(OUT_SIDE);
        let place = |tile: usize| {
            (tile / (across * across), OUT_SIDE * (tile / across % across), OUT_SIDE * (tile % across))
        };
        let WinogradScratch { tiles, products, sums, zeros } = scratch;
        let n_tiles = Self::n_tiles(shape);
        let stripe = self.stripe(shape);
        for first in (0..n_tiles).step_by(stripe) {
            let n = stripe.min(n_tiles - first);
            let (before, after) = (n * self.c_in + GAP, n * self.c_out + GAP);
            for idx in 0..n {
                let (map_idx, row, col) = place(first + idx);
                let map = &input[map_idx * shape.map_len()..(map_idx + 1) * shape.map_len()];
                let pixels: [&[Channels]; N_POINTS] = std::array::from_fn(|point| {
                    let (row, col) = (row + point / TILE_SIDE, col + point % TILE_SIDE);
                    let inside = row < shape.pitch() && col < shape.pitch();
                    let pixel =
                        if inside { &map[(row * shape.pitch() + col) * self.c_in..] } else { &zeros[..] };
                    pixel[..self.c_in].as_chunks().0
                });
                transform_tile(&pixels, tiles.as_chunks_mut().0, before / LANES, idx * self.c_in / LANES);
            }
            let of_points = tiles.chunks_exact(before).zip(products.chunks_exact_mut(after));
            for (weights, (tiles, products)) in self.points.iter().zip(of_points) {
                let (tiles, products) = (&tiles[..n * self.c_in], &mut products[..n * self.c_out]);
                weights.run(tiles, self.c_in, products, Into::Replace);
            }
            let sums = &mut sums[..OUT_SIDE * OUT_SIDE * self.c_out];
            for idx in 0..n {
                let (map_idx, row, col) = place(first + idx);
                let at = idx * self.c_out / LANES;
                transform_back(products.as_chunks().0, after / LANES, at, sums.as_chunks_mut().0);
                for (part, sums) in sums.chunks_exact(self.c_out).enumerate() {
                    let (row, col) = (row + part / OUT_SIDE, col + part % OUT_SIDE);
                    if row < shape.side && col < shape.side {
                        take(map_idx, row, col, sums);
                    }
                }
            }
        }
    }
}

/// `G · taps`.
fn filter([a, b, c]: [f64; 3]) -> [f64; TILE_SIDE] {
    [a, 0.5 * (a + b + c), 0.5 * (a - b + c), c]
}

fn transposed<const ROWS: usize, const COLS: usize>(x: &[[f64; COLS]; ROWS]) -> [[f64; ROWS]; COLS] {
    std::array::from_fn(|col| std::array::from_fn(|row| x[row][col]))
}

#[inline(always)]
fn add(a: Channels, b: Channels) -> Channels {
    std::array::from_fn(|lane| a[lane] + b[lane])
}

#[inline(always)]
fn subtract(a: Channels, b: Channels) -> Channels {
    std::array::from_fn(|lane| a[lane] - b[lane])
}

/// `Bᵀ · d`.
#[inline(always)]
fn tile_side([a, b, c, d]: [Channels; TILE_SIDE]) -> [Channels; TILE_SIDE] {
    [subtract(a, c), add(b, c), subtract(c, b), subtract(b, d)]
}

/// `Aᵀ · m`.
#[inline(always)]
fn out_side([a, b, c, d]: [Channels; TILE_SIDE]) -> [Channels; OUT_SIDE] {
    [add(add(a, b), c), subtract(subtract(b, c), d)]
}

/// Writes the points of a tile's pixels, `stride` apart from `at` on.
#[inline(always)]
fn transform_tile(pixels: &[&[Channels]; N_POINTS], out: &mut [Channels], stride: usize, at: usize) {
    for group in 0..pixels[0].len() {
        let column = |col: usize| tile_side(std::array::from_fn(|row| pixels[row * TILE_SIDE + col][group]));
        let columns = [column(0), column(1), column(2), column(3)];
        for row in 0..TILE_SIDE {
            for (col, x) in tile_side(columns.map(|column| column[row])).into_iter().enumerate() {
                out[(row * TILE_SIDE + col) * stride + at + group] = x;
            }
        }
    }
}

/// Writes the four pixels' sums, `[4, C_out]`, from products `stride` apart from `at` on.
#[inline(always)]
fn transform_back(products: &[Channels], stride: usize, at: usize, out: &mut [Channels]) {
    let n_groups = out.len() / (OUT_SIDE * OUT_SIDE);
    for group in 0..n_groups {
        let column = |col: usize| {
            out_side(std::array::from_fn(|row| products[(row * TILE_SIDE + col) * stride + at + group]))
        };
        let columns = [column(0), column(1), column(2), column(3)];
        for row in 0..OUT_SIDE {
            for (col, x) in out_side(columns.map(|column| column[row])).into_iter().enumerate() {
                out[(row * OUT_SIDE + col) * n_groups + group] = x;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(n: usize, salt: usize) -> Vec<f32> {
        (0..n).map(|i| ((i * 7919 + salt * 104_729) % 2003) as f32 / 1001.0 - 1.0).collect()
    }

    #[test]
    fn agrees_with_the_definition_for_even_and_odd_sides_and_several_maps() {
        for (side, n_maps, c_in, c_out) in [(7, 3, 8, 16), (14, 1, 16, 8), (5, 2, 72, 8), (56, 1, 8, 64)] {
            let shape = MapShape { n_maps, side, channels: c_in, border: 1 };
            let mut input = numbers(shape.len(), 1);
            shape.clear_border(&mut input);
            let kernels = numbers(9 * c_in * c_out, 2);
            let winograd = Winograd::new(&kernels, c_in, c_out);
            let mut scratch = WinogradScratch::default();
            winograd.reserve(shape, &mut scratch);
            let mut n_taken = 0;
            winograd.run(&input, shape, &mut scratch, |map_idx, row, col, sums| {
                n_taken += 1;
                for (out_idx, &found) in sums.iter().enumerate() {
                    let mut expected = 0.0;
                    for tap in 0..9 {
                        let first = map_idx * shape.map_len()
                            + ((row + tap / 3) * shape.pitch() + col + tap % 3) * c_in;
                        for in_idx in 0..c_in {
                            let weight = f64::from(kernels[(tap * c_in + in_idx) * c_out + out_idx]);
                            expected += f64::from(input[first + in_idx]) * weight;
                        }
                    }
                    let error = (f64::from(found) - expected).abs();
                    assert!(
                        error < 5e-5,
                        "{shape:?} at {map_idx} {row} {col} {out_idx}: {found} for {expected}"
                    );
                }
            });
            assert_eq!(n_taken, n_maps * side * side, "{shape:?}");
        }
    }
}
