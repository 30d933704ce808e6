//! Maximum heights of a shadow map over windows of several sizes, which make most lookups unnecessary.

use core::ops::RangeInclusive;

use super::size::{CELL, CELLS};
use crate::cpu::simd::each::each;
use crate::cpu::simd::{Simd, SimdI32};

/// Maximum heights of the cells of a shadow map, and a pyramid of maximum heights over overlapping windows of
/// 3 × 3 cells.
///
/// The cells of level k are 2ᵏ × 2ᵏ cells of the map. A window is indexed by its first cell.
pub(crate) struct MaxHeightPyramid {
    /// Rows of [`PITCH`] cells. The last two rows and columns are padding for windows at the edge.
    cells: Vec<u16>,
    /// All levels, the finest first.
    windows: Vec<u16>,
    /// First and last column and row of the occupied cells at the last update of the windows.
    occupied: Option<[[usize; 2]; 2]>,
}

/// Length of a row of cells, including two cells of padding.
const PITCH: usize = CELLS + 2;
/// Number of levels. The cells of the coarsest are an eighth of the map wide.
const N_LEVELS: usize = 6;
/// Index of the first window of each level.
const LEVELS: [usize; N_LEVELS + 1] = {
    let mut firsts = [0; N_LEVELS + 1];
    let mut level = 0;
    while level < N_LEVELS {
        let side = CELLS >> level;
        firsts[level + 1] = firsts[level] + side * side;
        level += 1;
    }
    firsts
};

impl MaxHeightPyramid {
    /// Creates an empty pyramid.
    pub(crate) fn new() -> Self {
        Self { cells: vec![0; PITCH * PITCH], windows: vec![0; LEVELS[N_LEVELS]], occupied: None }
    }

    /// Sets the maximum heights of two horizontally adjacent cells, given the column and row of the first.
    #[inline(always)]
    pub(crate) fn set_cell_pair(&mut self, [column, row]: [usize; 2], heights: [u16; 2]) {
        self.cells[row * PITCH + column..][..2].copy_from_slice(&heights);
    }

    /// Updates the windows from the cells, given the first and last column and row of the occupied ones.
    #[inline(always)]
    pub(crate) fn finish(&mut self, occupied: Option<[[usize; 2]; 2]>) {
        let before = core::mem::replace(&mut self.occupied, occupied);
        // Include the cells that were occupied before, so that their windows are cleared.
        let [columns, rows] = match (before, occupied) {
            (Some(before), Some(now)) => {
                each!(k in 2 => [before[k][0].min(now[k][0]), before[k][1].max(now[k][1])])
            }
            (Some(ranges), None) | (None, Some(ranges)) => ranges,
            (None, None) => return,
        };
        let (first, n) = (columns[0].saturating_sub(2), columns[1] - columns[0].saturating_sub(2) + 1);
        for row in overlapping(rows, 0) {
            let windows = &mut self.windows[row * CELLS + first..][..n];
            let rows = each!(down in 3 => &self.cells[(row + down) * PITCH + first..][..n + 2]);
            for (i, window) in windows.iter_mut().enumerate() {
                let [a, b, c] = each!(k in 3 => rows[k][i].max(rows[k][i + 1]).max(rows[k][i + 2]));
                *window = a.max(b).max(c);
            }
        }
        let mut both = [0; CELLS];
        for level in 1..N_LEVELS {
            let (finer, coarser) = self.windows.split_at_mut(LEVELS[level]);
            let (finer, side) = (&finer[LEVELS[level - 1]..], CELLS >> level);
            // A window of three cells of twice the size is the union of two adjacent finer windows.
            let next = |at: usize| (2 * at + 3).min(2 * side - 1);
            for row in overlapping(rows, level) {
                let [upper, lower] = each!(k in 2 => {
                    &finer[[2 * row, next(row)][k] * 2 * side..][..2 * side]
                });
                let both = &mut both[..2 * side];
                for (i, max_heights) in both.iter_mut().enumerate() {
                    *max_heights = upper[i].max(lower[i]);
                }
                let windows = &mut coarser[row * side..][..side];
                for column in overlapping(columns, level) {
                    windows[column] = both[2 * column].max(both[next(column)]);
                }
            }
        }
    }

    /// Returns the maximum height of a window.
    #[inline(always)]
    pub(crate) fn within(&self, window: PyramidWindow) -> u16 {
        self.windows[window.0 as usize]
    }
}

/// Returns the columns or rows of the windows of a level that overlap these cells.
fn overlapping([first, last]: [usize; 2], level: usize) -> RangeInclusive<usize> {
    (first >> level).saturating_sub(2)..=last >> level
}

/// Index of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PyramidWindow(pub(crate) i32);

impl PyramidWindow {
    /// Returns the smallest window that contains these columns and rows of texels (first, last), or `None` if
    /// no window is large enough.
    pub(crate) fn around([[left, right], [top, bottom]]: [[i32; 2]; 2]) -> Option<Self> {
        PyramidLevel::of((right - left).max(bottom - top)).map(|level| level.window([left, top]))
    }
}

/// A level of the pyramid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PyramidLevel(u32);

impl PyramidLevel {
    /// Returns the finest level whose windows can contain texels that are `size` apart.
    #[inline(always)]
    pub(crate) fn of(size: i32) -> Option<Self> {
        // Two cells must cover the range, because it need not be aligned with the cells.
        let level = u32::BITS - ((size.max(1) as u32 - 1) / (2 * CELL as u32)).leading_zeros();
        ((level as usize) < N_LEVELS).then_some(Self(level))
    }

    /// Returns the window whose first cell contains a texel.
    fn window(self, [x, y]: [i32; 2]) -> PyramidWindow {
        let bits = CELL.ilog2() + self.0;
        PyramidWindow(LEVELS[self.0 as usize] as i32 + (y >> bits) * (CELLS >> self.0) as i32 + (x >> bits))
    }

    /// Returns the indices of the windows whose first cells contain sixteen texels.
    #[inline(always)]
    pub(crate) fn windows<S: Simd>(self, [x, y]: [S::I; 2]) -> S::I {
        let bits = CELL.ilog2() + self.0;
        let row = y.shr_arithmetic_by(bits).dot_i16(S::I::splat((CELLS >> self.0) as i32));
        row + x.shr_arithmetic_by(bits) + S::I::splat(LEVELS[self.0 as usize] as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::{CELL, CELLS, LEVELS, MaxHeightPyramid, N_LEVELS, PyramidLevel, PyramidWindow};
    use crate::cpu::shadow::size::SIDE;
    use scene::stream::Stream;

    /// Draws an integer below `n`.
    fn below(stream: &mut Stream, n: usize) -> usize {
        (stream.unit() * n as f64) as usize
    }

    /// Sets random heights in a random rectangle of cells and 0 elsewhere.
    fn change(stream: &mut Stream, cells: &mut [u16], max_heights: &mut MaxHeightPyramid) {
        let part = [0; 2].map(|_| {
            let first = below(stream, CELLS / 2) * 2;
            [first, (first + 1 + 2 * below(stream, 30)).min(CELLS - 1)]
        });
        let [columns, rows] = part.map(|[first, last]| first..=last);
        for (place, cell) in cells.iter_mut().enumerate() {
            let is_in_part = columns.contains(&(place % CELLS)) && rows.contains(&(place / CELLS));
            *cell = if is_in_part { below(stream, 1 << 16) as u16 } else { 0 };
        }
        for (place, two) in cells.as_chunks::<2>().0.iter().enumerate() {
            max_heights.set_cell_pair([2 * place % CELLS, 2 * place / CELLS], *two);
        }
        max_heights.finish(Some(part));
    }

    #[test]
    fn windows_hold_the_maximum_of_their_cells() {
        let mut stream = Stream::new(1, "windows");
        let (mut cells, mut max_heights) = (vec![0; CELLS * CELLS], MaxHeightPyramid::new());
        for _ in 0..4 {
            change(&mut stream, &mut cells, &mut max_heights);
            for (level, first) in LEVELS[..N_LEVELS].iter().enumerate() {
                let side = CELLS >> level;
                for (row, column) in (0..side).flat_map(|row| (0..side).map(move |column| (row, column))) {
                    let [columns, rows] = [column, row].map(|at| at << level..((at + 3) << level).min(CELLS));
                    let expected = rows.flat_map(|row| &cells[row * CELLS..][columns.clone()]).max();
                    let window = PyramidWindow((first + row * side + column) as i32);
                    assert_eq!(
                        max_heights.within(window),
                        *expected.unwrap(),
                        "level {level}, {column}, {row}"
                    );
                }
            }
        }
        max_heights.cells.fill(0);
        max_heights.finish(None);
        assert_eq!(max_heights.windows.iter().max(), Some(&0));
    }

    #[test]
    fn window_covers_every_requested_texel() {
        let mut stream = Stream::new(2, "windows");
        let (mut cells, mut max_heights) = (vec![0; CELLS * CELLS], MaxHeightPyramid::new());
        change(&mut stream, &mut cells, &mut max_heights);
        let mut levels = [0; N_LEVELS];
        for _ in 0..20_000 {
            let size = 1 << below(&mut stream, 8);
            let texels = [0; 2].map(|_| {
                let first = below(&mut stream, SIDE);
                [first, (first + below(&mut stream, size + 1)).min(SIDE - 1)]
            });
            let window = PyramidWindow::around(texels.map(|ends| ends.map(|at| at as i32))).unwrap();
            let [columns, rows] = texels.map(|[first, last]| first / CELL..=last / CELL);
            let max = rows.flat_map(|row| &cells[row * CELLS..][columns.clone()]).max();
            assert!(max_heights.within(window) >= *max.unwrap(), "{texels:?}");
            levels[LEVELS.partition_point(|first| *first <= window.0 as usize) - 1] += 1;
        }
        assert!(levels.iter().all(|n| *n > 100), "{levels:?}");
        assert!(PyramidLevel::of(SIDE as i32 - 1).is_none() && PyramidLevel::of(0) == PyramidLevel::of(1));
    }
}
