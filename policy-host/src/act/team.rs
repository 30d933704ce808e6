//! The threads that share one sample when there are fewer samples than threads.
//!
//! What they share out are rows of tokens, heads of an attention and lines of feature maps. Each number is computed as by a
//! single thread, so the size of the team changes no bit.

use std::ops::Range;

use crate::nn::maps::MapShape;

/// Rows are shared out in multiples of this, so that no member has a short tile more than a single thread would.
const ROWS_TOGETHER: usize = 6;

/// Units (rows, heads) of each member but the last, of `n_units` in all.
pub(super) fn share(n_units: usize, n_members: usize, together: usize) -> usize {
    n_units.div_ceil(n_members).next_multiple_of(together).max(1)
}

/// Rows of tokens for each member but the last.
pub(super) fn rows(n_rows: usize, n_members: usize) -> usize {
    share(n_rows, n_members, ROWS_TOGETHER)
}

/// Lets every member compute a band of the lines of `map`, whose shape is `shape`: `compute(lines, memory of the lines,
/// member)`. Bands are cut at multiples of `together`. The border is zero afterwards.
pub(super) fn in_bands<M: Send>(
    members: &mut [M],
    (map, shape): (&mut [f32], MapShape),
    together: usize,
    compute: impl Fn(Range<usize>, &mut [f32], &mut M) + Sync,
) {
    let lines = 0..shape.n_lines();
    let first = shape.lines(lines.clone()).start;
    bands(members, (&mut map[first..], shape), lines, together, &compute);
    shape.clear_border(map);
}

fn bands<M: Send>(
    members: &mut [M],
    (memory, shape): (&mut [f32], MapShape),
    lines: Range<usize>,
    together: usize,
    compute: &(impl Fn(Range<usize>, &mut [f32], &mut M) + Sync),
) {
    let n_left = members.len() / 2;
    let n_lines = (lines.len() * n_left / members.len().max(1)).next_multiple_of(together);
    if n_left == 0 || n_lines == 0 || n_lines >= lines.len() {
        return compute(lines, memory, &mut members[0]);
    }
    let middle = lines.start + n_lines;
    let (above, below) = memory.split_at_mut(shape.lines(lines.start..middle).len());
    let (left, right) = members.split_at_mut(n_left);
    rayon::join(
        || bands(left, (above, shape), lines.start..middle, together, compute),
        || bands(right, (below, shape), middle..lines.end, together, compute),
    );
}
