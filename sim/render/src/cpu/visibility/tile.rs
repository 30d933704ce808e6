//! Tile layouts: how sixteen neighbouring pixels or samples that are processed together map to lanes.

use ipc_types::ImageSize;

use crate::Samples;
use crate::cpu::simd::{F32x16, I32x16, N_LANES};

/// Layout of a tile of sixteen pixels or samples.
pub(crate) trait TileLayout {
    /// Binary logarithms of the width and height of a tile, in px.
    const BITS: [u32; 2];
    /// Column and row of each lane's pixel.
    const PIXELS: [[i32; 2]; N_LANES];
    /// Samples per pixel of the image.
    const SAMPLES: Samples = Samples::One;
    /// Number of samples along each edge of a pixel of the image.
    const SAMPLES_PER_EDGE: usize = 1;
    /// `true` if the buffer records triangle ids as well as depths.
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
    /// Column in the low 16 bits and row in the high 16 bits of each lane.
    const XY: I32x16 = lanes(&Self::PIXELS, 1, 1 << 16);
    /// Column of each lane's pixel.
    const X_FLOATS: F32x16 = as_floats(Self::X);
    /// Row of each lane's pixel.
    const Y_FLOATS: F32x16 = as_floats(Self::Y);
}

/// 4 × 4 pixels in row-major order. Few small triangles overlap more than four such tiles.
pub(crate) struct Tile4x4;

/// 2 × 2 pixels with 2 × 2 samples each: lane 4 s + p is sample s of pixel p.
pub(crate) struct MultisampleTile;

impl Tile4x4 {
    /// Lanes at the corners, in row-major order.
    pub(crate) const CORNERS: [usize; 4] = [0, 3, 12, 15];

    /// Returns the numbers of tiles in a row and in a column that cover an image. The last ones may extend
    /// beyond it.
    pub(crate) fn cover(size: ImageSize) -> [usize; 2] {
        [size.width.div_ceil(Self::WIDTH as usize), size.height.div_ceil(Self::HEIGHT as usize)]
    }
}

/// 4 × 4 texels of a shadow map, of which only the depths are recorded.
pub(crate) struct DepthTile;

impl TileLayout for Tile4x4 {
    const BITS: [u32; 2] = [2, 2];
    const PIXELS: [[i32; 2]; N_LANES] = row_major(4);
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

const fn row_major(width: usize) -> [[i32; 2]; N_LANES] {
    let mut pixels = [[0; 2]; N_LANES];
    let mut i = 0;
    while i < N_LANES {
        pixels[i] = [(i % width) as i32, (i / width) as i32];
        i += 1;
    }
    pixels
}

const fn sample_pixels() -> [[i32; 2]; N_LANES] {
    let mut pixels = [[0; 2]; N_LANES];
    let mut i = 0;
    while i < N_LANES {
        let (sample, pixel) = (i as i32 / 4, i as i32 % 4);
        pixels[i] = [pixel % 2 * 2 + sample % 2, pixel / 2 * 2 + sample / 2];
        i += 1;
    }
    pixels
}

const fn lanes(pixels: &[[i32; 2]; N_LANES], per_column: i32, per_row: i32) -> I32x16 {
    let mut lanes = I32x16::ZERO;
    let mut i = 0;
    while i < N_LANES {
        lanes.0[i] = pixels[i][0] * per_column + pixels[i][1] * per_row;
        i += 1;
    }
    lanes
}

const fn as_floats(whole: I32x16) -> F32x16 {
    let mut lanes = F32x16::ZERO;
    let mut i = 0;
    while i < N_LANES {
        lanes.0[i] = whole.0[i] as f32;
        i += 1;
    }
    lanes
}
