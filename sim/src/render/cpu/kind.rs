//! Two ways to lay out what is rasterised: pictures in squares of pixels, shadow maps row by row.

use super::simd::{Line, N_LANES, WholeLine};

/// Sixteen neighbouring pixels that are worked on together.
pub(super) trait Block {
    /// Binary logarithm of a block's width in px; its height is 16 px over the width.
    const WIDTH_BITS: u32;
    /// Whether it matters which triangle a pixel shows.
    const WITH_IDS: bool;

    /// Width in px.
    const WIDTH: i32 = 1 << Self::WIDTH_BITS;
    /// Binary logarithm of the height in px.
    const HEIGHT_BITS: u32 = N_LANES.ilog2() - Self::WIDTH_BITS;
    /// Height in px.
    const HEIGHT: i32 = 1 << Self::HEIGHT_BITS;
    /// Column of each lane's pixel.
    const X: WholeLine = lanes(Self::WIDTH, 1, 0);
    /// Row of each lane's pixel.
    const Y: WholeLine = lanes(Self::WIDTH, 0, 1);
    /// Column in the lower 16 bits, row in the upper ones.
    const XY: WholeLine = lanes(Self::WIDTH, 1, 1 << 16);
    /// Column of each lane's pixel.
    const X_FLOATS: Line = floats(Self::X);
    /// Row of each lane's pixel.
    const Y_FLOATS: Line = floats(Self::Y);
}

/// 4 × 4 pixels: few small triangles reach into more than four of them.
pub(super) struct Square;

/// 16 pixels of a row, so that the whole is row-major.
pub(super) struct Row;

impl Block for Square {
    const WIDTH_BITS: u32 = 2;
    const WITH_IDS: bool = true;
}

impl Block for Row {
    const WIDTH_BITS: u32 = 4;
    const WITH_IDS: bool = false;
}

const fn lanes(width: i32, per_column: i32, per_row: i32) -> WholeLine {
    let mut line = WholeLine::ZERO;
    let mut i = 0;
    while i < N_LANES {
        line.0[i] = (i as i32 % width) * per_column + (i as i32 / width) * per_row;
        i += 1;
    }
    line
}

const fn floats(whole: WholeLine) -> Line {
    let mut line = Line::ZERO;
    let mut i = 0;
    while i < N_LANES {
        line.0[i] = whole.0[i] as f32;
        i += 1;
    }
    line
}
