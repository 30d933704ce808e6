//! Work sharing between a team of threads that computes one sample together, used when there are fewer
//! samples than threads.
//!
//! The units of work are token rows, attention heads and rows of feature maps. Every value is computed
//! exactly as by a single thread, so the size of the team does not change a bit.

use std::ops::Range;

use crate::nn::conv::feature_map::FeatureMapShape;

/// Granularity of token rows: the row count of a GEMM micro-tile, so that sharing adds at most one partial
/// tile.
const ROW_GRANULARITY: usize = 6;

/// Returns the number of units (rows, heads) per member, of `n_units` in total. The last member may have
/// fewer.
pub(crate) fn share(n_units: usize, n_members: usize, granularity: usize) -> usize {
    n_units.div_ceil(n_members).next_multiple_of(granularity).max(1)
}

/// Returns the number of token rows per member. The last member may have fewer.
pub(crate) fn rows_per_member(n_rows: usize, n_members: usize) -> usize {
    share(n_rows, n_members, ROW_GRANULARITY)
}

/// Divides the rows of the feature maps `map` among the members and calls `compute(rows, memory of the rows,
/// member)` for each band. Bands start at multiples of `granularity`. Clears the padding afterwards.
pub(crate) fn in_bands<M: Send>(
    members: &mut [M],
    (map, shape): (&mut [f32], FeatureMapShape),
    granularity: usize,
    compute: impl Fn(Range<usize>, &mut [f32], &mut M) + Sync,
) {
    let rows = 0..shape.n_rows();
    let first = shape.row_span(rows.clone()).start;
    bands(members, (&mut map[first..], shape), rows, granularity, &compute);
    shape.clear_padding(map);
}

fn bands<M: Send>(
    members: &mut [M],
    (memory, shape): (&mut [f32], FeatureMapShape),
    rows: Range<usize>,
    granularity: usize,
    compute: &(impl Fn(Range<usize>, &mut [f32], &mut M) + Sync),
) {
    let n_left = members.len() / 2;
    let n_upper = (rows.len() * n_left / members.len().max(1)).next_multiple_of(granularity);
    if n_left == 0 || n_upper == 0 || n_upper >= rows.len() {
        return compute(rows, memory, &mut members[0]);
    }
    let middle = rows.start + n_upper;
    let (above, below) = memory.split_at_mut(shape.row_span(rows.start..middle).len());
    let (left, right) = members.split_at_mut(n_left);
    rayon::join(
        || bands(left, (above, shape), rows.start..middle, granularity, compute),
        || bands(right, (below, shape), middle..rows.end, granularity, compute),
    );
}
