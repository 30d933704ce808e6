//! Feature maps with a border: `[n_maps, border + height + border, border + width + border, C] f32`.
//!
//! The border is zero, so a convolution reads it as padding without a test per pixel.

use std::ops::Range;

/// Shape of a batch of feature maps of one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapShape {
    /// Maps one after another.
    pub n_maps: usize,
    /// Rows of pixels, without the border.
    pub height: usize,
    /// Pixels in a row, without the border.
    pub width: usize,
    /// Numbers in a pixel.
    pub channels: usize,
    /// Zero pixels around each map.
    pub border: usize,
}

impl MapShape {
    /// Pixels from one row to the next.
    #[must_use]
    pub const fn pitch(self) -> usize {
        self.width + 2 * self.border
    }

    /// Rows from the top of one map to the top of the next.
    #[must_use]
    pub const fn n_rows(self) -> usize {
        self.height + 2 * self.border
    }

    /// Numbers in one map, border included.
    #[must_use]
    pub const fn map_len(self) -> usize {
        self.n_rows() * self.pitch() * self.channels
    }

    /// Numbers in all maps.
    #[must_use]
    pub const fn len(self) -> usize {
        self.n_maps * self.map_len()
    }

    /// Whether there is no number at all.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Offset of a pixel, rows and columns counted from the first inner one.
    #[must_use]
    pub const fn offset(self, map_idx: usize, row: usize, col: usize) -> usize {
        map_idx * self.map_len() + ((row + self.border) * self.pitch() + col + self.border) * self.channels
    }

    /// Lines in all maps: line `map_idx · height + row` is a row of a map.
    #[must_use]
    pub const fn n_lines(self) -> usize {
        self.n_maps * self.height
    }

    /// Where these lines lie: from the left border of the first to the left border of the line after the last. The upper
    /// border of the first map is before all lines, and the last line ends with the data.
    #[must_use]
    pub fn lines(self, lines: Range<usize>) -> Range<usize> {
        let margin = self.border * self.channels;
        let start = |line: usize| self.offset(line / self.height, line % self.height, 0) - margin;
        start(lines.start)..if lines.end == self.n_lines() { self.len() } else { start(lines.end) }
    }

    /// The shape of one of the maps.
    #[must_use]
    pub const fn single(self) -> Self {
        Self { n_maps: 1, ..self }
    }

    /// Sets the border of every map in `data` to zero.
    ///
    /// # Panics
    /// If `data` is not of this shape.
    pub fn clear_border(self, data: &mut [f32]) {
        assert_eq!(data.len(), self.len(), "feature maps {self:?}");
        let row_len = self.pitch() * self.channels;
        let margin = self.border * self.channels;
        for map in data.chunks_exact_mut(self.map_len()) {
            map[..self.border * row_len].fill(0.0);
            map[(self.border + self.height) * row_len..].fill(0.0);
            for row in map.chunks_exact_mut(row_len).skip(self.border).take(self.height) {
                row[..margin].fill(0.0);
                row[row_len - margin..].fill(0.0);
            }
        }
    }
}
