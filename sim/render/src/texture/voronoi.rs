//! Periodic Voronoi cells (Worley, "A cellular texture basis function", 1996).
//!
//! The feature points form staggered rows with random jitter. Without jitter the cells are hexagons.

use super::shaping::fract;
use crate::texture::noise::Noise;

/// A Voronoi diagram of the tile.
pub(crate) struct VoronoiCells {
    n: [i32; 2],
    /// Feature points in tiles with their random numbers, in row-major order. Two extra columns on the left,
    /// one on the right and an extra row above and below repeat the points of the neighbouring tiles.
    points: Vec<([f32; 2], f32)>,
}

/// The cell that contains a point, and the position of the point in it.
pub(crate) struct VoronoiCell {
    /// Column and row of the feature point.
    pub(crate) id: [i32; 2],
    /// Random number of the cell, in [0, 1).
    pub(crate) random: f32,
    /// Vector from the feature point to the point, in tiles.
    pub(crate) offset: [f32; 2],
    /// The same for the 3 × 3 feature points around the point.
    offsets: [[f32; 2]; 9],
}

impl VoronoiCell {
    /// Returns the distance to the border of the cell, in tiles.
    pub(crate) fn border_distance(&self) -> f32 {
        let [x, y] = self.offset;
        // The border is equidistant from both feature points. The cell itself gives 0 / 0, and `min` ignores
        // the NaN.
        let squares = self.offsets.map(|[other_x, other_y]| {
            let (between_x, between_y) = (x - other_x, y - other_y);
            let difference = other_x * other_x + other_y * other_y - x * x - y * y;
            difference * difference / (4.0 * (between_x * between_x + between_y * between_y))
        });
        squares.into_iter().fold(f32::INFINITY, f32::min).sqrt()
    }
}

impl VoronoiCells {
    /// Creates `n` columns and rows of cells, with an even number of rows. Each feature point moves by up to
    /// `jitter` / 2 of a column and of a row.
    pub(crate) fn new(seed: u64, n: [i32; 2], jitter: f32) -> Self {
        let [cols, rows] = n;
        let noises = [0, 1, 2].map(|i| Noise::new(seed + i, n));
        let point = |col: i32, row: i32| {
            let [x, y, random] = [0, 1, 2].map(|i: usize| noises[i].at_node(col, row));
            let [x, y] = [x, y].map(|random| 0.5 + jitter * (random - 0.5));
            ([(col as f32 + stagger(row) + x) / cols as f32, (row as f32 + y) / rows as f32], random)
        };
        let ids = (-1..=rows).flat_map(|row| (-2..=cols).map(move |col| (col, row)));
        Self { n, points: ids.map(|(col, row)| point(col, row)).collect() }
    }

    /// Returns the cell at (`u`, `v`).
    pub(crate) fn at(&self, u: f32, v: f32) -> VoronoiCell {
        let (first_ids, offsets) = self.neighbourhood(fract(u), fract(v));
        let (mut nearest, mut min) = (0, f32::INFINITY);
        for (i, [x, y]) in offsets.iter().enumerate() {
            let square = x * x + y * y;
            (nearest, min) = if square < min { (i, square) } else { (nearest, min) };
        }
        let [col, row] = first_ids[nearest / 3];
        let id = [col + nearest as i32 % 3, row];
        VoronoiCell { id, random: self.points[self.index(id)].1, offset: offsets[nearest], offsets }
    }

    /// Returns the 3 × 3 cells around (`u`, `v`) in the tile: the id of the first cell of each row, and the
    /// vectors from all nine feature points.
    fn neighbourhood(&self, u: f32, v: f32) -> ([[i32; 2]; 3], [[f32; 2]; 9]) {
        let [cols, rows] = self.n;
        let centre_row = ((v * rows as f32) as i32).min(rows - 1);
        let first_ids = [centre_row - 1, centre_row, centre_row + 1].map(|row| {
            // Adding 1 before the cast and subtracting it afterwards rounds down even if the value is
            // negative.
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

    /// Returns the index of a feature point.
    fn index(&self, [col, row]: [i32; 2]) -> usize {
        ((row + 1) * (self.n[0] + 3) + col + 2) as usize
    }
}

/// Returns the horizontal shift of a row, in columns.
fn stagger(row: i32) -> f32 {
    0.5 * (row & 1) as f32
}
