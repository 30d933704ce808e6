//! Products with a matrix of weights that was laid out for them beforehand.
//!
//! faer packs its factors anew in every call, which suits a product that is made once. Weights are the same in every
//! query, so here they lie in panels of [`PANEL`] columns, read front to back by the tiles below. (Measured against faer 0.24
//! in one run, AVX-512: 1.2 to 1.5 times as fast at ACT's shapes; `cargo bench -p benches --bench policy`.)
//!
//! Every number of a product is one chain of fused multiply-adds over the depth, in order, whatever the instruction set,
//! the tile or the number of rows: the same bits on every x86 processor with FMA. Others round products, too.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use super::matmul::Into;

/// Columns of a panel: four registers of AVX-512.
const PANEL: usize = 64;
/// Rows of a tile: with a panel's four registers they fill 24 of AVX-512's 32.
const TILE_ROWS: usize = 6;
/// Depth of a block, so that its part of a panel stays in the cache while all rows pass by.
const BLOCK_DEPTH: usize = 256;

/// Numbers of one register, aligned so that no load straddles two cache lines.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([f32; 16]);

/// Weights `[depth, width] f32`, packed.
#[derive(Clone, Debug)]
pub struct Packed {
    /// `[⌈width / PANEL⌉, depth, PANEL]`, zero beyond the last column.
    panels: Vec<Line>,
    depth: usize,
    width: usize,
    isa: Isa,
}

impl Packed {
    /// Packs row-major weights.
    ///
    /// # Panics
    /// If `rows` is not `[depth, width]`.
    #[must_use]
    pub fn new(rows: &[f32], depth: usize, width: usize) -> Self {
        Self::with_isa(rows, depth, width, Isa::best())
    }

    fn with_isa(rows: &[f32], depth: usize, width: usize, isa: Isa) -> Self {
        assert_eq!(rows.len(), depth * width, "weights [{depth}, {width}]");
        let n_panels = width.div_ceil(PANEL);
        let mut panels = vec![Line::zeroed(); n_panels * depth * PANEL / 16];
        let numbers: &mut [f32] = bytemuck::cast_slice_mut(&mut panels);
        for (panel_idx, panel) in numbers.chunks_exact_mut(depth * PANEL).enumerate() {
            let first = panel_idx * PANEL;
            let n = PANEL.min(width - first);
            for (line, row) in panel.chunks_exact_mut(PANEL).zip(rows.chunks_exact(width)) {
                line[..n].copy_from_slice(&row[first..first + n]);
            }
        }
        Self { panels, depth, width, isa }
    }

    /// Rows of the weights, which is the length of an input's row.
    #[must_use]
    pub fn depth(&self) -> usize {
        self.depth
    }

    /// Columns of the weights, which is the length of an output's row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// `out [T, width] = x [T, depth] · weights`, or `out += x · weights`. Rows of `x` lie `stride` numbers apart and may
    /// overlap.
    ///
    /// # Panics
    /// If `out` is not whole rows, or the last row of `x` would end outside it.
    pub fn run(&self, x: &[f32], stride: usize, out: &mut [f32], into: Into) {
        self.run_part(0..self.depth, x, stride, out, into);
    }

    /// As [`run`](Self::run) with only the given rows of the weights, rows of `x` being as long.
    ///
    /// # Panics
    /// If there are not so many weights, `out` is not whole rows, or the last row of `x` would end outside it.
    pub fn run_part(&self, part: Range<usize>, x: &[f32], stride: usize, out: &mut [f32], into: Into) {
        let n_rows = out.len() / self.width;
        assert_eq!(out.len(), n_rows * self.width, "rows of {} numbers", self.width);
        assert!(part.end <= self.depth, "weights {part:?} of {}", self.depth);
        if n_rows == 0 {
            return;
        }
        assert!((n_rows - 1) * stride + part.len() <= x.len(), "{n_rows} rows of {} numbers", part.len());
        match self.isa {
            Isa::Plain => self.by_rows(part, x, stride, out, into),
            #[cfg(target_arch = "x86_64")]
            Isa::Fma256 => self.by_tiles(part, x, stride, out, into, &tiles_256()),
            #[cfg(target_arch = "x86_64")]
            Isa::Fma512 => self.by_tiles(part, x, stride, out, into, &tiles_512()),
        }
    }

    fn panels(&self) -> impl Iterator<Item = (usize, &[f32])> {
        let numbers: &[f32] = bytemuck::cast_slice(&self.panels);
        numbers.chunks_exact(self.depth * PANEL).enumerate().map(|(idx, panel)| (idx * PANEL, panel))
    }

    /// A row at a time, so that no number depends on the rows beside it.
    fn by_rows(&self, part: Range<usize>, x: &[f32], stride: usize, out: &mut [f32], into: Into) {
        for (row, out) in out.chunks_exact_mut(self.width).enumerate() {
            let x = &x[row * stride..][..part.len()];
            for (first, panel) in self.panels() {
                let out = &mut out[first..self.width.min(first + PANEL)];
                let mut sums = [0.0; PANEL];
                if into == Into::Add {
                    sums[..out.len()].copy_from_slice(out);
                }
                let weights = panel[part.start * PANEL..part.end * PANEL].as_chunks::<PANEL>().0;
                for (x, weights) in x.iter().zip(weights) {
                    sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += x * weight);
                }
                out.copy_from_slice(&sums[..out.len()]);
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn by_tiles(
        &self,
        part: Range<usize>,
        x: &[f32],
        stride: usize,
        out: &mut [f32],
        into: Into,
        tiles: &[Tile; TILE_ROWS],
    ) {
        let n_rows = out.len() / self.width;
        for first_depth in (0..part.len()).step_by(BLOCK_DEPTH) {
            let depth = BLOCK_DEPTH.min(part.len() - first_depth);
            let adds = first_depth > 0 || into == Into::Add;
            for (first, panel) in self.panels() {
                let weights = &panel[(part.start + first_depth) * PANEL..][..depth * PANEL];
                let n = PANEL.min(self.width - first);
                for row in (0..n_rows).step_by(TILE_ROWS) {
                    let height = TILE_ROWS.min(n_rows - row);
                    let x = &x[row * stride + first_depth..][..(height - 1) * stride + depth];
                    let out = &mut out[row * self.width + first..][..(height - 1) * self.width + n];
                    let tile = tiles[height - 1];
                    if n == PANEL {
                        // SAFETY: the slices just cut hold what a tile of `height` rows touches, and `run` chose tiles
                        // that this processor has.
                        unsafe { tile(x, stride, weights, out, self.width, adds) };
                    } else {
                        let mut whole = [0.0; TILE_ROWS * PANEL];
                        let rows = whole.chunks_exact_mut(PANEL).zip(out.chunks(self.width));
                        rows.for_each(|(whole, out)| whole[..n].copy_from_slice(&out[..n]));
                        let part = &mut whole[..height * PANEL];
                        // SAFETY: as above; `part` is `height` rows of a whole panel.
                        unsafe { tile(x, stride, weights, part, PANEL, adds) };
                        let rows = whole.chunks_exact(PANEL).zip(out.chunks_mut(self.width));
                        rows.for_each(|(whole, out)| out[..n].copy_from_slice(&whole[..n]));
                    }
                }
            }
        }
    }
}

/// How a processor multiplies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Isa {
    /// As any processor can.
    Plain,
    /// AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    Fma256,
    /// AVX-512.
    #[cfg(target_arch = "x86_64")]
    Fma512,
}

impl Isa {
    /// Those that this processor has, the slowest first.
    fn available() -> Vec<Self> {
        let mut available = vec![Self::Plain];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                available.push(Self::Fma256);
            }
            if is_x86_feature_detected!("avx512f") {
                available.push(Self::Fma512);
            }
        }
        available
    }

    fn best() -> Self {
        Self::available().last().copied().unwrap_or(Self::Plain)
    }
}

/// `out [height, PANEL] = (out if adds, else 0) + x [height, depth] · weights [depth, PANEL]`, rows `stride` apart in `x`
/// and `out_stride` in `out`.
///
/// # Safety
/// The processor must have the tile's instruction set, and the slices all of those numbers.
#[cfg(target_arch = "x86_64")]
type Tile =
    unsafe fn(x: &[f32], stride: usize, weights: &[f32], out: &mut [f32], out_stride: usize, adds: bool);

/// Tiles of one row, two rows, and so on.
#[cfg(target_arch = "x86_64")]
const fn tiles_512() -> [Tile; TILE_ROWS] {
    [tile_512::<1>, tile_512::<2>, tile_512::<3>, tile_512::<4>, tile_512::<5>, tile_512::<6>]
}

/// Tiles of one row, two rows, and so on.
#[cfg(target_arch = "x86_64")]
const fn tiles_256() -> [Tile; TILE_ROWS] {
    [tile_256::<1>, tile_256::<2>, tile_256::<3>, tile_256::<4>, tile_256::<5>, tile_256::<6>]
}

/// One tile's function: registers of so many lanes, so many of them side by side for each row.
macro_rules! tile {
    ($name:ident, $features:literal, $lanes:literal, $across:literal, $zero:ident, $load:ident, $all:ident, $fma:ident, $store:ident) => {
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = $features)]
        unsafe fn $name<const HEIGHT: usize>(
            x: &[f32],
            stride: usize,
            weights: &[f32],
            out: &mut [f32],
            out_stride: usize,
            adds: bool,
        ) {
            use core::arch::x86_64::{$all, $fma, $load, $store, $zero};
            let x = x.as_ptr();
            for first in (0..PANEL).step_by($across * $lanes) {
                // SAFETY: the caller vouches for `HEIGHT` rows of `depth` numbers in `x` and of `PANEL` numbers in `out`.
                unsafe {
                    let out = out.as_mut_ptr().add(first);
                    let mut sums = [[$zero(); $across]; HEIGHT];
                    if adds {
                        for (row, sums) in sums.iter_mut().enumerate() {
                            for (col, sum) in sums.iter_mut().enumerate() {
                                *sum = $load(out.add(row * out_stride + col * $lanes));
                            }
                        }
                    }
                    for (step, from) in weights.chunks_exact(PANEL).enumerate() {
                        let mut line = [$zero(); $across];
                        for (col, weights) in line.iter_mut().enumerate() {
                            *weights = $load(from.as_ptr().add(first + col * $lanes));
                        }
                        for (row, sums) in sums.iter_mut().enumerate() {
                            let x = $all(*x.add(row * stride + step));
                            for (sum, weights) in sums.iter_mut().zip(line) {
                                *sum = $fma(x, weights, *sum);
                            }
                        }
                    }
                    for (row, sums) in sums.iter().enumerate() {
                        for (col, sum) in sums.iter().enumerate() {
                            $store(out.add(row * out_stride + col * $lanes), *sum);
                        }
                    }
                }
            }
        }
    };
}

#[rustfmt::skip]
tile!(tile_512, "avx512f", 16, 4, _mm512_setzero_ps, _mm512_loadu_ps, _mm512_set1_ps, _mm512_fmadd_ps, _mm512_storeu_ps);
// With six rows these fill twelve of AVX2's sixteen registers.
#[rustfmt::skip]
tile!(tile_256, "avx2,fma", 8, 2, _mm256_setzero_ps, _mm256_loadu_ps, _mm256_set1_ps, _mm256_fmadd_ps, _mm256_storeu_ps);

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(n: usize, salt: usize) -> Vec<f32> {
        (0..n).map(|i| ((i * 7919 + salt * 104_729) % 2003) as f32 / 1001.0 - 1.0).collect()
    }

    /// Products of every shape that can go wrong: narrow, wide, ragged, shallow, deeper than a block, rows overlapping.
    const SHAPES: [(usize, usize, usize); 6] =
        [(1, 1, 1), (5, 7, 3), (6, 64, 256), (13, 130, 300), (50, 200, 513), (7, 16, 64)];

    fn product(
        isa: Isa,
        (n_rows, width, depth): (usize, usize, usize),
        into: Into,
        stride: usize,
    ) -> Vec<f32> {
        let x = numbers((n_rows - 1) * stride + depth, 1);
        let mut out = numbers(n_rows * width, 3);
        Packed::with_isa(&numbers(depth * width, 2), depth, width, isa).run(&x, stride, &mut out, into);
        out
    }

    #[test]
    fn every_instruction_set_gives_the_exact_chain_of_fused_additions() {
        for shape in SHAPES {
            let (n_rows, width, depth) = shape;
            for (into, stride) in
                [(Into::Replace, depth), (Into::Add, depth + 5), (Into::Replace, depth.div_ceil(3))]
            {
                let x = numbers((n_rows - 1) * stride + depth, 1);
                let (weights, before) = (numbers(depth * width, 2), numbers(n_rows * width, 3));
                let chain = |i: usize| {
                    let first = if into == Into::Add { before[i] } else { 0.0 };
                    let row = &x[i / width * stride..][..depth];
                    row.iter()
                        .enumerate()
                        .fold(first, |sum, (k, x)| x.mul_add(weights[k * width + i % width], sum))
                };
                let expected: Vec<f32> = (0..n_rows * width).map(chain).collect();
                for isa in Isa::available() {
                    let found = product(isa, shape, into, stride);
                    if isa == Isa::Plain {
                        let error =
                            found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                        assert!(error < 1e-4, "{isa:?} {shape:?} {into:?}: off by {error}");
                    } else {
                        assert!(found == expected, "{isa:?} {shape:?} {into:?} stride {stride}");
                    }
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "2 rows of 8 numbers")]
    fn an_input_too_short_is_refused() {
        Packed::new(&[0.0; 16], 8, 2).run(&[0.0; 15], 8, &mut [0.0; 4], Into::Replace);
    }
}
