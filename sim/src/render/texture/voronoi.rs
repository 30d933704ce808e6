//! Voronoi cells on a torus (Worley, 1996). Their points stand in staggered rows and may leave their places at random;
//! undisturbed, the cells are hexagons.

use super::shaping::wrap;
use crate::render::texture::noise::Noise;

/// A division of the tile into cells.
pub(super) struct Cells {
    n: [i32; 2],
    /// The cells' points in tiles and their lots, row by row, with two columns more to the left and one to the right
    /// and a row more above and below: copies of those that a neighbouring tile has there.
    points: Vec<([f32; 2], f32)>,
}

/// A cell, as seen from a point in it.
pub(super) struct Cell {
    /// Column and row of its place.
    pub(super) id: [i32; 2],
    /// Its own random number in [0, 1).
    pub(super) lot: f32,
    /// From the cell's point to the point, in tiles.
    pub(super) offset: [f32; 2],
    /// The same from this cell's point and its eight neighbours'.
    offsets: [[f32; 2]; 9],
}

impl Cell {
    /// Distance to the cell's border, in tiles.
    pub(super) fn edge(&self) -> f32 {
        let [x, y] = self.offset;
        // The border with another cell is where both points are equally far. The cell itself gives 0 / 0, which is
        // not a number and never the minimum.
        let squares = self.offsets.map(|[other_x, other_y]| {
            let (apart_x, apart_y) = (x - other_x, y - other_y);
            let further = other_x * other_x + other_y * other_y - x * x - y * y;
            further * further / (4.0 * (apart_x * apart_x + apart_y * apart_y))
        });
        squares.into_iter().fold(f32::INFINITY, f32::min).sqrt()
    }
}

impl Cells {
    /// Columns and an even number of rows; a point leaves its place by up to `jitter` / 2 of a column and of a row.
    pub(super) fn new(seed: u64, n: [i32; 2], jitter: f32) -> Self {
        let [cols, rows] = n;
        let lots = [0, 1, 2].map(|i| Noise::new(seed + i, n));
        let point = |col: i32, row: i32| {
            let [x, y, lot] = [0, 1, 2].map(|i: usize| lots[i].at_node(col, row));
            let [x, y] = [x, y].map(|lot| 0.5 + jitter * (lot - 0.5));
            ([(col as f32 + stagger(row) + x) / cols as f32, (row as f32 + y) / rows as f32], lot)
        };
        let places = (-1..=rows).flat_map(|row| (-2..=cols).map(move |col| (col, row)));
        Self { n, points: places.map(|(col, row)| point(col, row)).collect() }
    }

    /// The cell at (`u`, `v`).
    pub(super) fn at(&self, u: f32, v: f32) -> Cell {
        let (first_ids, offsets) = self.near(wrap(u), wrap(v));
        let (mut nearest, mut least) = (0, f32::INFINITY);
        for (i, [x, y]) in offsets.iter().enumerate() {
            let square = x * x + y * y;
            (nearest, least) = if square < least { (i, square) } else { (nearest, least) };
        }
        let [col, row] = first_ids[nearest / 3];
        let id = [col + nearest as i32 % 3, row];
        Cell { id, lot: self.points[self.index(id)].1, offset: offsets[nearest], offsets }
    }

    /// The cells in the 3 × 3 places around (`u`, `v`) in the tile: the ids of the first in each row and the ways from
    /// the points of all.
    fn near(&self, u: f32, v: f32) -> ([[i32; 2]; 3], [[f32; 2]; 9]) {
        let [cols, rows] = self.n;
        let place = ((v * rows as f32) as i32).min(rows - 1);
        let first_ids = [place - 1, place, place + 1].map(|row| {
            // One more before the cut to an integer and one less after it: rounded down even where negative.
            let col = (u * cols as f32 - stagger(row) + 1.0) as i32 - 1;
            [col.min(cols - 1) - 1, row]
        });
        let mut offsets = [[0.0; 2]; 9];
        for (three, [col, row]) in offsets.chunks_exact_mut(3).zip(first_ids) {
            let first = self.index([col, row]);
            for (offset, ([x, y], _)) in three.iter_mut().zip(&self.points[first..first + 3]) {
                *offset = [u - x, v - y];
            }
        }
        (first_ids, offsets)
    }

    /// Index of a cell's point.
    fn index(&self, [col, row]: [i32; 2]) -> usize {
        ((row + 1) * (self.n[0] + 3) + col + 2) as usize
    }
}

/// How far a row's places stand to the right, in columns.
fn stagger(row: i32) -> f32 {
    0.5 * (row & 1) as f32
}
