//! Where images lie in a texture that holds many of them.

/// Width of every atlas in pixels.
pub(super) const WIDTH: u32 = 4096;
/// Sizes of images that one atlas tells apart: external cameras, hand cameras and one more.
const MAX_SIDES: usize = 4;

/// Rows of equal squares, one below the other.
#[derive(Default)]
pub(super) struct Atlas {
    /// Per side: the open row's y and the next free x.
    rows: [Option<Row>; MAX_SIDES],
    /// Pixels in use from the top.
    pub(super) height: u32,
}

#[derive(Clone, Copy)]
struct Row {
    side: u32,
    x: u32,
    y: u32,
}

impl Atlas {
    /// Forgets all places.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// A free square: its left upper pixel.
    ///
    /// # Panics
    /// If there are more than four different sides, or one is wider than the atlas.
    pub(super) fn place(&mut self, side: u32) -> [u32; 2] {
        assert!(side <= WIDTH, "an image of {side} pixels does not fit an atlas of {WIDTH}");
        let row = self
            .rows
            .iter_mut()
            .find(|row| row.is_none_or(|row| row.side == side))
            .expect("images of at most four sides");
        let open = match *row {
            Some(open) if open.x + side <= WIDTH => open,
            _ => {
                let y = self.height;
                self.height += side;
                Row { side, x: 0, y }
            }
        };
        *row = Some(Row { x: open.x + side, ..open });
        [open.x, open.y]
    }
}

#[cfg(test)]
mod tests {
    use super::{Atlas, WIDTH};

    #[test]
    fn squares_do_not_overlap() {
        let mut atlas = Atlas::default();
        let placed: Vec<([u32; 2], u32)> =
            (0..100).map(|i| if i % 3 == 2 { 128 } else { 224 }).map(|side| (atlas.place(side), side)).collect();
        for (i, ([x, y], side)) in placed.iter().enumerate() {
            assert!(x + side <= WIDTH && y + side <= atlas.height);
            for ([u, v], other) in &placed[..i] {
                let apart = x + side <= *u || u + other <= *x || y + side <= *v || v + other <= *y;
                assert!(apart, "{x} {y} {side} and {u} {v} {other}");
            }
        }
        assert_eq!(atlas.height, 4 * 224 + 2 * 128);
    }
}
