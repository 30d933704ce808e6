//! Winograd convolution for 3×3 kernels with stride 1 (Lavin and Gray, *Fast Algorithms for Convolutional
//! Neural Networks*, 2016). F(4×4, 3×3) takes 36 products for 16 output pixels instead of 144; F(2×2, 3×3)
//! takes 16 products for four pixels instead of 36.
//!
//! An input tile is the receptive field of a square of output pixels. Tiles and kernels are transformed; in
//! the transform domain the convolution is one matrix product over the channels per tile element, and the
//! output transform yields the sums of the square. F(2×2, 3×3) is for layers with more channels than those of
//! a ResNet-18 of the usual width: its transformed kernels are less than half as large.

mod transforms;

use std::ops::Range;

use rayon::prelude::*;

pub(crate) use self::transforms::LANES;
use self::transforms::{ChannelLanes, G_F2, G_F4, input_transform, output_transform};
use super::feature_map::FeatureMapShape;
use crate::nn::gemm::matmul::Accum;
use crate::nn::gemm::packed::PackedWeights;
#[cfg(target_arch = "x86_64")]
use crate::nn::isa::{V3, V4};

/// Number of values in a block of tiles, transformed inputs and products together: 0.5 MiB.
const BLOCK_LEN: usize = 1 << 17;
/// Minimum number of F(4×4) tiles in a block, to amortise reading the kernels once per block: the tiles of
/// four samples with three images in ResNet-18's last stage.
const MIN_TILES_F4: usize = 48;
/// Minimum number of F(2×2) tiles in a block. Their kernels have more channels, so a block needs more tiles.
const MIN_TILES_F2: usize = 48;
/// Maximum `c_in · c_out` for F(4×4), that of the last stage of ResNet-18. With F(4×4) in this stage,
/// queries of full-size ACT take 1 to 5 % less time than with F(2×2) in batches of eight, and 5 to 12 % less
/// alone, on a Zen 5. Wider layers were not measured.
const F4_MAX_CHANNEL_PRODUCT: usize = 512 * 512;

/// Unused values after each tile element, one cache line. Without them the elements would be a power of two
/// apart and compete for the same L1 cache sets.
const SET_CONFLICT_GAP: usize = 16;

/// A 3×3 convolution with transformed kernels.
#[derive(Clone, Debug)]
pub(crate) struct Winograd {
    /// Transformed kernels `[c_in, c_out]`, one matrix per tile element.
    kernels: Vec<PackedWeights>,
    c_in: usize,
    c_out: usize,
    /// Side of a tile's output square, 2 or 4. The input tile is two pixels wider.
    output_side: usize,
}

/// Working memory of a Winograd convolution.
#[derive(Clone, Debug, Default)]
pub(crate) struct WinogradScratch {
    /// Transformed input tiles `[tile elements, tiles · c_in + SET_CONFLICT_GAP]`.
    tiles: Vec<f32>,
    /// Products `[tile elements, tiles · c_out + SET_CONFLICT_GAP]`.
    products: Vec<f32>,
    /// Sums `[output_side², c_out]` of one tile.
    sums: Vec<f32>,
    /// Zeros `[c_in]`, which stand for pixels outside the image.
    zeros: Vec<f32>,
}

/// Defines [`Winograd::forward_baseline`] compiled for an instruction set.
macro_rules! forward_for {
    ($name:ident, $features:literal) => {
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = $features)]
        fn $name(
            &self,
            input: &[f32],
            shape: FeatureMapShape,
            rows: Range<usize>,
            scratch: &mut WinogradScratch,
            emit: impl FnMut(usize, usize, &[f32]),
        ) {
            self.forward_baseline(input, shape, rows, scratch, emit);
        }
    };
}

impl Winograd {
    /// Transforms the kernels `taps [3, 3, c_in, c_out]`, with the threads of the current rayon pool. Both
    /// channel counts must be multiples of [`LANES`].
    pub(crate) fn new(taps: &[f32], c_in: usize, c_out: usize) -> Self {
        let output_side = if c_in * c_out <= F4_MAX_CHANNEL_PRODUCT { 4 } else { 2 };
        Self::with_tile(taps, c_in, c_out, output_side)
    }

    fn with_tile(taps: &[f32], c_in: usize, c_out: usize, output_side: usize) -> Self {
        assert_eq!((c_in % LANES, c_out % LANES), (0, 0), "channels {c_in} and {c_out}");
        let g: &[[f64; 3]] = if output_side == 2 { &G_F2 } else { &G_F4 };
        let tile_side = g.len();
        let transform = |element: usize| {
            let (down, across) = (&g[element / tile_side], &g[element % tile_side]);
            let value = |idx: usize| {
                let tap = |row: usize, col: usize| f64::from(taps[(row * 3 + col) * c_in * c_out + idx]);
                let row_sum =
                    |row: usize| across.iter().enumerate().map(|(col, x)| x * tap(row, col)).sum::<f64>();
                down.iter().enumerate().map(|(row, x)| x * row_sum(row)).sum::<f64>() as f32
            };
            let values: Vec<f32> = (0..c_in * c_out).map(value).collect();
            PackedWeights::new(&values, c_in, c_out)
        };
        let kernels = (0..tile_side * tile_side).into_par_iter().map(transform).collect();
        Self { kernels, c_in, c_out, output_side }
    }

    /// Returns the number of output rows per row of tiles, the granularity at which work should be divided.
    pub(crate) fn output_side(&self) -> usize {
        self.output_side
    }

    /// Returns the size of the transformed kernels in memory.
    pub(crate) fn size_bytes(&self) -> usize {
        self.kernels.iter().map(PackedWeights::size_bytes).sum()
    }

    /// Returns the number of tiles in a block.
    fn block_tiles(&self) -> usize {
        let min_tiles = if self.output_side == 4 { MIN_TILES_F4 } else { MIN_TILES_F2 };
        (BLOCK_LEN / self.kernels.len() / (self.c_in + self.c_out)).max(min_tiles)
    }

    /// Grows `scratch` to what [`forward`](Self::forward) needs for inputs of this shape.
    pub(crate) fn reserve(&self, input: FeatureMapShape, scratch: &mut WinogradScratch) {
        let across = |side: usize| side.div_ceil(self.output_side);
        let n_tiles = self.block_tiles().min(input.batch * across(input.height) * across(input.width));
        let grow = |buffer: &mut Vec<f32>, len: usize| buffer.resize(buffer.len().max(len), 0.0);
        grow(&mut scratch.tiles, self.kernels.len() * (n_tiles * self.c_in + SET_CONFLICT_GAP));
        grow(&mut scratch.products, self.kernels.len() * (n_tiles * self.c_out + SET_CONFLICT_GAP));
        grow(&mut scratch.sums, self.output_side * self.output_side * self.c_out);
        grow(&mut scratch.zeros, self.c_in);
    }

    /// Convolves `input`, whose padding is one pixel wide, and calls `emit(row, col, sums [c_out])` for every
    /// pixel of these output rows. Row `image_idx · h + row` is row `row` of an image.
    ///
    /// The transforms use no fused multiply-add, so the vector width does not change a bit.
    pub(crate) fn forward(
        &self,
        input: &[f32],
        shape: FeatureMapShape,
        rows: Range<usize>,
        scratch: &mut WinogradScratch,
        emit: impl FnMut(usize, usize, &[f32]),
    ) {
        #[cfg(target_arch = "x86_64")]
        if let Some(_avx512) = V4::try_new() {
            // SAFETY: the token proves AVX-512.
            return unsafe { self.forward_avx512(input, shape, rows, scratch, emit) };
        }
        #[cfg(target_arch = "x86_64")]
        if let Some(_avx2) = V3::try_new() {
            // SAFETY: the token proves AVX2.
            return unsafe { self.forward_avx2(input, shape, rows, scratch, emit) };
        }
        self.forward_baseline(input, shape, rows, scratch, emit);
    }

    forward_for!(forward_avx2, "avx2");
    // Twice as many registers, which the transforms of F(4×4) fill.
    forward_for!(forward_avx512, "avx512f,avx512vl");

    #[inline(always)]
    fn forward_baseline(
        &self,
        input: &[f32],
        shape: FeatureMapShape,
        rows: Range<usize>,
        scratch: &mut WinogradScratch,
        emit: impl FnMut(usize, usize, &[f32]),
    ) {
        if self.output_side == 2 {
            self.forward_tiles::<2, 4>(input, shape, rows, scratch, emit);
        } else {
            self.forward_tiles::<4, 6>(input, shape, rows, scratch, emit);
        }
    }

    #[inline(always)]
    fn forward_tiles<const OUT: usize, const TILE: usize>(
        &self,
        input: &[f32],
        shape: FeatureMapShape,
        rows: Range<usize>,
        scratch: &mut WinogradScratch,
        mut emit: impl FnMut(usize, usize, &[f32]),
    ) {
        assert_eq!(shape.padding, 1, "input padding");
        let (down, across) = (shape.height.div_ceil(OUT), shape.width.div_ceil(OUT));
        // Rows of tiles, counted over all images, that contain the output rows.
        let tile_row = |row: usize| row / shape.height * down + row % shape.height / OUT;
        let tile_range = tile_row(rows.start) * across..(tile_row(rows.end - 1) + 1) * across;
        let position =
            |tile: usize| (tile / across / down, OUT * (tile / across % down), OUT * (tile % across));
        let WinogradScratch { tiles, products, sums, zeros } = scratch;
        let block_tiles = self.block_tiles();
        for first in tile_range.clone().step_by(block_tiles) {
            let n = block_tiles.min(tile_range.end - first);
            let (tile_stride, product_stride) =
                (n * self.c_in + SET_CONFLICT_GAP, n * self.c_out + SET_CONFLICT_GAP);
            for idx in 0..n {
                let (image_idx, row, col) = position(first + idx);
                let image = &input[image_idx * shape.image_len()..(image_idx + 1) * shape.image_len()];
                let pixels: [[&[ChannelLanes]; TILE]; TILE] = std::array::from_fn(|down| {
                    std::array::from_fn(|right| {
                        let (row, col) = (row + down, col + right);
                        let inside = row < shape.padded_height() && col < shape.padded_width();
                        let start = (row * shape.padded_width() + col) * self.c_in;
                        let pixel = if inside { &image[start..] } else { &zeros[..] };
                        pixel[..self.c_in].as_chunks().0
                    })
                });
                let out = tiles.as_chunks_mut().0;
                input_transform(&pixels, out, tile_stride / LANES, idx * self.c_in / LANES);
            }
            let elements = tiles.chunks_exact(tile_stride).zip(products.chunks_exact_mut(product_stride));
            for (kernel, (tiles, products)) in self.kernels.iter().zip(elements) {
                let (tiles, products) = (&tiles[..n * self.c_in], &mut products[..n * self.c_out]);
                kernel.matmul(tiles, self.c_in, products, Accum::Replace);
            }
            let sums = &mut sums[..OUT * OUT * self.c_out];
            for idx in 0..n {
                let (image_idx, row, col) = position(first + idx);
                let at = idx * self.c_out / LANES;
                output_transform::<OUT, TILE>(
                    products.as_chunks().0,
                    product_stride / LANES,
                    at,
                    sums.as_chunks_mut().0,
                );
                for (part, sums) in sums.chunks_exact(self.c_out).enumerate() {
                    let (row, col) = (row + part / OUT, col + part % OUT);
                    let out_row = image_idx * shape.height + row;
                    if row < shape.height && col < shape.width && rows.contains(&out_row) {
                        emit(out_row, col, sums);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pseudo_random(n: usize, salt: usize) -> Vec<f32> {
        (0..n).map(|i| ((i * 7919 + salt * 104_729) % 2003) as f32 / 1001.0 - 1.0).collect()
    }

    /// Computes one output value by the definition of convolution, in f64.
    fn sum(
        input: &[f32],
        shape: FeatureMapShape,
        taps: &[f32],
        c_out: usize,
        (out_row, col, out_idx): (usize, usize, usize),
    ) -> f64 {
        let c_in = shape.channels;
        let (image_idx, row) = (out_row / shape.height, out_row % shape.height);
        let terms = (0..9).map(|tap| {
            let first = image_idx * shape.image_len()
                + ((row + tap / 3) * shape.padded_width() + col + tap % 3) * c_in;
            let products = (0..c_in).map(|in_idx| {
                let weight = f64::from(taps[(tap * c_in + in_idx) * c_out + out_idx]);
                f64::from(input[first + in_idx]) * weight
            });
            products.sum::<f64>()
        });
        terms.sum()
    }

    #[test]
    fn both_tile_sizes_agree_with_the_definition() {
        let shapes = [(7, 7, 3, 8, 16), (14, 10, 1, 16, 8), (5, 9, 2, 72, 8), (56, 56, 1, 8, 64)];
        for (height, width, batch, c_in, c_out) in shapes {
            let shape = FeatureMapShape { batch, height, width, channels: c_in, padding: 1 };
            let mut input = pseudo_random(shape.len(), 1);
            shape.clear_padding(&mut input);
            let taps = pseudo_random(9 * c_in * c_out, 2);
            for (output_side, tolerance) in [(2, 1e-5), (4, 5e-5)] {
                let winograd = Winograd::with_tile(&taps, c_in, c_out, output_side);
                let mut scratch = WinogradScratch::default();
                winograd.reserve(shape, &mut scratch);
                let mut n_emitted = 0;
                winograd.forward(&input, shape, 0..batch * height, &mut scratch, |row, col, sums| {
                    n_emitted += 1;
                    for (out_idx, &found) in sums.iter().enumerate() {
                        let expected = sum(&input, shape, &taps, c_out, (row, col, out_idx));
                        let error = (f64::from(found) - expected).abs();
                        assert!(
                            error < tolerance,
                            "{shape:?} at {row} {col} {out_idx}: {found} for {expected}"
                        );
                    }
                });
                assert_eq!(n_emitted, batch * height * width, "{shape:?}");
            }
        }
    }

    #[test]
    fn bands_of_rows_are_bit_identical_to_whole() {
        let shape = FeatureMapShape { batch: 2, height: 14, width: 14, channels: 8, padding: 1 };
        let mut input = pseudo_random(shape.len(), 1);
        shape.clear_padding(&mut input);
        for output_side in [2, 4] {
            let winograd = Winograd::with_tile(&pseudo_random(9 * 64, 2), 8, 8, output_side);
            let mut scratch = WinogradScratch::default();
            winograd.reserve(shape, &mut scratch);
            let mut sums_of = |rows: Range<usize>| {
                let mut emitted = std::collections::BTreeMap::new();
                winograd.forward(&input, shape, rows, &mut scratch, |row, col, sums| {
                    assert_eq!(emitted.insert((row, col), sums.to_vec()), None, "emitted once");
                });
                emitted
            };
            let whole = sums_of(0..28);
            for (start, end) in [(0, 8), (3, 17), (8, 28), (27, 28)] {
                let band = sums_of(start..end);
                assert_eq!(band.len(), (end - start) * 14);
                assert!(band.iter().all(|(pixel, sums)| whole[pixel] == *sums));
            }
        }
    }
}
