//! Arithmetic shared by both renderers: affine transforms, trigonometry, the sRGB curve and 16-lane storage
//! types.
//!
//! Nothing here calls the system's libm, so every result is the same on every machine.

pub(crate) mod affine;
pub(crate) mod lanes;
pub(crate) mod srgb;
pub(crate) mod trig;
