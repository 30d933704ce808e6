//! Messages: the two 64-byte header types, and views that give access to each env's tensors in place.
//!
//! A view is constructed from a header and the pages of a message and validates one against the other once.
//! After that, every access returns a slice of the mapped memory; nothing is copied.

mod error;
mod header;

pub use error::FrameError;
pub use header::{ActionHeader, ObservationHeader};

use crate::image_size::{ImageSize, ImageSizes};
use crate::layout::{
    ACTION_PAGES, ActionBlock, EXTERNAL_OFFSET, EnvRecord, INSTRUCTION_BYTES, MAX_ACTION_DIM, MAX_HORIZON,
    Page, SCHEMA_HASH, block_pages, hand_offset,
};
use crate::morphology::{ControlMode, Morphology};

/// A validated observation message.
#[derive(Clone, Copy, Debug)]
pub struct ObservationView<'a> {
    header: ObservationHeader,
    morphology: Morphology,
    control_mode: ControlMode,
    image_sizes: Option<ImageSizes>,
    pages: &'a [Page],
}

/// One env of an observation message. Every slice points into the message.
#[derive(Clone, Copy, Debug)]
pub struct EnvObservation<'a> {
    /// Fixed-size fields of the env's block.
    pub record: &'a EnvRecord,
    /// State vector, `[state_dim] f32`; see [`Morphology::state_parts`].
    pub state: &'a [f32],
    /// Language instruction; may be empty.
    pub instruction: &'a str,
    /// External images, `[2, height, width, 3] u8` sRGB; empty if the message has no images.
    pub external: &'a [u8],
    /// Hand images, `[n_arms, height, width, 3] u8` sRGB; empty if the message has no images.
    pub hand: &'a [u8],
    /// Sizes of the images; `None` if the message has no images.
    pub image_sizes: Option<ImageSizes>,
}

impl<'a> EnvObservation<'a> {
    /// Returns a camera's image, `[height, width, 3] u8`, and its size. Cameras are indexed in the order of
    /// [`Morphology::camera_names`].
    ///
    /// # Panics
    /// If there is no such camera, or the message has no images.
    #[must_use]
    pub fn image(&self, camera_idx: usize) -> (&'a [u8], ImageSize) {
        let images = self.images().nth(camera_idx);
        images.expect("the message has images, and the robot has this camera")
    }

    /// Returns the images of all cameras with their sizes, in the order of [`Morphology::camera_names`]; none
    /// if the message has no images.
    pub fn images(&self) -> impl Iterator<Item = (&'a [u8], ImageSize)> + use<'a> {
        let (external, hand) = (self.external, self.hand);
        self.image_sizes.into_iter().flat_map(move |sizes| {
            let images = |bytes: &'a [u8], size: ImageSize| {
                bytes.chunks_exact(size.n_bytes()).map(move |image| (image, size))
            };
            images(external, sizes.external).chain(images(hand, sizes.hand))
        })
    }
}

impl<'a> ObservationView<'a> {
    /// Validates a message: its header, the number of pages, and the lengths in each env's record.
    ///
    /// # Errors
    /// Names the first invalid field.
    pub fn new(header: ObservationHeader, pages: &'a [Page]) -> Result<Self, FrameError> {
        check_schema(header.schema_hash)?;
        let invalid =
            |field, expected, found: u32| FrameError::Header { field, expected, found: u64::from(found) };
        let morphology = Morphology::from_code(header.morphology).ok_or(invalid(
            "morphology",
            "0 or 1",
            header.morphology,
        ))?;
        let control_mode = ControlMode::from_code(header.control_mode).ok_or(invalid(
            "control_mode",
            "0 to 2",
            header.control_mode,
        ))?;
        let image_sizes = header.image_sizes()?;
        if header.n_envs == 0 {
            return Err(invalid("n_envs", "at least 1", 0));
        }
        if header.block_pages as usize != block_pages(morphology, image_sizes) {
            return Err(invalid(
                "block_pages",
                "the block size of this morphology with images of these sizes",
                header.block_pages,
            ));
        }
        let expected = u64::from(header.n_envs) * u64::from(header.block_pages);
        if pages.len() as u64 != expected {
            return Err(FrameError::Length { expected, found: pages.len() as u64 });
        }
        let view = Self { header, morphology, control_mode, image_sizes, pages };
        (0..view.n_envs()).try_for_each(|env_idx| view.check_record(env_idx))?;
        Ok(view)
    }

    /// Returns the message's header.
    #[must_use]
    pub fn header(&self) -> &ObservationHeader {
        &self.header
    }

    /// Returns the number of envs in the message.
    #[must_use]
    pub fn n_envs(&self) -> usize {
        self.header.n_envs as usize
    }

    /// Returns the morphology of all envs in the message.
    #[must_use]
    pub fn morphology(&self) -> Morphology {
        self.morphology
    }

    /// Returns the control mode by which the sim will interpret the actions.
    #[must_use]
    pub fn control_mode(&self) -> ControlMode {
        self.control_mode
    }

    /// Returns the sizes of the images, or `None` if the message has none.
    #[must_use]
    pub fn image_sizes(&self) -> Option<ImageSizes> {
        self.image_sizes
    }

    /// Returns the tensors of env `env_idx`.
    ///
    /// # Panics
    /// If `env_idx >= n_envs`.
    #[must_use]
    pub fn env(&self, env_idx: usize) -> EnvObservation<'a> {
        let bytes: &'a [u8] = bytemuck::cast_slice(self.block(env_idx));
        let record = self.record(env_idx);
        let text = &record.instruction[..record.instruction_len as usize];
        let (external, hand) = match self.image_sizes {
            Some(sizes) => {
                let hand = &bytes[hand_offset(sizes)..];
                let hand_bytes = self.morphology.n_hand_cameras() * sizes.hand.n_bytes();
                (&bytes[EXTERNAL_OFFSET..hand_offset(sizes)], &hand[..hand_bytes])
            }
            None => (&bytes[..0], &bytes[..0]),
        };
        EnvObservation {
            record,
            state: &record.state[..record.state_dim as usize],
            instruction: core::str::from_utf8(text).unwrap_or_default(),
            external,
            hand,
            image_sizes: self.image_sizes,
        }
    }

    fn block(&self, env_idx: usize) -> &'a [Page] {
        let block_pages = self.header.block_pages as usize;
        &self.pages[env_idx * block_pages..(env_idx + 1) * block_pages]
    }

    fn record(&self, env_idx: usize) -> &'a EnvRecord {
        bytemuck::cast_ref(&self.block(env_idx)[0])
    }

    fn check_record(&self, env_idx: usize) -> Result<(), FrameError> {
        let record = self.record(env_idx);
        check_limit(env_idx, "state_dim", record.state_dim, self.morphology.state_dim())?;
        check_limit(env_idx, "instruction_len", record.instruction_len, INSTRUCTION_BYTES)?;
        check_range(env_idx, "execute", record.execute, MAX_HORIZON)?;
        let text = &record.instruction[..record.instruction_len as usize];
        core::str::from_utf8(text).map_or(Err(FrameError::Instruction { env_idx }), |_| Ok(()))
    }
}

/// A validated action message.
#[derive(Clone, Copy, Debug)]
pub struct ActionView<'a> {
    header: ActionHeader,
    blocks: &'a [ActionBlock],
}

impl<'a> ActionView<'a> {
    /// Validates a message's header and sizes. The action values are checked per env with
    /// [`Self::check_finite`], so that one env's invalid answer does not affect the others. If the status is
    /// not 0, the pages may contain anything: they are not read, and the view has no blocks.
    ///
    /// # Errors
    /// Names the first invalid field.
    pub fn new(header: ActionHeader, pages: &'a [Page]) -> Result<Self, FrameError> {
        check_schema(header.schema_hash)?;
        let expected = u64::from(header.n_envs) * ACTION_PAGES as u64;
        if pages.len() as u64 != expected {
            return Err(FrameError::Length { expected, found: pages.len() as u64 });
        }
        if header.status != 0 {
            return Ok(Self { header, blocks: &[] });
        }
        let blocks: &[ActionBlock] = bytemuck::cast_slice(pages);
        for (env_idx, block) in blocks.iter().enumerate() {
            check_range(env_idx, "n_rows", block.n_rows, MAX_HORIZON)?;
            check_range(env_idx, "action_dim", block.action_dim, MAX_ACTION_DIM)?;
        }
        Ok(Self { header, blocks })
    }

    /// Returns the message's header.
    #[must_use]
    pub fn header(&self) -> &ActionHeader {
        &self.header
    }

    /// Checks that every action value of env `env_idx` is finite.
    ///
    /// # Errors
    /// Returns the position of the first non-finite value.
    ///
    /// # Panics
    /// If `env_idx` is not less than the number of blocks.
    pub fn check_finite(&self, env_idx: usize) -> Result<(), FrameError> {
        let block = &self.blocks[env_idx];
        let dim = block.action_dim as usize;
        let rows = &block.rows[..block.n_rows as usize * dim];
        match rows.iter().position(|x| !x.is_finite()) {
            None => Ok(()),
            Some(at) => Err(FrameError::NotFinite { env_idx, row: at / dim, entry: at % dim }),
        }
    }

    /// Returns one block per env, in the order of the observation, or none if the policy failed.
    #[must_use]
    pub fn blocks(&self) -> &'a [ActionBlock] {
        self.blocks
    }
}

/// Mutable tensors of one env's block, for the sim to fill.
#[derive(Debug)]
pub struct EnvBlockMut<'a> {
    /// Fixed-size fields, including state and instruction.
    pub record: &'a mut EnvRecord,
    /// External images, `[2, height, width, 3] u8` sRGB; empty without images.
    pub external: &'a mut [u8],
    /// Hand images, `[n_arms, height, width, 3] u8` sRGB; empty without images.
    pub hand: &'a mut [u8],
    sizes: ImageSizes,
}

impl<'a> EnvBlockMut<'a> {
    /// Splits the pages of one block into its tensors.
    ///
    /// # Panics
    /// If the number of pages is not [`block_pages`] of this morphology and these images.
    #[must_use]
    pub fn new(morphology: Morphology, images: Option<ImageSizes>, block: &'a mut [Page]) -> Self {
        assert_eq!(block.len(), block_pages(morphology, images), "pages of a {} block", morphology.name());
        let (first, rest) = block.split_at_mut(1);
        let rest: &mut [u8] = bytemuck::cast_slice_mut(rest);
        let sizes = images.unwrap_or_default();
        let n_external = images.map_or(0, |sizes| 2 * sizes.external.n_bytes());
        let n_hand = images.map_or(0, |sizes| morphology.n_hand_cameras() * sizes.hand.n_bytes());
        let (external, rest) = rest.split_at_mut(n_external);
        Self { record: bytemuck::cast_mut(&mut first[0]), external, hand: &mut rest[..n_hand], sizes }
    }

    /// Returns the images of all cameras, `[height, width, 3] u8`, in the order of
    /// [`Morphology::camera_names`]; none without images.
    pub fn images(self) -> impl Iterator<Item = &'a mut [u8]> {
        let external = self.external.chunks_exact_mut(self.sizes.external.n_bytes());
        external.chain(self.hand.chunks_exact_mut(self.sizes.hand.n_bytes()))
    }
}

fn check_schema(found: u64) -> Result<(), FrameError> {
    if found == SCHEMA_HASH { Ok(()) } else { Err(FrameError::Schema { expected: SCHEMA_HASH, found }) }
}

fn check_limit(env_idx: usize, field: &'static str, found: u32, limit: usize) -> Result<(), FrameError> {
    if found as usize <= limit {
        Ok(())
    } else {
        Err(FrameError::Record { env_idx, field, found: u64::from(found), limit: limit as u64 })
    }
}

fn check_range(env_idx: usize, field: &'static str, found: u32, limit: usize) -> Result<(), FrameError> {
    if found == 0 {
        Err(FrameError::Zero { env_idx, field })
    } else {
        check_limit(env_idx, field, found, limit)
    }
}
