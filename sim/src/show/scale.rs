//! Images at several times the resolution of the observations, for videos.

use std::ops::RangeInclusive;

use ipc_types::{ImageSize, ImageSizes};

/// Supported scale factors.
pub const SCALES: RangeInclusive<usize> = 1..=8;

/// Returns sizes with `scale` times as many pixels along each edge.
///
/// # Panics
/// If `scale` is not in [`SCALES`].
#[must_use]
pub fn scaled(sizes: ImageSizes, scale: usize) -> ImageSizes {
    assert!(SCALES.contains(&scale), "scale {scale} is not in {SCALES:?}");
    let times = |size: ImageSize| ImageSize { width: size.width * scale, height: size.height * scale };
    ImageSizes { external: times(sizes.external), hand: times(sizes.hand) }
}
