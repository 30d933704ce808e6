//! Affine layers: `y = x · W + b`.

use super::Precision;
use super::matmul::Into;
use super::packed::Packed;
use super::quantised::{QUAD, QuantisedMatrix, Runs, quantise};

/// Numbers of rows that are rounded together.
const ROUNDED_LEN: usize = 48 << 10;
/// Rows that are rounded together come in multiples of this, a tile's.
const ROUNDED_ROWS: usize = 6;
/// Most rows that are rounded together.
const MOST_ROUNDED_ROWS: usize = 96;
/// Fewest columns of a layer whose weights are rounded: others are soon multiplied.
const FEWEST_ROUNDED: usize = 32;

/// A linear layer.
#[derive(Clone, Debug)]
pub struct Linear {
    matrix: Matrix,
    bias: Vec<f32>,
}

/// `[n_in, n_out]`.
#[derive(Clone, Debug)]
enum Matrix {
    Exact(Packed),
    Quantised(QuantisedMatrix),
}

impl Linear {
    /// From a checkpoint's `weight [n_out, n_in]` and `bias [n_out]`.
    ///
    /// # Panics
    /// If the lengths do not fit.
    #[must_use]
    pub fn new(weight: &[f32], bias: &[f32]) -> Self {
        Self::with_precision(weight, bias, Precision::F32)
    }

    /// As [`new`](Self::new), with the weights kept as told.
    ///
    /// # Panics
    /// If the lengths do not fit.
    #[must_use]
    pub fn with_precision(weight: &[f32], bias: &[f32], precision: Precision) -> Self {
        let n_out = bias.len();
        let n_in = weight.len() / n_out;
        assert_eq!(weight.len(), n_in * n_out, "a [{n_out}, {n_in}] matrix");
        let mut matrix = vec![0.0; weight.len()];
        for (out_idx, row) in weight.chunks_exact(n_in).enumerate() {
            for (in_idx, &x) in row.iter().enumerate() {
                matrix[in_idx * n_out + out_idx] = x;
            }
        }
        let is_rounded = precision == Precision::Int8
            && n_out >= FEWEST_ROUNDED
            && n_in.is_multiple_of(QUAD)
            && n_in <= ROUNDED_LEN / ROUNDED_ROWS;
        let matrix = if is_rounded {
            Matrix::Quantised(QuantisedMatrix::new(&matrix, n_in, n_out))
        } else {
            Matrix::Exact(Packed::new(&matrix, n_in, n_out))
        };
        Self { matrix, bias: bias.to_vec() }
    }

    /// Width of the input.
    #[must_use]
    pub fn n_in(&self) -> usize {
        match &self.matrix {
            Matrix::Exact(matrix) => matrix.depth(),
            Matrix::Quantised(matrix) => matrix.depth(),
        }
    }

    /// Width of the output.
    #[must_use]
    pub fn n_out(&self) -> usize {
        self.bias.len()
    }

    /// `out [T, n_out] = x [T, n_in] · W + b`.
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn run(&self, x: &[f32], out: &mut [f32]) {
        out.chunks_exact_mut(self.n_out()).for_each(|row| row.copy_from_slice(&self.bias));
        self.accumulate(x, out);
    }

    /// `out [T, n_out] += x [T, n_in] · W + b`.
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn add_to(&self, x: &[f32], out: &mut [f32]) {
        self.add_bias(out);
        self.accumulate(x, out);
    }

    /// `out [T, n_out] += x · W + b` for an input whose columns lie apart in blocks of equal width, block `i` as rows
    /// `[T, n_in / n_blocks]` at `block(i)`: the heads of an attention. The sums are those of [`add_to`](Self::add_to).
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn add_blocks_to<'a>(&self, n_blocks: usize, block: impl Fn(usize) -> &'a [f32], out: &mut [f32]) {
        let width = self.n_in() / n_blocks;
        assert_eq!(self.n_in(), n_blocks * width, "blocks of equal width");
        self.add_bias(out);
        match &self.matrix {
            Matrix::Exact(matrix) => (0..n_blocks).for_each(|idx| {
                matrix.run_part(idx * width..(idx + 1) * width, block(idx), width, out, Into::Add);
            }),
            Matrix::Quantised(matrix) => add_rounded(matrix, out, |row, whole| {
                for (idx, part) in whole.chunks_exact_mut(width).enumerate() {
                    part.copy_from_slice(&block(idx)[row * width..][..width]);
                }
            }),
        }
    }

    fn add_bias(&self, out: &mut [f32]) {
        for row in out.chunks_exact_mut(self.n_out()) {
            row.iter_mut().zip(&self.bias).for_each(|(y, b)| *y += b);
        }
    }

    fn accumulate(&self, x: &[f32], out: &mut [f32]) {
        let (n_in, n_out) = (self.n_in(), self.n_out());
        let n_rows = x.len() / n_in;
        assert_eq!((x.len(), out.len()), (n_rows * n_in, n_rows * n_out), "rows of a linear layer");
        match &self.matrix {
            Matrix::Exact(matrix) => matrix.run(x, n_in, out, Into::Add),
            Matrix::Quantised(matrix) => {
                add_rounded(matrix, out, |row, whole| whole.copy_from_slice(&x[row * n_in..][..n_in]));
            }
        }
    }
}

/// `out [T, width] += x · weights` with each row of `x`, which `copy(row, [depth])` makes, rounded.
fn add_rounded(matrix: &QuantisedMatrix, out: &mut [f32], copy: impl Fn(usize, &mut [f32])) {
    let (depth, width) = (matrix.depth(), matrix.width());
    let (mut rounded, mut whole) = ([0; ROUNDED_LEN], [0.0; ROUNDED_LEN / ROUNDED_ROWS]);
    let mut steps = [0.0; MOST_ROUNDED_ROWS];
    let n_together = (ROUNDED_LEN / depth / ROUNDED_ROWS * ROUNDED_ROWS).min(MOST_ROUNDED_ROWS);
    for (block_idx, out) in out.chunks_mut(n_together * width).enumerate() {
        let n_rows = out.len() / width;
        for (idx, (row, step)) in rounded.chunks_exact_mut(depth).zip(&mut steps).take(n_rows).enumerate() {
            copy(block_idx * n_together + idx, &mut whole[..depth]);
            quantise(&whole[..depth], row, step);
        }
        let runs = Runs { count: 1, len: depth, stride: 0 };
        matrix.run(
            &rounded,
            runs,
            n_rows,
            |idx| idx * depth,
            |idx, first, sums| {
                let columns = matrix.steps()[first..].iter().zip(&matrix.zeros()[first..]);
                let out = out[idx * width + first..].iter_mut();
                for ((out, &sum), (own, zero)) in out.zip(sums).zip(columns) {
                    *out += (sum - zero) as f32 * (steps[idx] * own);
                }
            },
        );
    }
}

/// `max(x, 0)` in place.
pub fn relu(x: &mut [f32]) {
    x.iter_mut().for_each(|x| *x = x.max(0.0));
}
