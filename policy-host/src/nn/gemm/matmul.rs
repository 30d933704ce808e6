//! Products of activations: row-major views and faer's matrix product on the calling thread. No other module
//! uses faer.

use faer::{MatMut, MatRef, Par};

/// Treatment of the existing contents of a product's destination.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accum {
    /// Overwrites the destination.
    Replace,
    /// Adds to the destination.
    Add,
}

/// Returns a view `[n_rows, n_cols] f32` of `data` whose rows are `stride` values apart. Rows may overlap
/// (`stride < n_cols`), so that a convolution can read its windows without copying them.
///
/// # Panics
/// If the last value would lie outside `data`.
#[must_use]
pub fn view(data: &[f32], n_rows: usize, n_cols: usize, stride: usize) -> MatRef<'_, f32> {
    MatRef::from_row_major_slice_with_stride(data, n_rows, n_cols, stride)
}

/// Like [`view`], but mutable. Rows must not overlap.
///
/// # Panics
/// If the last value would lie outside `data`, or if rows overlap.
#[must_use]
pub fn view_mut(data: &mut [f32], n_rows: usize, n_cols: usize, stride: usize) -> MatMut<'_, f32> {
    // faer 0.24's row-major constructor for strided slices swaps the strides, so construct the transpose.
    MatMut::from_column_major_slice_with_stride_mut(data, n_cols, n_rows, stride).transpose_mut()
}

/// Computes `out = a · b` or `out += a · b`.
///
/// # Panics
/// If the shapes do not match.
pub fn matmul(out: MatMut<'_, f32>, accum: Accum, a: MatRef<'_, f32>, b: MatRef<'_, f32>) {
    let accum = match accum {
        Accum::Replace => faer::Accum::Replace,
        Accum::Add => faer::Accum::Add,
    };
    faer::linalg::matmul::matmul(out, accum, a, b, 1.0, Par::Seq);
}
