//! Feature maps with a border: `[n_maps, border + side + border, border + side + border, C] f32`.
//!
//! The border is zero, so a convolution reads it as padding without a test per pixel.

/// Shape of a batch of square feature maps of one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapShape {
    /// Maps one after another.
    pub n_maps: usize,
    /// Height and width in pixels, without the border.
    pub side: usize,
    /// Numbers in a pixel.
    pub channels: usize,
    /// Zero pixels around each map.
    pub border: usize,
}

impl MapShape {
    /// Pixels from one row to the next.
    #[must_use]
    pub const fn pitch(self) -> usize {
        self.side + 2 * self.border
    }

    /// Numbers in one map, border included.
    #[must_use]
    pub const fn map_len(self) -> usize {
        self.pitch() * self.pitch() * self.channels
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
            map[(self.border + self.side) * row_len..].fill(0.0);
            for row in map.chunks_exact_mut(row_len).skip(self.border).take(self.side) {
                row[..margin].fill(0.0);
                row[row_len - margin..].fill(0.0);
            }
        }
    }
}
