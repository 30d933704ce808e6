//! Affine layers: `y = x · W + b`.

use super::matmul::{Into, multiply, view, view_mut};

/// A linear layer, its matrix stored `[n_in, n_out]` so that the product streams through it.
#[derive(Clone, Debug)]
pub struct Linear {
    matrix: Vec<f32>,
    bias: Vec<f32>,
    n_in: usize,
    n_out: usize,
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
        Self { matrix, bias: bias.to_vec(), n_in, n_out }
    }

    /// The layer whose outputs are `factor` times these.
    #[must_use]
    pub fn scaled(mut self, factor: f32) -> Self {
        self.matrix.iter_mut().chain(&mut self.bias).for_each(|x| *x *= factor);
        self
    }

    /// The layer whose outputs are these, then those of `other`, from the same input.
    ///
    /// # Panics
    /// If the inputs differ in width.
    #[must_use]
    pub fn beside(&self, other: &Self) -> Self {
        assert_eq!(self.n_in, other.n_in, "two layers of one input");
        let rows = self.matrix.chunks_exact(self.n_out).zip(other.matrix.chunks_exact(other.n_out));
        Self {
            matrix: rows.flat_map(|(left, right)| left.iter().chain(right)).copied().collect(),
            bias: [self.bias.as_slice(), &other.bias].concat(),
            n_in: self.n_in,
            n_out: self.n_out + other.n_out,
        }
    }

    /// Width of the input.
    #[must_use]
    pub fn n_in(&self) -> usize {
        self.n_in
    }

    /// Width of the output.
    #[must_use]
    pub fn n_out(&self) -> usize {
        self.n_out
    }

    /// `out [T, n_out] = x [T, n_in] · W + b`.
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn run(&self, x: &[f32], out: &mut [f32]) {
        out.chunks_exact_mut(self.n_out).for_each(|row| row.copy_from_slice(&self.bias));
        self.accumulate(x, out);
    }

    /// `out [T, n_out] += x [T, n_in] · W + b`.
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn add_to(&self, x: &[f32], out: &mut [f32]) {
        for row in out.chunks_exact_mut(self.n_out) {
            row.iter_mut().zip(&self.bias).for_each(|(y, b)| *y += b);
        }
        self.accumulate(x, out);
    }

    fn accumulate(&self, x: &[f32], out: &mut [f32]) {
        let n_rows = x.len() / self.n_in;
        assert_eq!((x.len(), out.len()), (n_rows * self.n_in, n_rows * self.n_out), "rows of a linear layer");
        multiply(
            view_mut(out, n_rows, self.n_out, self.n_out),
            Into::Add,
            view(x, n_rows, self.n_in, self.n_in),
            view(&self.matrix, self.n_in, self.n_out, self.n_out),
        );
    }
}

/// `max(x, 0)` in place.
pub fn relu(x: &mut [f32]) {
    x.iter_mut().for_each(|x| *x = x.max(0.0));
}
