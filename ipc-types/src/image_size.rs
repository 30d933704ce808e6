//! Sizes of camera images, which a run chooses.

use core::fmt;
use core::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::morphology::Morphology;

/// Bytes of a pixel: red, green, blue.
pub const RGB_BYTES: usize = 3;

/// Size of an image in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct ImageSize {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
}

impl ImageSize {
    /// Smallest size of a camera.
    pub const MIN: Self = Self { width: 64, height: 64 };
    /// Largest size of a camera.
    pub const MAX: Self = Self { width: 1280, height: 960 };

    /// Returns the size of a square image.
    #[must_use]
    pub const fn square(side: usize) -> Self {
        Self { width: side, height: side }
    }

    /// Returns the number of pixels.
    #[must_use]
    pub const fn n_pixels(self) -> usize {
        self.width * self.height
    }

    /// Returns the number of bytes of an image `[height, width, 3] u8`.
    #[must_use]
    pub const fn n_bytes(self) -> usize {
        self.n_pixels() * RGB_BYTES
    }

    /// Returns `true` if cameras can have this size: if it lies between [`Self::MIN`] and [`Self::MAX`].
    #[must_use]
    pub const fn is_supported(self) -> bool {
        let is_wide = self.width >= Self::MIN.width && self.height >= Self::MIN.height;
        is_wide && self.width <= Self::MAX.width && self.height <= Self::MAX.height
    }
}

impl fmt::Display for ImageSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

impl From<ImageSize> for String {
    fn from(size: ImageSize) -> Self {
        size.to_string()
    }
}

impl FromStr for ImageSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('x').map(|(width, height)| (width.parse(), height.parse()));
        let size = match numbers {
            Some((Ok(width), Ok(height))) => Self { width, height },
            _ => return Err(format!("`{text}` is no image size, expected WIDTHxHEIGHT, such as 640x480")),
        };
        if size.is_supported() {
            Ok(size)
        } else {
            Err(format!("image size {size} is not supported, expected {} to {}", Self::MIN, Self::MAX))
        }
    }
}

impl TryFrom<String> for ImageSize {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

/// Image sizes of all cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct ImageSizes {
    /// Size of the external cameras.
    pub external: ImageSize,
    /// Size of the hand cameras.
    pub hand: ImageSize,
}

impl ImageSizes {
    /// Sizes of the benchmark's cameras (docs/benchmark.md, "Cameras").
    pub const BENCHMARK: Self = Self { external: ImageSize::square(224), hand: ImageSize::square(128) };

    /// Returns the size of a camera, in the order of [`Morphology::camera_names`].
    #[must_use]
    pub const fn of_camera(self, morphology: Morphology, camera_idx: usize) -> ImageSize {
        if camera_idx < morphology.n_external_cameras() { self.external } else { self.hand }
    }

    /// Returns the sizes of external and hand images.
    #[must_use]
    pub const fn all(self) -> [ImageSize; 2] {
        [self.external, self.hand]
    }
}

impl Default for ImageSizes {
    fn default() -> Self {
        Self::BENCHMARK
    }
}

impl fmt::Display for ImageSizes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { external, hand } = self;
        if external == hand { write!(f, "{external}") } else { write!(f, "{external},wrist={hand}") }
    }
}

impl From<ImageSizes> for String {
    fn from(sizes: ImageSizes) -> Self {
        sizes.to_string()
    }
}

impl TryFrom<String> for ImageSizes {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl FromStr for ImageSizes {
    type Err = String;

    /// Parses `WxH`, the size of all cameras, or `WxH,wrist=WxH`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (external, hand) = match text.split_once(',') {
            None => (text, text),
            Some((external, wrist)) => {
                let hand = wrist.strip_prefix("wrist=");
                let hand =
                    hand.ok_or_else(|| format!("found `{wrist}` after the comma, expected wrist=WxH"))?;
                (external, hand)
            }
        };
        Ok(Self { external: external.parse()?, hand: hand.parse()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_round_trip_through_text() {
        for text in ["640x480", "224x224,wrist=128x128", "64x64,wrist=1280x960"] {
            assert_eq!(text.parse::<ImageSizes>().map(|sizes| sizes.to_string()).as_deref(), Ok(text));
        }
        assert_eq!(ImageSizes::BENCHMARK.to_string(), "224x224,wrist=128x128");
    }

    #[test]
    fn unusable_sizes_are_refused() {
        for (text, expected) in [
            ("640", "`640` is no image size, expected WIDTHxHEIGHT, such as 640x480"),
            ("640x-480", "`640x-480` is no image size, expected WIDTHxHEIGHT, such as 640x480"),
            ("63x64", "image size 63x64 is not supported, expected 64x64 to 1280x960"),
            ("640x961", "image size 640x961 is not supported, expected 64x64 to 1280x960"),
            ("640x480,hand=64x64", "found `hand=64x64` after the comma, expected wrist=WxH"),
        ] {
            assert_eq!(text.parse::<ImageSizes>(), Err(expected.to_owned()));
        }
    }
}
