//! Products in eight-bit integers: faster than floats where a processor has instructions for them, and less exact.
//!
//! Weights are rounded to 127 steps on either side of zero, each column's steps as fine as its largest weight lets them be;
//! inputs likewise when they are multiplied, each row or map by its own largest number. Sums of integers are exact, so every
//! processor gives the same bits. Those with AVX-512 VNNI make 64 products at a time; others are slower than with floats.

use bytemuck::{Pod, Zeroable};

use super::wide::wide;

/// Columns of a panel: four registers of AVX-512.
const PANEL: usize = 64;
/// Rows of a tile: with a panel's four registers they fill 24 of AVX-512's 32.
const TILE_ROWS: usize = 6;
/// Products that one lane sums at a time: the depth comes in multiples of it.
pub(super) const QUAD: usize = 4;
/// Steps from zero to the largest weight or signed input, and to the largest input that cannot be negative.
const SIGNED_STEPS: f32 = 127.0;
const POSITIVE_STEPS: f32 = 255.0;
/// What a signed input's zero is stored as.
const ZERO: u8 = 128;
/// From here on floats are whole numbers: adding it rounds to the nearest one, which is then in the lowest bits.
const WHOLE: f32 = 8_388_608.0;

/// Weights of a cache line.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([i8; 64]);

/// Weights `[depth, width]`, rounded and packed.
#[derive(Clone, Debug)]
pub(super) struct QuantisedMatrix {
    /// `[⌈width / PANEL⌉, depth / QUAD, PANEL, QUAD]`, zero beyond the last column.
    panels: Vec<Line>,
    depth: usize,
    width: usize,
    /// `[width]`: what a step of a column's weights is worth.
    steps: Vec<f32>,
    /// `[width]`: the sum of a column times [`ZERO`], which signed inputs add to every sum.
    zeros: Vec<i32>,
    isa: Isa,
}

/// The numbers that a row of a product is made of: so many runs of equal length, their beginnings `stride` apart.
#[derive(Clone, Copy, Debug)]
pub(super) struct Runs {
    pub(super) count: usize,
    pub(super) len: usize,
    pub(super) stride: usize,
}

impl QuantisedMatrix {
    /// Rounds and packs row-major weights.
    ///
    /// # Panics
    /// If `rows` is not `[depth, width]`, or the depth is no multiple of [`QUAD`].
    pub(super) fn new(rows: &[f32], depth: usize, width: usize) -> Self {
        Self::with_isa(rows, depth, width, Isa::best())
    }

    fn with_isa(rows: &[f32], depth: usize, width: usize, isa: Isa) -> Self {
        assert_eq!(rows.len(), depth * width, "weights [{depth}, {width}]");
        assert!(depth.is_multiple_of(QUAD), "depth {depth}");
        let mut panels = vec![Line::zeroed(); width.div_ceil(PANEL) * depth];
        let packed: &mut [i8] = bytemuck::cast_slice_mut(&mut panels);
        let (mut steps, mut zeros) = (Vec::with_capacity(width), Vec::with_capacity(width));
        for col in 0..width {
            let column = || rows.iter().skip(col).step_by(width);
            let step = column().fold(0.0, |most: f32, x| most.max(x.abs())) / SIGNED_STEPS;
            let panel = &mut packed[col / PANEL * depth * PANEL..][..depth * PANEL];
            let mut sum = 0;
            for (idx, x) in column().enumerate() {
                let rounded = if step > 0.0 { (x / step).round() as i8 } else { 0 };
                panel[(idx / QUAD * PANEL + col % PANEL) * QUAD + idx % QUAD] = rounded;
                sum += i32::from(rounded);
            }
            steps.push(step);
            zeros.push(i32::from(ZERO) * sum);
        }
        Self { panels, depth, width, steps, zeros, isa }
    }

    pub(super) fn depth(&self) -> usize {
        self.depth
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// `[width]`: what a step of a column's weights is worth.
    pub(super) fn steps(&self) -> &[f32] {
        &self.steps
    }

    /// `[width]`: how much too large the sums of signed inputs are.
    pub(super) fn zeros(&self) -> &[i32] {
        &self.zeros
    }

    /// Multiplies `n_rows` rows of rounded numbers, row `idx` beginning at `start(idx)` in `numbers`, and hands the sums to
    /// `take(idx, first column, sums)`, some columns at a time.
    ///
    /// # Panics
    /// If the runs are not as long as the weights are deep, or a row would end outside `numbers`.
    pub(super) fn run(
        &self,
        numbers: &[u8],
        runs: Runs,
        n_rows: usize,
        start: impl Fn(usize) -> usize,
        take: impl FnMut(usize, usize, &[i32]),
    ) {
        assert_eq!(runs.count * runs.len, self.depth, "{runs:?}");
        assert!(runs.len.is_multiple_of(QUAD), "{runs:?}");
        match self.isa {
            Isa::Plain => self.by_tiles(numbers, runs, n_rows, start, take, &TILES_PLAIN),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the processor has these instructions.
            Isa::Vnni => unsafe { self.by_tiles_vnni(numbers, runs, n_rows, start, take) },
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vnni")]
    fn by_tiles_vnni(
        &self,
        numbers: &[u8],
        runs: Runs,
        n_rows: usize,
        start: impl Fn(usize) -> usize,
        take: impl FnMut(usize, usize, &[i32]),
    ) {
        self.by_tiles(numbers, runs, n_rows, start, take, &TILES_VNNI);
    }

    #[inline(always)]
    fn by_tiles(
        &self,
        numbers: &[u8],
        runs: Runs,
        n_rows: usize,
        start: impl Fn(usize) -> usize,
        mut take: impl FnMut(usize, usize, &[i32]),
        tiles: &[Tile; TILE_ROWS],
    ) {
        let reach = (runs.count - 1) * runs.stride + runs.len;
        let packed: &[i8] = bytemuck::cast_slice(&self.panels);
        let mut sums = [0; TILE_ROWS * PANEL];
        for (panel_idx, panel) in packed.chunks_exact(self.depth * PANEL).enumerate() {
            let first = panel_idx * PANEL;
            let n_cols = PANEL.min(self.width - first);
            for row in (0..n_rows).step_by(TILE_ROWS) {
                let height = TILE_ROWS.min(n_rows - row);
                let mut rows: [&[u8]; TILE_ROWS] = [&[]; TILE_ROWS];
                for (idx, own) in rows[..height].iter_mut().enumerate() {
                    *own = &numbers[start(row + idx)..][..reach];
                }
                // SAFETY: the first `height` rows reach as far as the runs do, the panel is as deep as they are long, and
                // `run` chose tiles that this processor has.
                unsafe { tiles[height - 1](&rows, runs, panel, &mut sums) };
                for (idx, sums) in sums.chunks_exact(PANEL).take(height).enumerate() {
                    take(row + idx, first, &sums[..n_cols]);
                }
            }
        }
    }
}

wide! {
    /// Rounds numbers that are not negative to 0 to 255; `step` becomes what a step is worth, and is not finite if one of the
    /// numbers is not.
    pub(super) fn quantise_positive(numbers: &[f32], out: &mut [u8], step: &mut f32) {
        *step = round(numbers, POSITIVE_STEPS, WHOLE, out);
    }

    /// Rounds numbers to 127 steps on either side of [`ZERO`]; `step` as above.
    pub(super) fn quantise(numbers: &[f32], out: &mut [u8], step: &mut f32) {
        *step = round(numbers, SIGNED_STEPS, WHOLE + f32::from(ZERO), out);
    }
}

/// What a step is worth, and each number's steps from `zero`.
#[inline(always)]
fn round(numbers: &[f32], n_steps: f32, zero: f32, out: &mut [u8]) -> f32 {
    assert_eq!(numbers.len(), out.len(), "rounded numbers");
    let magnitude = |x: &f32| x.to_bits() & 0x7fff_ffff;
    // As integers, magnitudes are in the same order as floats are, and what is not a number is above all.
    let most = f32::from_bits(numbers.iter().fold(0, |most, x| most.max(magnitude(x))));
    let per_step = if most > 0.0 { n_steps / most } else { 0.0 };
    for (out, x) in out.iter_mut().zip(numbers) {
        *out = (x * per_step + zero).to_bits() as u8;
    }
    most / n_steps
}

/// Which instructions multiply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Isa {
    /// Those of any processor.
    Plain,
    /// AVX-512 VNNI.
    #[cfg(target_arch = "x86_64")]
    Vnni,
}

impl Isa {
    fn available() -> Vec<Self> {
        let mut available = vec![Self::Plain];
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vnni") {
            available.push(Self::Vnni);
        }
        available
    }

    fn best() -> Self {
        Self::available().last().copied().unwrap_or(Self::Plain)
    }
}

type Sums = [i32; TILE_ROWS * PANEL];

/// `sums [height, PANEL]` of the first `height` rows times a panel.
///
/// # Safety
/// The processor must have the tile's instructions, those rows must reach to the end of the last run, and the panel must be
/// as deep as all runs together.
type Tile = unsafe fn(rows: &[&[u8]; TILE_ROWS], runs: Runs, panel: &[i8], sums: &mut Sums);

/// Tiles of one row, two rows, and so on.
const TILES_PLAIN: [Tile; TILE_ROWS] =
    [tile_plain::<1>, tile_plain::<2>, tile_plain::<3>, tile_plain::<4>, tile_plain::<5>, tile_plain::<6>];
#[cfg(target_arch = "x86_64")]
const TILES_VNNI: [Tile; TILE_ROWS] =
    [tile_vnni::<1>, tile_vnni::<2>, tile_vnni::<3>, tile_vnni::<4>, tile_vnni::<5>, tile_vnni::<6>];

fn tile_plain<const HEIGHT: usize>(rows: &[&[u8]; TILE_ROWS], runs: Runs, panel: &[i8], sums: &mut Sums) {
    for (row, sums) in rows[..HEIGHT].iter().zip(sums.chunks_exact_mut(PANEL)) {
        sums.fill(0);
        let mut lines = panel.chunks_exact(PANEL * QUAD);
        for run in 0..runs.count {
            let numbers = row[run * runs.stride..][..runs.len].as_chunks::<QUAD>().0;
            for (numbers, line) in numbers.iter().zip(&mut lines) {
                for (sum, weights) in sums.iter_mut().zip(line.as_chunks::<QUAD>().0) {
                    let products = numbers.iter().zip(weights).map(|(&x, &w)| i32::from(x) * i32::from(w));
                    *sum += products.sum::<i32>();
                }
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vnni")]
unsafe fn tile_vnni<const HEIGHT: usize>(
    rows: &[&[u8]; TILE_ROWS],
    runs: Runs,
    panel: &[i8],
    out: &mut Sums,
) {
    use core::arch::x86_64::{
        _mm512_dpbusd_epi32, _mm512_loadu_si512, _mm512_set1_epi32, _mm512_setzero_si512, _mm512_storeu_si512,
    };
    const ACROSS: usize = PANEL / 16;
    let mut sums = [[_mm512_setzero_si512(); ACROSS]; HEIGHT];
    let mut weights = panel.as_ptr();
    for run in 0..runs.count {
        let first = run * runs.stride;
        for idx in (first..first + runs.len).step_by(QUAD) {
            // SAFETY: the caller vouches for `HEIGHT` rows that reach to the end of the last run, and for a line of weights
            // for each four numbers.
            unsafe {
                let mut line = [_mm512_setzero_si512(); ACROSS];
                for (col, line) in line.iter_mut().enumerate() {
                    *line = _mm512_loadu_si512(weights.add(col * 64).cast());
                }
                weights = weights.add(PANEL * QUAD);
                for (row, sums) in rows.iter().zip(&mut sums) {
                    let x = _mm512_set1_epi32(row.as_ptr().add(idx).cast::<i32>().read_unaligned());
                    for (sum, weights) in sums.iter_mut().zip(line) {
                        *sum = _mm512_dpbusd_epi32(*sum, x, weights);
                    }
                }
            }
        }
    }
    for (sums, out) in sums.iter().zip(out.chunks_exact_mut(PANEL)) {
        for (sum, out) in sums.iter().zip(out.chunks_exact_mut(16)) {
            // SAFETY: `out` is sixteen numbers.
            unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), *sum) };
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
    fn every_instruction_set_gives_the_exact_integer_sums() {
        for (n_rows, width, count, len, stride) in
            [(1, 1, 1, 4, 0), (5, 7, 3, 12, 20), (13, 130, 2, 64, 100), (50, 64, 1, 516, 0)]
        {
            let depth = count * len;
            let weights = numbers(depth * width, 2);
            let bytes: Vec<u8> = (0..(n_rows - 1) * 8 + (count - 1) * stride + len)
                .map(|i| if i % 5 == 0 { 255 } else { (i * 37 % 256) as u8 })
                .collect();
            for isa in Isa::available() {
                let matrix = QuantisedMatrix::with_isa(&weights, depth, width, isa);
                let mut n_taken = 0;
                matrix.run(
                    &bytes,
                    Runs { count, len, stride },
                    n_rows,
                    |row| row * 8,
                    |row, first, sums| {
                        for (col, &found) in (first..).zip(sums) {
                            let of_run = |idx: usize| idx / len * stride + idx % len;
                            let expected: f64 = (0..depth)
                                .map(|idx| {
                                    let weight = (weights[idx * width + col] / matrix.steps()[col]).round();
                                    f64::from(bytes[row * 8 + of_run(idx)]) * f64::from(weight)
                                })
                                .sum();
                            assert_eq!(f64::from(found), expected, "{isa:?} row {row} column {col}");
                            n_taken += 1;
                        }
                    },
                );
                assert_eq!(n_taken, n_rows * width, "{isa:?}");
            }
        }
    }

    #[test]
    fn numbers_are_rounded_to_the_nearest_step() {
        let (mut out, mut step) = ([0; 5], 0.0);
        quantise(&[-2.54, -0.011, 0.0, 0.009, 1.0], &mut out, &mut step);
        assert_eq!((out, step), ([1, 127, 128, 128, 178], 0.02));
        quantise_positive(&[0.0, 0.6, 1.4, 255.0, 128.0], &mut out, &mut step);
        assert_eq!((out, step), ([0, 1, 1, 255, 128], 1.0));
        quantise(&[0.0; 5], &mut out, &mut step);
        assert_eq!((out, step), ([ZERO; 5], 0.0));
    }

    #[test]
    fn what_is_not_finite_is_not_lost() {
        let (mut out, mut step) = ([0; 3], 0.0);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            quantise(&[1.0, bad, -2.0], &mut out, &mut step);
            assert!(!step.is_finite());
        }
    }
}
