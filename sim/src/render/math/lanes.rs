//! Sixteen numbers on a cache line: how arrays are laid out that vector code reads.

use bytemuck::{Pod, Zeroable};

/// Numbers on a line.
pub(in crate::render) const N_LANES: usize = 16;

/// Sixteen floats.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
pub(in crate::render) struct F32x16(pub(in crate::render) [f32; N_LANES]);

impl F32x16 {
    /// Zero everywhere.
    pub(in crate::render) const ZERO: Self = Self([0.0; N_LANES]);
}

/// Sixteen integers.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
pub(in crate::render) struct I32x16(pub(in crate::render) [i32; N_LANES]);

impl I32x16 {
    /// The numbers of the lanes.
    pub(in crate::render) const INDICES: Self = Self([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]);
    /// Zero everywhere.
    pub(in crate::render) const ZERO: Self = Self([0; N_LANES]);
}

/// Sixteen short integers.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(in crate::render) struct I16x16(pub(in crate::render) [i16; N_LANES]);

impl I16x16 {
    /// Zero everywhere.
    pub(in crate::render) const ZERO: Self = Self([0; N_LANES]);
}
