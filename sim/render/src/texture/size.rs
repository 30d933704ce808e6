//! The size of a texture in memory.

/// Side of a tile, in texels: a power of two.
pub(crate) const SIDE: usize = 256;

/// Distance between the rows of a tile, in texels, which is also their number. Each row and column continues
/// periodically by eight texels, so that a window of 8 × 8 texels can be read from any texel on without
/// wrapping.
pub(crate) const PITCH: usize = SIDE + 8;
