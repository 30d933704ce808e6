//! Surface attributes of pixels whose triangles differ, one lane per pixel.

use crate::cpu::simd::F32x16;

/// Surface attributes of sixteen pixels that show several triangles.
pub(crate) struct GatheredSurfaces {
    /// Normals in the view frame, not normalised.
    pub(crate) normal: [F32x16; 3],
    pub(crate) color: [F32x16; 3],
    /// The square roots of the textures' linear factors.
    pub(crate) tint: [F32x16; 3],
    pub(crate) specular: F32x16,
    pub(crate) metallic: F32x16,
    /// Bit i is set if lane i shows a textured surface.
    pub(crate) textured: u16,
}

impl GatheredSurfaces {
    /// Black, untextured surfaces.
    pub(crate) const EMPTY: Self = Self {
        normal: [F32x16::ZERO; 3],
        color: [F32x16::ZERO; 3],
        tint: [F32x16::ZERO; 3],
        specular: F32x16::ZERO,
        metallic: F32x16::ZERO,
        textured: 0,
    };
}
