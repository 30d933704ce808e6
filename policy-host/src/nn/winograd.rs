//! 3×3 convolutions of stride 1 by Winograd's minimal filtering: F(4×4, 3×3) makes 36 products for 16 pixels in place of
//! 144, F(2×2, 3×3) 16 for four in place of 36.
//!
//! A tile is the pixels that a square of neighbouring outputs sees. Tiles and kernels are transformed to points, at each of
//! which a convolution is one matrix product over the channels; the way back gives the square's sums
//! (Lavin and Gray, *Fast Algorithms for Convolutional Neural Networks*, 2016). Where there are many channels, kernels are
//! large and maps small, and the smaller tile is the faster one.

use std::f64::consts::SQRT_2;
use std::ops::Range;

use super::maps::MapShape;
use super::matmul::Into;
use super::packed::Packed;

/// Channels transformed at a time; channels come in multiples of it.
pub(super) const LANES: usize = 8;
/// Numbers in a stripe of tiles, before and after the products, over all points: half a mebibyte.
const STRIPE_LEN: usize = 1 << 17;
/// Fewest tiles in a stripe, so that reading the kernels for each stripe stays cheap; and of the smaller tiles, whose kernels
/// are the larger ones.
const FEWEST_TILES: usize = 24;
const FEWEST_SMALL_TILES: usize = 48;
/// Most numbers in one point's kernels for which the larger tile is used: beyond, its 36 points are too many to read for
/// the few tiles that maps of so many channels have.
const LARGE_TILE_MAX_LEN: usize = 256 * 256;

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
    /// Side of the outputs that a tile yields, 2 or 4; a tile is two pixels wider.
    out_side: usize,
}

/// Working memory.
#[derive(Clone, Debug, Default)]
pub(super) struct WinogradScratch {
    /// `[n_points, tiles · C_in + GAP]`.
    tiles: Vec<f32>,
    /// `[n_points, tiles · C_out + GAP]`.
    products: Vec<f32>,
    /// `[out_side², C_out]`: the sums of one tile.
    sums: Vec<f32>,
    /// `[C_in]`, zero: what lies beyond a map.
    zeros: Vec<f32>,
}

impl Winograd {
    /// From kernels `[3, 3, C_in, C_out]`; both numbers of channels are multiples of [`LANES`].
    pub(super) fn new(kernels: &[f32], c_in: usize, c_out: usize) -> Self {
        let out_side = if c_in * c_out <= LARGE_TILE_MAX_LEN { 4 } else { 2 };
        Self::with_tile(kernels, c_in, c_out, out_side)
    }

    fn with_tile(kernels: &[f32], c_in: usize, c_out: usize, out_side: usize) -> Self {
        assert_eq!((c_in % LANES, c_out % LANES), (0, 0), "channels {c_in} and {c_out}");
        let filter: &[[f64; 3]] = if out_side == 2 { &FILTER_2 } else { &FILTER_4 };
        let tile_side = filter.len();
        let mut points = vec![vec![0.0; c_in * c_out]; tile_side * tile_side];
        for idx in 0..c_in * c_out {
            let tap = |row: usize, col: usize| f64::from(kernels[(row * 3 + col) * c_in * c_out + idx]);
            for (point, numbers) in points.iter_mut().enumerate() {
                let (down, across) = (&filter[point / tile_side], &filter[point % tile_side]);
                let of_row =
                    |row: usize| across.iter().enumerate().map(|(col, x)| x * tap(row, col)).sum::<f64>();
                numbers[idx] = down.iter().enumerate().map(|(row, x)| x * of_row(row)).sum::<f64>() as f32;
            }
        }
        let points = points.iter().map(|point| Packed::new(point, c_in, c_out)).collect();
        Self { points, c_in, c_out, out_side }
    }

    /// Rows of pixels that belong to one row of tiles: bands of lines are best cut at multiples of it.
    pub(super) fn out_side(&self) -> usize {
        self.out_side
    }

    fn stripe(&self) -> usize {
        let fewest = if self.out_side == 4 { FEWEST_TILES } else { FEWEST_SMALL_TILES };
        (STRIPE_LEN / self.points.len() / (self.c_in + self.c_out)).max(fewest)
    }

    /// Lets `scratch` grow to what [`run`](Self::run) needs for inputs of this shape.
    pub(super) fn reserve(&self, input: MapShape, scratch: &mut WinogradScratch) {
        let across = |side: usize| side.div_ceil(self.out_side);
        let n_tiles = self.stripe().min(input.n_maps * across(input.height) * across(input.width));
        let grow = |buffer: &mut Vec<f32>, len: usize| buffer.resize(buffer.len().max(len), 0.0);
        grow(&mut scratch.tiles, self.points.len() * (n_tiles * self.c_in + GAP));
        grow(&mut scratch.products, self.points.len() * (n_tiles * self.c_out + GAP));
        grow(&mut scratch.sums, self.out_side * self.out_side * self.c_out);
        grow(&mut scratch.zeros, self.c_in);
    }

    /// Convolves `input`, whose border is one pixel wide, and hands the sums of each pixel of these lines to
    /// `take(line, col, sums [C_out])`. Line `map_idx · height + row` is a row of a map.
    ///
    /// The transforms have no product and sum fused, so wider registers change no bit.
    pub(super) fn run(
        &self,
        input: &[f32],
        shape: MapShape,
        lines: Range<usize>,
        scratch: &mut WinogradScratch,
        take: impl FnMut(usize, usize, &[f32]),
    ) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { self.run_avx2(input, shape, lines, scratch, take) };
        }
        self.run_any(input, shape, lines, scratch, take);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn run_avx2(
        &self,
        input: &[f32],
        shape: MapShape,
        lines: Range<usize>,
        scratch: &mut WinogradScratch,
        take: impl FnMut(usize, usize, &[f32]),
    ) {
        self.run_any(input, shape, lines, scratch, take);
    }

    #[inline(always)]
    fn run_any(
        &self,
        input: &[f32],
        shape: MapShape,
        lines: Range<usize>,
        scratch: &mut WinogradScratch,
        take: impl FnMut(usize, usize, &[f32]),
    ) {
        if self.out_side == 2 {
            self.run_tiles::<2, 4>(input, shape, lines, scratch, take);
        } else {
            self.run_tiles::<4, 6>(input, shape, lines, scratch, take);
        }
    }

    #[inline(always)]
    fn run_tiles<const OUT: usize, const TILE: usize>(
        &self,
        input: &[f32],
        shape: MapShape,
        lines: Range<usize>,
        scratch: &mut WinogradScratch,
        mut take: impl FnMut(usize, usize, &[f32]),
    ) {
        assert_eq!(shape.border, 1, "the border is the padding");
        let (down, across) = (shape.height.div_ceil(OUT), shape.width.div_ceil(OUT));
        // Rows of tiles, counted through all maps, that the lines touch.
        let tile_row = |line: usize| line / shape.height * down + line % shape.height / OUT;
        let tiles_of_lines = tile_row(lines.start) * across..(tile_row(lines.end - 1) + 1) * across;
        let place = |tile: usize| (tile / across / down, OUT * (tile / across % down), OUT * (tile % across));
        let WinogradScratch { tiles, products, sums, zeros } = scratch;
        let stripe = self.stripe();
        for first in tiles_of_lines.clone().step_by(stripe) {
            let n = stripe.min(tiles_of_lines.end - first);
            let (before, after) = (n * self.c_in + GAP, n * self.c_out + GAP);
            for idx in 0..n {
                let (map_idx, row, col) = place(first + idx);
                let map = &input[map_idx * shape.map_len()..(map_idx + 1) * shape.map_len()];
                let pixels: [[&[Channels]; TILE]; TILE] = std::array::from_fn(|down| {
                    std::array::from_fn(|right| {
                        let (row, col) = (row + down, col + right);
                        let inside = row < shape.n_rows() && col < shape.pitch();
                        let pixel =
                            if inside { &map[(row * shape.pitch() + col) * self.c_in..] } else { &zeros[..] };
                        pixel[..self.c_in].as_chunks().0
                    })
                });
                transform_tile(&pixels, tiles.as_chunks_mut().0, before / LANES, idx * self.c_in / LANES);
            }
            let of_points = tiles.chunks_exact(before).zip(products.chunks_exact_mut(after));
            for (weights, (tiles, products)) in self.points.iter().zip(of_points) {
                let (tiles, products) = (&tiles[..n * self.c_in], &mut products[..n * self.c_out]);
                weights.run(tiles, self.c_in, products, Into::Replace);
            }
            let sums = &mut sums[..OUT * OUT * self.c_out];
            for idx in 0..n {
                let (map_idx, row, col) = place(first + idx);
                let at = idx * self.c_out / LANES;
                transform_back::<OUT, TILE>(
                    products.as_chunks().0,
                    after / LANES,
                    at,
                    sums.as_chunks_mut().0,
                );
                for (part, sums) in sums.chunks_exact(self.c_out).enumerate() {
                    let (row, col) = (row + part / OUT, col + part % OUT);
                    let line = map_idx * shape.height + row;
                    if row < shape.height && col < shape.width && lines.contains(&line) {
                        take(line, col, sums);
                    }
                }
            }
        }
    }
}

/// `G` of F(2×2, 3×3): from taps to points, along one side.
const FILTER_2: [[f64; 3]; 4] = [[1.0, 0.0, 0.0], [0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0.0, 0.0, 1.0]];
/// F(4×4, 3×3) interpolates at 0, ±√½, ±√2 and infinity: the usual 0, ±1, ±2 would lose two (on average) to
/// five times (at worst) as much to rounding.
const NEAR: f32 = std::f32::consts::FRAC_1_SQRT_2;
const FAR: f32 = std::f32::consts::SQRT_2;
/// `G` of F(4×4, 3×3).
const FILTER_4: [[f64; 3]; 6] = [
    [1.0, 0.0, 0.0],
    [-2.0 / 3.0, -SQRT_2 / 3.0, -1.0 / 3.0],
    [-2.0 / 3.0, SQRT_2 / 3.0, -1.0 / 3.0],
    [1.0 / 6.0, SQRT_2 / 6.0, 1.0 / 3.0],
    [1.0 / 6.0, -SQRT_2 / 6.0, 1.0 / 3.0],
    [0.0, 0.0, 1.0],
];

// Plain loops here and below: the closures of `array::from_fn` and `array::map` are not inlined for certain, and what is not
// inlined is compiled for narrow registers.
#[inline(always)]
fn lanes(f: impl Fn(usize) -> f32) -> Channels {
    let mut out = [0.0; LANES];
    for (i, x) in out.iter_mut().enumerate() {
        *x = f(i);
    }
    out
}

/// `Bᵀ · d`: from pixels to points, along one side.
#[inline(always)]
fn tile_side<const TILE: usize>(d: [Channels; TILE]) -> [Channels; TILE] {
    let mut points = [[0.0; LANES]; TILE];
    if TILE == 4 {
        points[0] = lanes(|i| d[0][i] - d[2][i]);
        points[1] = lanes(|i| d[1][i] + d[2][i]);
        points[2] = lanes(|i| d[2][i] - d[1][i]);
        points[3] = lanes(|i| d[1][i] - d[3][i]);
    } else {
        let near = (lanes(|i| d[4][i] - 2.0 * d[2][i]), lanes(|i| NEAR * (d[3][i] - 2.0 * d[1][i])));
        let far = (lanes(|i| d[4][i] - 0.5 * d[2][i]), lanes(|i| FAR * (d[3][i] - 0.5 * d[1][i])));
        points[0] = lanes(|i| (d[0][i] + d[4][i]) - 2.5 * d[2][i]);
        points[1] = lanes(|i| near.0[i] + near.1[i]);
        points[2] = lanes(|i| near.0[i] - near.1[i]);
        points[3] = lanes(|i| far.0[i] + far.1[i]);
        points[4] = lanes(|i| far.0[i] - far.1[i]);
        points[5] = lanes(|i| (d[1][i] + d[5][i]) - 2.5 * d[3][i]);
    }
    points
}

/// `Aᵀ · m`: from points to sums, along one side.
#[inline(always)]
fn out_side<const OUT: usize, const TILE: usize>(m: [Channels; TILE]) -> [Channels; OUT] {
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

/// Writes the points of a tile's pixels, `stride` apart from `at` on.
#[inline(always)]
fn transform_tile<const TILE: usize>(
    pixels: &[[&[Channels]; TILE]; TILE],
    out: &mut [Channels],
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
            let column = tile_side(column);
            for row in 0..TILE {
                half[row][col] = column[row];
            }
        }
        for row in 0..TILE {
            let points = tile_side(half[row]);
            for col in 0..TILE {
                out[(row * TILE + col) * stride + at + group] = points[col];
            }
        }
    }
}

/// Writes a tile's sums, `[OUT², C_out]`, from products `stride` apart from `at` on.
#[inline(always)]
fn transform_back<const OUT: usize, const TILE: usize>(
    products: &[Channels],
    stride: usize,
    at: usize,
    out: &mut [Channels],
) {
    let n_groups = out.len() / (OUT * OUT);
    for group in 0..n_groups {
        let mut half = [[[0.0; LANES]; TILE]; OUT];
        for col in 0..TILE {
            let mut column = [[0.0; LANES]; TILE];
            for row in 0..TILE {
                column[row] = products[(row * TILE + col) * stride + at + group];
            }
            let column = out_side::<OUT, TILE>(column);
            for row in 0..OUT {
                half[row][col] = column[row];
            }
        }
        for row in 0..OUT {
            let sums = out_side::<OUT, TILE>(half[row]);
            for col in 0..OUT {
                out[(row * OUT + col) * n_groups + group] = sums[col];
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

    /// The definition's sum at a pixel of a line.
    fn sum(
        input: &[f32],
        shape: MapShape,
        kernels: &[f32],
        c_out: usize,
        (line, col, out_idx): (usize, usize, usize),
    ) -> f64 {
        let c_in = shape.channels;
        let (map_idx, row) = (line / shape.height, line % shape.height);
        let taps = (0..9).map(|tap| {
            let first = map_idx * shape.map_len() + ((row + tap / 3) * shape.pitch() + col + tap % 3) * c_in;
            let of_tap = (0..c_in).map(|in_idx| {
                let weight = f64::from(kernels[(tap * c_in + in_idx) * c_out + out_idx]);
                f64::from(input[first + in_idx]) * weight
            });
            of_tap.sum::<f64>()
        });
        taps.sum()
    }

    #[test]
    fn both_tiles_agree_with_the_definition_for_even_and_odd_sides_and_several_maps() {
        let shapes = [(7, 7, 3, 8, 16), (14, 10, 1, 16, 8), (5, 9, 2, 72, 8), (56, 56, 1, 8, 64)];
        for (height, width, n_maps, c_in, c_out) in shapes {
            let shape = MapShape { n_maps, height, width, channels: c_in, border: 1 };
            let mut input = numbers(shape.len(), 1);
            shape.clear_border(&mut input);
            let kernels = numbers(9 * c_in * c_out, 2);
            for (out_side, tolerance) in [(2, 1e-5), (4, 5e-5)] {
                let winograd = Winograd::with_tile(&kernels, c_in, c_out, out_side);
                let mut scratch = WinogradScratch::default();
                winograd.reserve(shape, &mut scratch);
                let mut n_taken = 0;
                winograd.run(&input, shape, 0..n_maps * height, &mut scratch, |line, col, sums| {
                    n_taken += 1;
                    for (out_idx, &found) in sums.iter().enumerate() {
                        let expected = sum(&input, shape, &kernels, c_out, (line, col, out_idx));
                        let error = (f64::from(found) - expected).abs();
                        assert!(
                            error < tolerance,
                            "{shape:?} at {line} {col} {out_idx}: {found} for {expected}"
                        );
                    }
                });
                assert_eq!(n_taken, n_maps * height * width, "{shape:?}");
            }
        }
    }

    #[test]
    fn a_band_of_lines_has_the_bits_that_all_lines_have() {
        let shape = MapShape { n_maps: 2, height: 14, width: 14, channels: 8, border: 1 };
        let mut input = numbers(shape.len(), 1);
        shape.clear_border(&mut input);
        for out_side in [2, 4] {
            let winograd = Winograd::with_tile(&numbers(9 * 64, 2), 8, 8, out_side);
            let mut scratch = WinogradScratch::default();
            winograd.reserve(shape, &mut scratch);
            let mut sums_of = |lines: Range<usize>| {
                let mut taken = std::collections::BTreeMap::new();
                winograd.run(&input, shape, lines, &mut scratch, |line, col, sums| {
                    assert_eq!(taken.insert((line, col), sums.to_vec()), None, "taken once");
                });
                taken
            };
            let whole = sums_of(0..28);
            for (start, end) in [(0, 8), (3, 17), (8, 28), (27, 28)] {
                let band = sums_of(start..end);
                assert_eq!(band.len(), (end - start) * 14);
                assert!(band.iter().all(|(place, sums)| whole[place] == *sums));
            }
        }
    }
}
