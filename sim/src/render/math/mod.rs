//! Arithmetic shared by both renderers: affine transforms, trigonometry, the sRGB curve and 16-lane storage
//! types.
//!
//! Nothing here calls the system's libm, so every result is the same on every machine.

pub(super) mod affine;
pub(super) mod lanes;
pub(super) mod srgb;
pub(super) mod trig;
