//! Sixteen neighbouring pixels or samples that are worked on together, and how they lie.

use crate::render::Samples;
use crate::render::cpu::simd::{F32x16, I32x16, N_LANES};

/// A way to lay out what is rasterised.
pub(in crate::render::cpu) trait TileLayout {
    /// Binary logarithms of a tile's width and height in px.
    const BITS: [u32; 2];
    /// Column and row of each lane's pixel.
    const PIXELS: [[i32; 2]; N_LANES];
    /// How an image's pixel is sampled.
    const SAMPLES: Samples = Samples::One;
    /// VisibilityTarget of the rasteriser's grid along each edge of an image's pixel.
    const SAMPLES_PER_EDGE: usize = 1;
    /// Whether it matters which triangle a pixel shows.
    const WITH_IDS: bool;

    /// Binary logarithm of the width.
    const WIDTH_BITS: u32 = Self::BITS[0];
    /// Width in px.
    const WIDTH: i32 = 1 << Self::BITS[0];
    /// Binary logarithm of the height.
    const HEIGHT_BITS: u32 = Self::BITS[1];
    /// Height in px.
    const HEIGHT: i32 = 1 << Self::BITS[1];
    /// Column of each lane's pixel.
    const X: I32x16 = lanes(&Self::PIXELS, 1, 0);
    /// Row of each lane's pixel.
    const Y: I32x16 = lanes(&Self::PIXELS, 0, 1);
    /// Column in the lower 16 bits, row in the upper ones.
    const XY: I32x16 = lanes(&Self::PIXELS, 1, 1 << 16);
    /// Column of each lane's pixel.
    const X_FLOATS: F32x16 = as_floats(Self::X);
    /// Row of each lane's pixel.
    const Y_FLOATS: F32x16 = as_floats(Self::Y);
}

/// 4 × 4 pixels, row by row: few small triangles reach into more than four of them.
pub(in crate::render::cpu) struct Tile4x4;

/// 2 × 2 pixels of 2 × 2 samples each: lane 4 s + p is sample s of pixel p.
pub(in crate::render::cpu) struct MultisampleTile;

impl Tile4x4 {
    /// The lanes at the corners, row by row.
    pub(in crate::render::cpu) const CORNERS: [usize; 4] = [0, 3, 12, 15];
}

/// The same, of which only the depths matter.
pub(in crate::render::cpu) struct DepthTile;

impl TileLayout for Tile4x4 {
    const BITS: [u32; 2] = [2, 2];
    const PIXELS: [[i32; 2]; N_LANES] = places(4);
    const WITH_IDS: bool = true;
}

impl TileLayout for MultisampleTile {
    const BITS: [u32; 2] = [2, 2];
    const PIXELS: [[i32; 2]; N_LANES] = sample_pixels();
    const SAMPLES: Samples = Samples::Four;
    const SAMPLES_PER_EDGE: usize = 2;
    const WITH_IDS: bool = true;
}

impl TileLayout for DepthTile {
    const BITS: [u32; 2] = Tile4x4::BITS;
    const PIXELS: [[i32; 2]; N_LANES] = Tile4x4::PIXELS;
    const WITH_IDS: bool = false;
}

const fn places(width: usize) -> [[i32; 2]; N_LANES] {
    let mut places = [[0; 2]; N_LANES];
    let mut i = 0;
    while i < N_LANES {
        places[i] = [(i % width) as i32, (i / width) as i32];
        i += 1;
    }
    places
}

const fn sample_pixels() -> [[i32; 2]; N_LANES] {
    let mut places = [[0; 2]; N_LANES];
    let mut i = 0;
    while i < N_LANES {
        let (sample, pixel) = (i as i32 / 4, i as i32 % 4);
        places[i] = [pixel % 2 * 2 + sample % 2, pixel / 2 * 2 + sample / 2];
        i += 1;
    }
    places
}

const fn lanes(places: &[[i32; 2]; N_LANES], per_column: i32, per_row: i32) -> I32x16 {
    let mut line = I32x16::ZERO;
    let mut i = 0;
    while i < N_LANES {
        line.0[i] = places[i][0] * per_column + places[i][1] * per_row;
        i += 1;
    }
    line
}

const fn as_floats(whole: I32x16) -> F32x16 {
    let mut line = F32x16::ZERO;
    let mut i = 0;
    while i < N_LANES {
        line.0[i] = whole.0[i] as f32;
        i += 1;
    }
    line
}
