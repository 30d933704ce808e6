//! Sixteen numbers on a cache line: how arrays are laid out that vector code reads.

use bytemuck::{Pod, Zeroable};

/// Numbers on a line.
pub(super) const N_LANES: usize = 16;

/// Sixteen floats.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Line(pub(super) [f32; N_LANES]);

impl Line {
    /// Zero everywhere.
    pub(super) const ZERO: Self = Self([0.0; N_LANES]);
}

/// Sixteen integers.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct WholeLine(pub(super) [i32; N_LANES]);

impl WholeLine {
    /// The numbers of the lanes.
    pub(super) const NUMBERS: Self = Self([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]);
    /// Zero everywhere.
    pub(super) const ZERO: Self = Self([0; N_LANES]);
}

/// Sixteen short integers.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct ShortLine(pub(super) [i16; N_LANES]);

impl ShortLine {
    /// Zero everywhere.
    pub(super) const ZERO: Self = Self([0; N_LANES]);
}
