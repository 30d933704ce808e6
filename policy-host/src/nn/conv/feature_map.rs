//! Batches of feature maps in NHWC layout with zero padding in memory:
//! `[n, padding + h + padding, padding + w + padding, c] f32`.
//!
//! A convolution reads the padding like any other pixel, without a bounds test per tap.

use std::ops::Range;

/// Shape of a batch of equally sized feature maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FeatureMapShape {
    /// Number of images `n`.
    pub batch: usize,
    /// Height `h` in pixels, without padding.
    pub height: usize,
    /// Width `w` in pixels, without padding.
    pub width: usize,
    /// Number of channels `c`.
    pub channels: usize,
    /// Width of the zero border around each image, in pixels.
    pub padding: usize,
}

impl FeatureMapShape {
    /// Returns the width including padding: the number of pixels from one row to the next.
    #[must_use]
    pub const fn padded_width(self) -> usize {
        self.width + 2 * self.padding
    }

    /// Returns the height including padding.
    #[must_use]
    pub const fn padded_height(self) -> usize {
        self.height + 2 * self.padding
    }

    /// Returns the number of values in one image, including padding.
    #[must_use]
    pub const fn image_len(self) -> usize {
        self.padded_height() * self.padded_width() * self.channels
    }

    /// Returns the number of values in all images, including padding.
    #[must_use]
    pub const fn len(self) -> usize {
        self.batch * self.image_len()
    }

    /// Returns `true` if there are no values.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Returns the offset of a pixel. Row and column 0 are the first inside the padding.
    #[must_use]
    pub const fn offset(self, image_idx: usize, row: usize, col: usize) -> usize {
        image_idx * self.image_len()
            + ((row + self.padding) * self.padded_width() + col + self.padding) * self.channels
    }

    /// Returns the number of unpadded rows in all images. Row `image_idx · h + row` is row `row` of an image.
    #[must_use]
    pub const fn n_rows(self) -> usize {
        self.batch * self.height
    }

    /// Returns the memory range of the given rows, counted over all images: from the left padding of the
    /// first row to the left padding of the row after the last. The top padding of the first image precedes
    /// all rows; the last row extends to the end of the data.
    #[must_use]
    pub fn row_span(self, rows: Range<usize>) -> Range<usize> {
        let margin = self.padding * self.channels;
        let start = |row: usize| self.offset(row / self.height, row % self.height, 0) - margin;
        start(rows.start)..if rows.end == self.n_rows() { self.len() } else { start(rows.end) }
    }

    /// Sets the padding of every image in `data` to zero.
    ///
    /// # Panics
    /// If `data` does not have this shape.
    pub fn clear_padding(self, data: &mut [f32]) {
        assert_eq!(data.len(), self.len(), "feature maps {self:?}");
        let row_len = self.padded_width() * self.channels;
        let margin = self.padding * self.channels;
        for image in data.chunks_exact_mut(self.image_len()) {
            image[..self.padding * row_len].fill(0.0);
            image[(self.padding + self.height) * row_len..].fill(0.0);
            for row in image.chunks_exact_mut(row_len).skip(self.padding).take(self.height) {
                row[..margin].fill(0.0);
                row[row_len - margin..].fill(0.0);
            }
        }
    }
}
