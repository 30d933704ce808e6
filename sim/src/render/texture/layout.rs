//! How rectangles are laid: the bonds of bricks, tiles and boards.

use super::shaping::wrap;

/// A rectangle, as seen from a point in it.
pub(super) struct Block {
    /// Column and row that name it; they repeat with the tile.
    pub(super) id: [i32; 2],
    /// Place along its longer side, in tiles.
    pub(super) along: f32,
    /// Place across, in tiles.
    pub(super) across: f32,
    /// Distance to its nearest edge, in tiles.
    pub(super) edge: f32,
}

impl Block {
    fn new(id: [i32; 2], at: [f32; 2], size: [f32; 2]) -> Self {
        let to_edge = |i: usize| at[i].min(size[i] - at[i]);
        let long = usize::from(size[1] > size[0]);
        Self { id, along: at[long], across: at[1 - long], edge: to_edge(0).min(to_edge(1)) }
    }
}

/// Rows of equal blocks, each row `shift` of a block further than the one above; `shift` · rows is whole.
pub(super) fn courses(u: f32, v: f32, [cols, rows]: [i32; 2], shift: f32) -> Block {
    let (n_cols, n_rows) = (cols as f32, rows as f32);
    let row = (v * n_rows).floor() as i32;
    let x = u * n_cols + shift * row.rem_euclid(rows) as f32;
    Block::new(
        [x.floor() as i32, row],
        [wrap(x) / n_cols, v - row as f32 / n_rows],
        [1.0 / n_cols, 1.0 / n_rows],
    )
}

/// Flemish bond: in each row a long block and one of half its length take turns, and the short ones stand over the
/// middles of the long ones. `pairs` make a row; the number of rows is even. Short blocks have odd columns.
pub(super) fn flemish(u: f32, v: f32, [pairs, rows]: [i32; 2]) -> Block {
    const LONG: f32 = 2.0 / 3.0;
    let (n_pairs, n_rows) = (pairs as f32, rows as f32);
    let row = (v * n_rows).floor() as i32;
    let x = u * n_pairs + 0.5 * (row & 1) as f32;
    let (pair, short) = (x.floor() as i32, wrap(x) > LONG);
    let (start, size) = if short { (LONG, 1.0 - LONG) } else { (0.0, LONG) };
    Block::new(
        [2 * pair + i32::from(short), row],
        [(wrap(x) - start) / n_pairs, v - row as f32 / n_rows],
        [size / n_pairs, 1.0 / n_rows],
    )
}

/// Basket weave: `squares` × `squares` squares, an even number, of `strips` parallel blocks each, turned by a right
/// angle from one square to the next. Ids run over `squares` columns and `squares` · `strips` rows.
pub(super) fn basket(u: f32, v: f32, squares: i32, strips: i32) -> Block {
    let side = 1.0 / squares as f32;
    let [col, row] = [u, v].map(|t| (t * squares as f32).floor() as i32);
    let (x, y) = (u - col as f32 * side, v - row as f32 * side);
    let (along, across) = if (col + row) & 1 == 0 { (x, y) } else { (y, x) };
    let width = side / strips as f32;
    let strip = (across / width) as i32;
    Block::new([col, row * strips + strip], [along, across - strip as f32 * width], [side, width])
}

/// Herringbone of blocks one cell wide and `length` cells long; the tile has n × n cells, n a multiple of
/// 2 · `length`. Ids are the cell of a block's first end.
pub(super) fn herringbone(u: f32, v: f32, n: i32, length: i32) -> Block {
    let (x, y) = (u * n as f32, v * n as f32);
    let (col, row) = (x.floor() as i32, y.floor() as i32);
    let (fx, fy) = (wrap(x), wrap(y));
    // From one row to the next the sequence of lying blocks and the columns of standing ones moves by one cell.
    let place = (col - row).rem_euclid(2 * length);
    let (id, along, across) = if place < length {
        ([col - place, row], place as f32 + fx, fy)
    } else {
        let past = 2 * length - 1 - place;
        ([col, row - past], past as f32 + fy, fx)
    };
    let cell = 1.0 / n as f32;
    Block::new(id, [along * cell, across * cell], [length as f32 * cell, cell])
}
