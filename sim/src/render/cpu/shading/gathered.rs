//! Surface attributes of pixels whose triangles differ, one lane per pixel.

use crate::render::cpu::simd::F32x16;

/// Surface attributes of sixteen pixels that show several triangles.
pub(in crate::render::cpu) struct GatheredSurfaces {
    /// Normals in the view frame, not normalised.
    pub(in crate::render::cpu) normal: [F32x16; 3],
    pub(in crate::render::cpu) color: [F32x16; 3],
    /// The square roots of the textures' linear factors.
    pub(in crate::render::cpu) tint: [F32x16; 3],
    pub(in crate::render::cpu) specular: F32x16,
    pub(in crate::render::cpu) metallic: F32x16,
    /// Bit i is set if lane i shows a textured surface.
    pub(in crate::render::cpu) textured: u16,
}

impl GatheredSurfaces {
    /// Black, untextured surfaces.
    pub(in crate::render::cpu) const EMPTY: Self = Self {
        normal: [F32x16::ZERO; 3],
        color: [F32x16::ZERO; 3],
        tint: [F32x16::ZERO; 3],
        specular: F32x16::ZERO,
        metallic: F32x16::ZERO,
        textured: 0,
    };
}
