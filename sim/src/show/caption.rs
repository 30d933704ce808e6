//! Text of captions, in a font of fixed width.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

const WEIGHT: FontWeight = FontWeight::Regular;
/// Grey level of the text.
const TEXT: u16 = 255;
/// Number of steps from the background to the text at the edges of letters: few, because a GIF frame has 255
/// colours.
const OPACITY_STEPS: u16 = 4;

/// A size of letters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Font(RasterHeight);

impl Font {
    /// Selects the size in proportion to the width of an image in px.
    pub(crate) fn for_width(width: usize) -> Self {
        Self(match width {
            ..400 => RasterHeight::Size16,
            400..600 => RasterHeight::Size24,
            _ => RasterHeight::Size32,
        })
    }

    /// Returns the height of a line in px.
    pub(crate) fn height(self) -> usize {
        self.0.val()
    }

    /// Breaks a text into lines that fit into `width` px, between words where possible.
    pub(crate) fn wrap(self, text: &str, width: usize) -> Vec<String> {
        let n_columns = (width / get_raster_width(WEIGHT, self.0)).max(1);
        let mut lines = Vec::new();
        for paragraph in text.lines() {
            let mut line = String::new();
            for word in paragraph.split(' ') {
                if !line.is_empty() && line.len() + 1 + word.len() > n_columns {
                    lines.push(std::mem::take(&mut line));
                }
                if !line.is_empty() {
                    line.push(' ');
                }
                for letter in word.chars() {
                    if line.len() >= n_columns {
                        lines.push(std::mem::take(&mut line));
                    }
                    line.push(letter);
                }
            }
            lines.push(line);
        }
        lines
    }

    /// Calls `set` with the position and the grey level of every pixel of a line that differs from the
    /// `background`. A letter that the font lacks is drawn as `?`.
    pub(crate) fn draw(self, line: &str, background: u8, mut set: impl FnMut(usize, usize, u8)) {
        let background = u16::from(background);
        let glyph = |letter| get_raster(letter, WEIGHT, self.0);
        for (column, glyph) in
            line.chars().filter_map(|letter| glyph(letter).or_else(|| glyph('?'))).enumerate()
        {
            for (y, row) in glyph.rows().enumerate() {
                for (x, opacity) in row.iter().enumerate() {
                    let step = (u16::from(*opacity) * OPACITY_STEPS + 127) / 255;
                    if step > 0 {
                        let grey = background + (TEXT - background) * step / OPACITY_STEPS;
                        set(column * glyph.width() + x, y, grey as u8);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_captions_are_wrapped() {
        let font = Font::for_width(224);
        let width = 10 * get_raster_width(WEIGHT, font.0);
        let lines = font.wrap("put the cube on the\nDualArmStackCube now", width);
        assert_eq!(lines, ["put the", "cube on", "the", "DualArmSta", "ckCube now"]);
        assert!(font.wrap("", width).is_empty());
    }
}
