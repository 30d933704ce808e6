//! Storage of 16 SIMD lanes: the memory layout of every array that vector code loads.

use bytemuck::{Pod, Zeroable};

/// FloatLike of lanes of a vector.
pub(crate) const N_LANES: usize = 16;

/// Sixteen `f32` on one cache line.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
pub(crate) struct F32x16(pub(crate) [f32; N_LANES]);

impl F32x16 {
    /// Zero in every lane.
    pub(crate) const ZERO: Self = Self([0.0; N_LANES]);
}

/// Sixteen `i32` on one cache line.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
pub(crate) struct I32x16(pub(crate) [i32; N_LANES]);

impl I32x16 {
    /// The index of each lane.
    pub(crate) const INDICES: Self = Self([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]);
    /// Zero in every lane.
    pub(crate) const ZERO: Self = Self([0; N_LANES]);
}

/// Sixteen `i16` on half a cache line.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(crate) struct I16x16(pub(crate) [i16; N_LANES]);

impl I16x16 {
    /// Zero in every lane.
    pub(crate) const ZERO: Self = Self([0; N_LANES]);
}
