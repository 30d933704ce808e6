//! Layouts of rectangles: the bonds of bricks, tiles and boards. All repeat with period 1.

use super::shaping::fract;

/// The rectangle that contains a point, and the position of the point in it.
pub(crate) struct LayoutRect {
    /// Column and row of the rectangle. They repeat with the tile.
    pub(crate) id: [i32; 2],
    /// Position along the longer side, in tiles.
    pub(crate) along: f32,
    /// Position along the shorter side, in tiles.
    pub(crate) across: f32,
    /// Distance to the nearest edge, in tiles.
    pub(crate) edge_distance: f32,
}

impl LayoutRect {
    fn new(id: [i32; 2], at: [f32; 2], size: [f32; 2]) -> Self {
        let to_edge = |i: usize| at[i].min(size[i] - at[i]);
        let long = usize::from(size[1] > size[0]);
        Self { id, along: at[long], across: at[1 - long], edge_distance: to_edge(0).min(to_edge(1)) }
    }
}

/// Running bond: rows of equal rectangles, each row shifted by `shift` rectangles against the one above.
/// `shift` · rows must be an integer.
pub(crate) fn courses(u: f32, v: f32, [cols, rows]: [i32; 2], shift: f32) -> LayoutRect {
    let (n_cols, n_rows) = (cols as f32, rows as f32);
    let row = (v * n_rows).floor() as i32;
    let x = u * n_cols + shift * row.rem_euclid(rows) as f32;
    LayoutRect::new(
        [x.floor() as i32, row],
        [fract(x) / n_cols, v - row as f32 / n_rows],
        [1.0 / n_cols, 1.0 / n_rows],
    )
}

/// Flemish bond: each row alternates stretchers and headers of half their length, with headers centred over
/// stretchers. A row has `pairs` of both, the number of rows is even, and headers have odd columns.
pub(crate) fn flemish(u: f32, v: f32, [pairs, rows]: [i32; 2]) -> LayoutRect {
    const LONG: f32 = 2.0 / 3.0;
    let (n_pairs, n_rows) = (pairs as f32, rows as f32);
    let row = (v * n_rows).floor() as i32;
    let x = u * n_pairs + 0.5 * (row & 1) as f32;
    let (pair, short) = (x.floor() as i32, fract(x) > LONG);
    let (start, size) = if short { (LONG, 1.0 - LONG) } else { (0.0, LONG) };
    LayoutRect::new(
        [2 * pair + i32::from(short), row],
        [(fract(x) - start) / n_pairs, v - row as f32 / n_rows],
        [size / n_pairs, 1.0 / n_rows],
    )
}

/// Basket weave: `squares` × `squares` squares, an even number per side, of `strips` parallel strips each,
/// rotated by 90° from one square to the next. Ids have `squares` columns and `squares` · `strips` rows.
pub(crate) fn basket(u: f32, v: f32, squares: i32, strips: i32) -> LayoutRect {
    let side = 1.0 / squares as f32;
    let [col, row] = [u, v].map(|t| (t * squares as f32).floor() as i32);
    let (x, y) = (u - col as f32 * side, v - row as f32 * side);
    let (along, across) = if (col + row) & 1 == 0 { (x, y) } else { (y, x) };
    let width = side / strips as f32;
    let strip = (across / width) as i32;
    LayoutRect::new([col, row * strips + strip], [along, across - strip as f32 * width], [side, width])
}

/// Herringbone of rectangles one cell wide and `length` cells long. The tile has n × n cells, n a multiple of
/// 2 · `length`. The id is the first cell of a rectangle.
pub(crate) fn herringbone(u: f32, v: f32, n: i32, length: i32) -> LayoutRect {
    let (x, y) = (u * n as f32, v * n as f32);
    let (col, row) = (x.floor() as i32, y.floor() as i32);
    let (fx, fy) = (fract(x), fract(y));
    // The sequence of horizontal and vertical rectangles shifts by one cell from row to row.
    let phase = (col - row).rem_euclid(2 * length);
    let (id, along, across) = if phase < length {
        ([col - phase, row], phase as f32 + fx, fy)
    } else {
        let past = 2 * length - 1 - phase;
        ([col, row - past], past as f32 + fy, fx)
    };
    let cell = 1.0 / n as f32;
    LayoutRect::new(id, [along * cell, across * cell], [length as f32 * cell, cell])
}
