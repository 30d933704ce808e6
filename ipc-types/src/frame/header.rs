//! The two header types of messages.

use bytemuck::{Pod, Zeroable};

use super::error::FrameError;
use crate::checksum::checksum;
use crate::image_size::{ImageSize, ImageSizes};
use crate::layout::{Page, block_pages};
use crate::morphology::Morphology;

/// Header of an observation message, stored separately from its pages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ObservationHeader {
    /// [`SCHEMA_HASH`](crate::SCHEMA_HASH) of the sender.
    pub schema_hash: u64,
    /// Random number of the run.
    pub run: u64,
    /// Number of this observation message in its lane, counted from 1. The action message repeats it.
    pub sequence: u64,
    /// Changes whenever a sim or policy host of this lane is replaced; the sim drops answers from another
    /// epoch.
    pub epoch: u32,
    /// Number of envs in the message, at least 1.
    pub n_envs: u32,
    /// Pages of one env's block.
    pub block_pages: u32,
    /// [`Morphology::code`] of all envs in the message.
    pub morphology: u32,
    /// [`ControlMode::code`](crate::ControlMode::code) by which the sim will interpret the actions.
    pub control_mode: u32,
    /// 1 if the blocks contain images, otherwise 0.
    pub images: u32,
    /// 1 if `checksum` is set, otherwise 0. The answer then has a checksum, too.
    pub has_checksum: u32,
    /// CRC-32 (as in zlib) of this header, with 0 in place of the checksum, and the pages.
    pub checksum: u32,
    /// Widths and heights in pixels: of the external cameras, then of the hand cameras; zero without images.
    pub image_sizes: [u16; 4],
}

/// Header of an action message, stored separately from its pages: one [`ActionBlock`](crate::ActionBlock) per
/// env.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ActionHeader {
    /// [`SCHEMA_HASH`](crate::SCHEMA_HASH) of the sender.
    pub schema_hash: u64,
    /// Copied from the observation's header.
    pub run: u64,
    /// Copied from the observation's header.
    pub sequence: u64,
    /// Copied from the observation's header.
    pub epoch: u32,
    /// Number of envs: those of the observation, in the same order.
    pub n_envs: u32,
    /// 0 on success. [`Self::DAMAGED`] means that the observation did not match its checksum, any other value
    /// that the policy failed; the host's log contains the reason.
    pub status: u32,
    /// 1 if `checksum` is set, otherwise 0.
    pub has_checksum: u32,
    /// CRC-32 (as in zlib) of this header, with 0 in place of the checksum, and the pages.
    pub checksum: u32,
    /// Reserved for future fields; always zero.
    pub reserved: [u32; 5],
}

impl ObservationHeader {
    /// Returns this header for envs of a morphology, with images of these sizes or without images.
    #[must_use]
    pub fn with_images(self, morphology: Morphology, images: Option<ImageSizes>) -> Self {
        let sizes = images.map(|sizes| {
            let ImageSizes { external, hand } = sizes;
            [external.width, external.height, hand.width, hand.height].map(|length| length as u16)
        });
        Self {
            block_pages: block_pages(morphology, images) as u32,
            morphology: morphology.code(),
            images: u32::from(images.is_some()),
            image_sizes: sizes.unwrap_or_default(),
            ..self
        }
    }

    /// Returns the sizes of the images, or `None` if there are none.
    pub(crate) fn image_sizes(&self) -> Result<Option<ImageSizes>, FrameError> {
        let invalid = |field, expected, found| FrameError::Header { field, expected, found };
        let [width, height, hand_width, hand_height] = self.image_sizes.map(usize::from);
        let external = ImageSize { width, height };
        let hand = ImageSize { width: hand_width, height: hand_height };
        match self.images {
            0 => Ok(None),
            1 if external.is_supported() && hand.is_supported() => Ok(Some(ImageSizes { external, hand })),
            1 => {
                let found = bytemuck::cast(self.image_sizes.map(u16::to_le));
                Err(invalid("image_sizes", "64x64 to 1280x960 pixels", u64::from_le(found)))
            }
            images => Err(invalid("images", "0 or 1", u64::from(images))),
        }
    }
}

impl ActionHeader {
    /// [`Self::status`] of the answer to an observation that does not match its checksum.
    pub const DAMAGED: u32 = 2;
}

/// Implements the checksum of a header type, which has the fields `has_checksum` and `checksum`.
macro_rules! impl_checksum {
    ($header:ty) => {
        impl $header {
            /// Returns this header with the checksum of itself and `pages`.
            #[must_use]
            pub fn with_checksum(self, pages: &[Page]) -> Self {
                let header = Self { has_checksum: 1, checksum: 0, ..self };
                Self { checksum: checksum(&header, pages), ..header }
            }

            /// Checks that this header and `pages` are as they were sent.
            ///
            /// # Errors
            /// If the checksum is missing or differs.
            pub fn check_checksum(&self, pages: &[Page]) -> Result<(), FrameError> {
                compare_checksums(self.checksum, self.with_checksum(pages).checksum, self.has_checksum)
            }
        }
    };
}

impl_checksum!(ObservationHeader);
impl_checksum!(ActionHeader);

const _: () = {
    use core::mem::{offset_of, size_of};
    assert!(size_of::<ObservationHeader>() == 64 && size_of::<ActionHeader>() == 64);
    assert!(offset_of!(ObservationHeader, epoch) == 24 && offset_of!(ObservationHeader, images) == 44);
    assert!(offset_of!(ActionHeader, n_envs) == 28 && offset_of!(ActionHeader, status) == 32);
    assert!(offset_of!(ObservationHeader, image_sizes) == 56);
    assert!(offset_of!(ObservationHeader, checksum) == 52 && offset_of!(ActionHeader, checksum) == 40);
};

/// Compares the `found` checksum of a message with that of its bytes.
fn compare_checksums(found: u32, expected: u32, has_checksum: u32) -> Result<(), FrameError> {
    if has_checksum != 1 {
        let (field, found) = ("has_checksum", u64::from(has_checksum));
        Err(FrameError::Header { field, expected: "1", found })
    } else if found != expected {
        Err(FrameError::Checksum { expected, found })
    } else {
        Ok(())
    }
}
