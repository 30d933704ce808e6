//! The one door to faer's matrix product: row-major views with a row stride, on the calling thread.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

/// What a product does with the numbers already in its destination.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Into {
    /// Overwrites them.
    Replace,
    /// Adds to them.
    Add,
}

/// `[n_rows, n_cols] f32` in `data`, rows `stride` numbers apart. Rows may overlap (`stride < n_cols`), which is how a
/// convolution reads its neighbourhoods without copying them.
///
/// # Panics
/// If the last number would lie outside `data`.
#[must_use]
pub fn view(data: &[f32], n_rows: usize, n_cols: usize, stride: usize) -> MatRef<'_, f32> {
    MatRef::from_row_major_slice_with_stride(data, n_rows, n_cols, stride)
}

/// As [`view`], for a destination; rows may not overlap.
///
/// # Panics
/// If the last number would lie outside `data`, or rows overlap.
#[must_use]
pub fn view_mut(data: &mut [f32], n_rows: usize, n_cols: usize, stride: usize) -> MatMut<'_, f32> {
    // By way of columns: the row-major constructor of faer 0.24 for strided slices swaps its strides.
    MatMut::from_column_major_slice_with_stride_mut(data, n_cols, n_rows, stride).transpose_mut()
}

/// `out = a · b`, or `out += a · b`.
///
/// # Panics
/// If the shapes do not fit.
pub fn multiply(out: MatMut<'_, f32>, into: Into, a: MatRef<'_, f32>, b: MatRef<'_, f32>) {
    let accum = match into {
        Into::Replace => Accum::Replace,
        Into::Add => Accum::Add,
    };
    matmul(out, accum, a, b, 1.0, Par::Seq);
}
