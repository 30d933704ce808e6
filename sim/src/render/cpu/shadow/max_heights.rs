//! A map's greatest heights, so that most look-ups can be spared.

use core::ops::RangeInclusive;

use super::{CELL, CELLS};
use crate::render::cpu::simd::each::each;
use crate::render::cpu::simd::{Simd, SimdI32};

/// The greatest heights of a map's cells, and of overlapping windows of 3 × 3 of them.
///
/// PyramidLevel k of the windows has those of cells of 2ᵏ × 2ᵏ of the map's, by each window's first cell.
pub(in crate::render::cpu) struct MaxHeightPyramid {
    /// Rows of [`PITCH`] cells; there is nothing in the last two rows and columns, into which windows reach.
    cells: Vec<u16>,
    /// All levels, from the finest on.
    windows: Vec<u16>,
    /// First and last column, first and last row of the cells that held anything when the windows were last found out.
    occupied: Option<[[usize; 2]; 2]>,
}

/// Cells along each edge of the map, and two beyond it.
const PITCH: usize = CELLS + 2;
/// MipLevels: the cells of the coarsest are an eighth of the map wide.
const N_LEVELS: usize = 6;
/// Where each level begins.
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
    /// Nothing anywhere.
    pub(super) fn new() -> Self {
        Self { cells: vec![0; PITCH * PITCH], windows: vec![0; LEVELS[N_LEVELS]], occupied: None }
    }

    /// Puts the greatest heights of two cells side by side into their place, by the first one's column and row.
    #[inline(always)]
    pub(super) fn set_cell_pair(&mut self, [column, row]: [usize; 2], heights: [u16; 2]) {
        self.cells[row * PITCH + column..][..2].copy_from_slice(&heights);
    }

    /// Finds the windows out from the cells, given the first and last column and row of those that hold anything.
    #[inline(always)]
    pub(super) fn finish(&mut self, occupied: Option<[[usize; 2]; 2]>) {
        let before = core::mem::replace(&mut self.occupied, occupied);
        // What is no longer there leaves the windows, too.
        let [columns, rows] = match (before, occupied) {
            (Some(before), Some(now)) => {
                each!(k in 2 => [before[k][0].min(now[k][0]), before[k][1].max(now[k][1])])
            }
            (Some(ranges), None) | (None, Some(ranges)) => ranges,
            (None, None) => return,
        };
        let (first, n) = (columns[0].saturating_sub(2), columns[1] - columns[0].saturating_sub(2) + 1);
        for row in reached(rows, 0) {
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
            // Windows of three cells that are twice as long are windows side by side.
            let next = |at: usize| (2 * at + 3).min(2 * side - 1);
            for row in reached(rows, level) {
                let [upper, lower] = each!(k in 2 => {
                    &finer[[2 * row, next(row)][k] * 2 * side..][..2 * side]
                });
                let both = &mut both[..2 * side];
                for (i, max_heights) in both.iter_mut().enumerate() {
                    *max_heights = upper[i].max(lower[i]);
                }
                let windows = &mut coarser[row * side..][..side];
                for column in reached(columns, level) {
                    windows[column] = both[2 * column].max(both[next(column)]);
                }
            }
        }
    }

    /// A window's greatest height.
    #[inline(always)]
    pub(super) fn within(&self, window: PyramidWindow) -> u16 {
        self.windows[window.0 as usize]
    }
}

/// Windows of a level that have to do with these columns or rows of cells.
fn reached([first, last]: [usize; 2], level: usize) -> RangeInclusive<usize> {
    (first >> level).saturating_sub(2)..=last >> level
}

/// One of a map's windows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PyramidWindow(pub(super) i32);

impl PyramidWindow {
    /// The least one with these columns and rows of texels in it, first and last; `None` if they are too far apart for any.
    pub(super) fn around([[left, right], [top, bottom]]: [[i32; 2]; 2]) -> Option<Self> {
        PyramidLevel::of((right - left).max(bottom - top)).map(|level| level.window([left, top]))
    }
}

/// A level of windows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PyramidLevel(u32);

impl PyramidLevel {
    /// The finest one whose windows have room for texels that are so far apart.
    #[inline(always)]
    pub(super) fn of(reach: i32) -> Option<Self> {
        // Two of its cells are as long as that, since it need not begin where a cell does.
        let level = u32::BITS - ((reach.max(1) as u32 - 1) / (2 * CELL as u32)).leading_zeros();
        ((level as usize) < N_LEVELS).then_some(Self(level))
    }

    /// The window that a texel has in its first cell.
    fn window(self, [x, y]: [i32; 2]) -> PyramidWindow {
        let bits = CELL.ilog2() + self.0;
        PyramidWindow(LEVELS[self.0 as usize] as i32 + (y >> bits) * (CELLS >> self.0) as i32 + (x >> bits))
    }

    /// The same for sixteen texels.
    #[inline(always)]
    pub(super) fn windows<S: Simd>(self, [x, y]: [S::I; 2]) -> S::I {
        let bits = CELL.ilog2() + self.0;
        let row = y.shr_arithmetic_by(bits).dot_i16(S::I::splat((CELLS >> self.0) as i32));
        row + x.shr_arithmetic_by(bits) + S::I::splat(LEVELS[self.0 as usize] as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::{CELL, CELLS, LEVELS, MaxHeightPyramid, N_LEVELS, PyramidLevel, PyramidWindow};
    use crate::render::cpu::shadow::SIDE;
    use crate::stream::Stream;

    /// A whole number below `n`.
    fn below(stream: &mut Stream, n: usize) -> usize {
        (stream.unit() * n as f64) as usize
    }

    /// Puts random heights into the cells of a random part, and nothing elsewhere.
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
    fn windows_hold_the_greatest_of_three_by_three_cells_whatever_was_there_before() {
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
    fn a_window_around_texels_has_all_of_them_in_it() {
        let mut stream = Stream::new(2, "windows");
        let (mut cells, mut max_heights) = (vec![0; CELLS * CELLS], MaxHeightPyramid::new());
        change(&mut stream, &mut cells, &mut max_heights);
        let mut levels = [0; N_LEVELS];
        for _ in 0..20_000 {
            let reach = 1 << below(&mut stream, 8);
            let texels = [0; 2].map(|_| {
                let first = below(&mut stream, SIDE);
                [first, (first + below(&mut stream, reach + 1)).min(SIDE - 1)]
            });
            let window = PyramidWindow::around(texels.map(|ends| ends.map(|at| at as i32))).unwrap();
            let [columns, rows] = texels.map(|[first, last]| first / CELL..=last / CELL);
            let greatest = rows.flat_map(|row| &cells[row * CELLS..][columns.clone()]).max();
            assert!(max_heights.within(window) >= *greatest.unwrap(), "{texels:?}");
            levels[LEVELS.partition_point(|first| *first <= window.0 as usize) - 1] += 1;
        }
        assert!(levels.iter().all(|n| *n > 100), "{levels:?}");
        assert!(PyramidLevel::of(SIDE as i32 - 1).is_none() && PyramidLevel::of(0) == PyramidLevel::of(1));
    }
}
