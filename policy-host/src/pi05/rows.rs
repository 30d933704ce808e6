//! Element-wise work on the rows of a batch, shared among the threads of the current rayon pool.

use rayon::prelude::*;

/// Rows that pass through an MLP together. It bounds the memory of the hidden layer, the widest of a network.
const BLOCK_ROWS: usize = 512;
/// Values that one thread adds at a time.
const ADD_LEN: usize = 16 << 10;

/// Computes `x += y`.
pub(crate) fn add_rows(x: &mut [f32], y: &[f32]) {
    x.par_chunks_mut(ADD_LEN).zip(y.par_chunks(ADD_LEN)).for_each(|(x, y)| {
        x.iter_mut().zip(y).for_each(|(x, y)| *x += y);
    });
}

/// Calls `compute` with blocks of up to [`BLOCK_ROWS`] rows of `x [t, width]`.
pub(crate) fn in_row_blocks(x: &mut [f32], width: usize, compute: impl FnMut(&mut [f32])) {
    x.chunks_mut(BLOCK_ROWS * width).for_each(compute);
}
