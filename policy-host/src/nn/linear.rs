//! Affine layers: `y = x · W + b`.

use super::matmul::Into;
use super::packed::Packed;

/// A linear layer.
#[derive(Clone, Debug)]
pub struct Linear {
    /// `[n_in, n_out]`.
    matrix: Packed,
    bias: Vec<f32>,
}

impl Linear {
    /// From a checkpoint's `weight [n_out, n_in]` and `bias [n_out]`.
    ///
    /// # Panics
    /// If the lengths do not fit.
    #[must_use]
    pub fn new(weight: &[f32], bias: &[f32]) -> Self {
        let n_out = bias.len();
        let n_in = weight.len() / n_out;
        assert_eq!(weight.len(), n_in * n_out, "a [{n_out}, {n_in}] matrix");
        let mut matrix = vec![0.0; weight.len()];
        for (out_idx, row) in weight.chunks_exact(n_in).enumerate() {
            for (in_idx, &x) in row.iter().enumerate() {
                matrix[in_idx * n_out + out_idx] = x;
            }
        }
        Self { matrix: Packed::new(&matrix, n_in, n_out), bias: bias.to_vec() }
    }

    /// Width of the input.
    #[must_use]
    pub fn n_in(&self) -> usize {
        self.matrix.depth()
    }

    /// Width of the output.
    #[must_use]
    pub fn n_out(&self) -> usize {
        self.matrix.width()
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
        for idx in 0..n_blocks {
            self.matrix.run_part(idx * width..(idx + 1) * width, block(idx), width, out, Into::Add);
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
        self.matrix.run(x, n_in, out, Into::Add);
    }
}

/// `max(x, 0)` in place.
pub fn relu(x: &mut [f32]) {
    x.iter_mut().for_each(|x| *x = x.max(0.0));
}
