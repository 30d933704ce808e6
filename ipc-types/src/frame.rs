//! Messages: the two 64-byte header types, and views that give access to each env's tensors in place.
//!
//! A view is constructed from a header and the pages of a message and validates one against the other once.
//! After that, every access returns a slice of the mapped memory; nothing is copied.

use bytemuck::{Pod, Zeroable};
use thiserror::Error;

use crate::checksum::checksum;
use crate::layout::{
    ACTION_PAGES, ActionBlock, EXTERNAL_BYTES, EXTERNAL_OFFSET, EXTERNAL_SIDE, EnvRecord, HAND_BYTES,
    HAND_OFFSET, HAND_SIDE, INSTRUCTION_BYTES, MAX_ACTION_DIM, MAX_HORIZON, Page, SCHEMA_HASH, block_pages,
};
use crate::morphology::{ControlMode, Morphology};

/// Header of an observation message, stored separately from its pages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ObservationHeader {
    /// [`SCHEMA_HASH`] of the sender.
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
    /// [`ControlMode::code`] by which the sim will interpret the actions.
    pub control_mode: u32,
    /// 1 if the blocks contain images, otherwise 0.
    pub images: u32,
    /// 1 if `checksum` is set, otherwise 0. The answer then has a checksum, too.
    pub has_checksum: u32,
    /// CRC-32 (as in zlib) of this header, with 0 in place of the checksum, and the pages.
    pub checksum: u32,
    /// Reserved for future fields; always zero.
    pub reserved: u64,
}

/// Header of an action message, stored separately from its pages (one [`ActionBlock`] each).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ActionHeader {
    /// [`SCHEMA_HASH`] of the sender.
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
    assert!(offset_of!(ObservationHeader, checksum) == 52 && offset_of!(ActionHeader, checksum) == 40);
};

/// Errors that can occur while validating a message.
#[derive(Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum FrameError {
    #[error(
        "the peer uses link schema {found:#018x}, this build uses {expected:#018x}; rebuild the older side"
    )]
    Schema { expected: u64, found: u64 },
    #[error("header field `{field}` is {found}, expected {expected}")]
    Header { field: &'static str, expected: &'static str, found: u64 },
    #[error("the message has {found} pages, but its header implies {expected}")]
    Length { expected: u64, found: u64 },
    #[error("env {env_idx}: `{field}` is {found}, expected at most {limit}")]
    Record { env_idx: usize, field: &'static str, found: u64, limit: u64 },
    #[error("env {env_idx}: `{field}` is 0, expected at least 1")]
    Zero { env_idx: usize, field: &'static str },
    #[error("env {env_idx}: the instruction is not valid UTF-8")]
    Instruction { env_idx: usize },
    #[error("the message is damaged: its checksum is {found:#010x}, but its bytes give {expected:#010x}")]
    Checksum { expected: u32, found: u32 },
    #[error("env {env_idx}: action row {row}, entry {entry} is not finite")]
    NotFinite { env_idx: usize, row: usize, entry: usize },
}

/// A validated observation message.
#[derive(Clone, Copy, Debug)]
pub struct ObservationView<'a> {
    header: ObservationHeader,
    morphology: Morphology,
    control_mode: ControlMode,
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
    /// External images, `[2, 224, 224, 3] u8` sRGB; empty if the message has no images.
    pub external: &'a [u8],
    /// Hand images, `[n_arms, 128, 128, 3] u8` sRGB; empty if the message has no images.
    pub hand: &'a [u8],
}

impl<'a> EnvObservation<'a> {
    /// Returns a camera's image, `[side, side, 3] u8`, and its `side` in pixels. Cameras are indexed in the
    /// order of [`Morphology::camera_names`].
    ///
    /// # Panics
    /// If there is no such camera, or the message has no images.
    #[must_use]
    pub fn image(&self, camera_idx: usize) -> (&'a [u8], usize) {
        let n_external = self.external.len() / EXTERNAL_BYTES;
        if camera_idx < n_external {
            (&self.external[camera_idx * EXTERNAL_BYTES..][..EXTERNAL_BYTES], EXTERNAL_SIDE)
        } else {
            (&self.hand[(camera_idx - n_external) * HAND_BYTES..][..HAND_BYTES], HAND_SIDE)
        }
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
        if header.images > 1 {
            return Err(invalid("images", "0 or 1", header.images));
        }
        if header.n_envs == 0 {
            return Err(invalid("n_envs", "at least 1", 0));
        }
        if header.block_pages as usize != block_pages(morphology, header.images == 1) {
            return Err(invalid("block_pages", "the block size of this morphology", header.block_pages));
        }
        let expected = u64::from(header.n_envs) * u64::from(header.block_pages);
        if pages.len() as u64 != expected {
            return Err(FrameError::Length { expected, found: pages.len() as u64 });
        }
        let view = Self { header, morphology, control_mode, pages };
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

    /// Returns `true` if the message contains images.
    #[must_use]
    pub fn has_images(&self) -> bool {
        self.header.images == 1
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
        let (external, hand) = if self.has_images() {
            let hand_end = HAND_OFFSET + self.morphology.n_hand_cameras() * HAND_BYTES;
            (&bytes[EXTERNAL_OFFSET..EXTERNAL_OFFSET + 2 * EXTERNAL_BYTES], &bytes[HAND_OFFSET..hand_end])
        } else {
            (&bytes[..0], &bytes[..0])
        };
        EnvObservation {
            record,
            state: &record.state[..record.state_dim as usize],
            instruction: core::str::from_utf8(text).unwrap_or_default(),
            external,
            hand,
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
    /// External images, `[2, 224, 224, 3] u8` sRGB; empty if the message has no images.
    pub external: &'a mut [u8],
    /// Hand images, `[n_arms, 128, 128, 3] u8` sRGB; empty if the message has no images.
    pub hand: &'a mut [u8],
}

impl<'a> EnvBlockMut<'a> {
    /// Splits the pages of one block into its tensors.
    ///
    /// # Panics
    /// If the number of pages is not [`block_pages`] of this morphology, with or without images.
    #[must_use]
    pub fn new(morphology: Morphology, block: &'a mut [Page]) -> Self {
        let images = block.len() > 1;
        assert_eq!(block.len(), block_pages(morphology, images), "pages of a {} block", morphology.name());
        let (first, rest) = block.split_at_mut(1);
        let rest: &mut [u8] = bytemuck::cast_slice_mut(rest);
        let (external, rest) = rest.split_at_mut(if images { 2 * EXTERNAL_BYTES } else { 0 });
        let hand_bytes = if images { morphology.n_hand_cameras() * HAND_BYTES } else { 0 };
        Self { record: bytemuck::cast_mut(&mut first[0]), external, hand: &mut rest[..hand_bytes] }
    }
}

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
