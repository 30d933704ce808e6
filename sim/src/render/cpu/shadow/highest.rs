//! A map's greatest heights, so that most look-ups can be spared.

use super::{CELL, CELLS, DEPTHS_OF_SPACE, SIDE};
use crate::render::cpu::each::each;

/// The greatest heights of cells of 8 × 8 texels, row by row, then of cells of 16 × 16 and so on.
#[derive(Clone)]
pub(in crate::render::cpu) struct Highest {
    pub(super) levels: [Vec<f32>; N_LEVELS],
    /// First and last column, first and last row of the cells that hold anything.
    occupied: [[u8; 2]; 2],
}

/// Levels down to 2 × 2 cells.
const N_LEVELS: usize = CELLS.ilog2() as usize;

impl Highest {
    pub(super) fn new() -> Self {
        Self {
            levels: core::array::from_fn(|level| vec![DEPTHS_OF_SPACE; (CELLS >> level).pow(2)]),
            occupied: [[u8::MAX, 0]; 2],
        }
    }

    /// Finds the rest out from the finest level.
    #[inline(always)]
    pub(super) fn finish(&mut self) {
        self.occupied = [[u8::MAX, 0]; 2];
        for (row, cells) in self.levels[0].chunks_exact(CELLS).enumerate() {
            let is_there = |highest: &f32| *highest != DEPTHS_OF_SPACE;
            let ends = [cells.iter().position(is_there), cells.iter().rposition(is_there)];
            if let [Some(left), Some(right)] = ends {
                for (range, ends) in self.occupied.iter_mut().zip([[left, right], [row, row]]) {
                    *range = [range[0].min(ends[0] as u8), range[1].max(ends[1] as u8)];
                }
            }
        }
        for level in 1..N_LEVELS {
            let [finer, coarser] = &mut self.levels[level - 1..=level] else { continue };
            let side = CELLS >> level;
            for (i, highest) in coarser.iter_mut().enumerate() {
                let first = i / side * 4 * side + i % side * 2;
                let [upper, lower] = [&finer[first..first + 2], &finer[first + 2 * side..][..2]];
                *highest = upper[0].max(upper[1]).max(lower[0].max(lower[1]));
            }
        }
    }

    /// Whether anything is as high as that in these columns and rows of cells.
    #[inline(always)]
    pub(super) fn reaches_above(&self, height: f32, ranges: [[u8; 2]; 2]) -> bool {
        let [columns, rows] = each!(k in 2 => {
            let ([first, last], [from, to]) = (ranges[k], self.occupied[k]);
            usize::from(first.max(from))..usize::from(last.min(to)) + 1
        });
        rows.into_iter()
            .any(|row| columns.clone().any(|column| self.levels[0][row * CELLS + column] > height))
    }

    /// A height above which there is none at texels within these columns and rows, nor at their right and lower neighbours.
    #[inline(always)]
    pub(super) fn within(&self, [[left, right], [top, bottom]]: [[i32; 2]; 2]) -> f32 {
        // Cells as large as that: at most 2 × 2 of them.
        let reach = (right - left).max(bottom - top) as u32 + 1;
        let bits = (u32::BITS - reach.leading_zeros()).max(CELL.ilog2());
        let Some(level) = self.levels.get((bits - CELL.ilog2()) as usize) else { return f32::MAX };
        let side = SIDE >> bits;
        let at = |column: i32, row: i32| level[(row as usize >> bits) * side + (column as usize >> bits)];
        let upper = at(left, top).max(at(right + 1, top));
        upper.max(at(left, bottom + 1).max(at(right + 1, bottom + 1)))
    }
}
