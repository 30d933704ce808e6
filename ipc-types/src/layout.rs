//! The byte layout of every tensor that crosses the link. All numbers are little-endian.
//!
//! An observation message is `n_envs` blocks of whole pages, one env after another:
//!
//! | offset in block | tensor | shape, dtype |
//! |--|--|--|
//! | 0 | [`EnvRecord`] (query identity, state, instruction) | one page |
//! | 4096 | external images | `[2, height, width, 3] u8`, sRGB, row-major, top row first |
//! | [`hand_offset`] | hand images | `[n_arms, height, width, 3] u8` |
//!
//! The header of a message states the sizes. Without images, a block consists of the record's page alone. An
//! action message is one [`ActionBlock`] of [`ACTION_PAGES`] pages per env.

use bytemuck::{Pod, Zeroable};

use crate::image_size::ImageSizes;
use crate::morphology::Morphology;

/// Size of a [`Page`] in bytes.
pub const PAGE_BYTES: usize = 4096;
/// Byte offset of the first external image in an env's block.
pub const EXTERNAL_OFFSET: usize = PAGE_BYTES;
/// Maximum length of an instruction in UTF-8 bytes.
pub const INSTRUCTION_BYTES: usize = 1024;
/// Maximum width of a state vector.
pub const MAX_STATE_DIM: usize = 64;
/// Maximum width of an action row.
pub const MAX_ACTION_DIM: usize = 16;
/// Maximum number of rows in an answer. That many rows of [`MAX_ACTION_DIM`] and their 64-byte head fill
/// exactly [`ACTION_PAGES`] pages.
pub const MAX_HORIZON: usize = 127;
/// Pages of an [`ActionBlock`].
pub const ACTION_PAGES: usize = 2;

/// A page of shared memory. Messages are arrays of pages, so that every block starts on a page boundary.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(4096))]
pub struct Page(pub [u8; PAGE_BYTES]);

// SAFETY: `Page` is a plain array of bytes; its alignment equals its size, so it has no padding.
unsafe impl Zeroable for Page {}
// SAFETY: as above, every bit pattern is valid and there is no padding.
unsafe impl Pod for Page {}

/// First page of an env's block: everything a policy observes of the env except the images.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct EnvRecord {
    /// Number of the env in the sim. The answer repeats it.
    pub slot: u32,
    /// Number of earlier queries in this episode. 0 marks a new episode: a stateful policy resets its state
    /// for the env.
    pub query: u32,
    /// Control steps executed in this episode so far.
    pub step: u32,
    /// Number of valid entries in `state`.
    pub state_dim: u32,
    /// Number of valid bytes in `instruction`; 0 means an empty instruction.
    pub instruction_len: u32,
    /// Rows of the answer that the sim will execute, 1 to [`MAX_HORIZON`]. Rows of the answer beyond that are
    /// ignored; after a shorter answer the next query comes sooner.
    pub execute: u32,
    /// Seed for a stochastic policy, a function of the episode alone.
    pub policy_seed: u64,
    /// Reserved for future fields; always zero.
    pub reserved: [u64; 4],
    /// State vector, `[state_dim] f32`, in the order of [`Morphology::state_parts`]; zero beyond `state_dim`.
    pub state: [f32; MAX_STATE_DIM],
    /// Language instruction in UTF-8, without a terminator; zero beyond `instruction_len`.
    pub instruction: [u8; INSTRUCTION_BYTES],
    /// Always zero; fills the page.
    pub padding: [u8; 2752],
}

/// Answer for one env: an action chunk in [`ACTION_PAGES`] pages.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ActionBlock {
    /// Copied from [`EnvRecord::slot`].
    pub slot: u32,
    /// Copied from [`EnvRecord::query`].
    pub query: u32,
    /// Number of valid rows, 1 to [`MAX_HORIZON`].
    pub n_rows: u32,
    /// Width of a row; see [`crate::ControlMode::action_dim`].
    pub action_dim: u32,
    /// Reserved for future fields; always zero.
    pub reserved: [u64; 6],
    /// Action chunk, `[n_rows, action_dim] f32`, packed; zero beyond.
    pub rows: [f32; MAX_HORIZON * MAX_ACTION_DIM],
}

/// Returns the number of pages in one env's block of an observation message, whose images have these sizes.
#[must_use]
pub const fn block_pages(morphology: Morphology, images: Option<ImageSizes>) -> usize {
    match images {
        Some(sizes) => {
            let hand_bytes = morphology.n_hand_cameras() * sizes.hand.n_bytes();
            (hand_offset(sizes) + hand_bytes).div_ceil(PAGE_BYTES)
        }
        None => 1,
    }
}

/// Returns the byte offset of the first hand image in an env's block.
#[must_use]
pub const fn hand_offset(sizes: ImageSizes) -> usize {
    EXTERNAL_OFFSET + 2 * sizes.external.n_bytes()
}

/// Description of the layout in one line, with the type and offset of every field. Input of [`SCHEMA_HASH`].
pub const SCHEMA: &str = "hypogeum link v4; page 4096; \
    obs header {schema u64@0, run u64@8, sequence u64@16, epoch u32@24, n_envs u32@28, block_pages u32@32, morphology u32@36, control_mode u32@40, images u32@44, has_checksum u32@48, checksum u32@52, image_sizes u16[4]@56} 64; \
    env record {slot u32@0, query u32@4, step u32@8, state_dim u32@12, instruction_len u32@16, execute u32@20, policy_seed u64@24, reserved 32@32, state f32[64]@64, instruction u8[1024]@320, zero@1344} 4096; \
    external u8[2,h,w,3]@4096; hand u8[n_arms,h,w,3] next; \
    act header {schema u64@0, run u64@8, sequence u64@16, epoch u32@24, n_envs u32@28, status u32@32, has_checksum u32@36, checksum u32@40, reserved 20@44} 64; \
    action block {slot u32@0, query u32@4, n_rows u32@8, action_dim u32@12, reserved 48@16, rows f32[127*16]@64} 8192; \
    single: state 25, cameras 2+1; bimanual: state 64, cameras 2+2; \
    control modes 0 pd_ee_delta_pose 7, 1 pd_joint_pos 8, 2 pd_ee_pose 7 per arm";

/// xxh3-64 of [`SCHEMA`]. Both sides of the link check it in the service attributes and in every header.
pub const SCHEMA_HASH: u64 = xxhash_rust::const_xxh3::xxh3_64(SCHEMA.as_bytes());

const _: () = {
    use core::mem::{align_of, offset_of, size_of};
    assert!(size_of::<Page>() == PAGE_BYTES && align_of::<Page>() == PAGE_BYTES);
    assert!(size_of::<EnvRecord>() == PAGE_BYTES);
    assert!(offset_of!(EnvRecord, execute) == 20);
    assert!(offset_of!(EnvRecord, policy_seed) == 24);
    assert!(offset_of!(EnvRecord, state) == 64);
    assert!(offset_of!(EnvRecord, instruction) == 320);
    assert!(offset_of!(EnvRecord, padding) == 1344);
    assert!(size_of::<ActionBlock>() == ACTION_PAGES * PAGE_BYTES);
    assert!(offset_of!(ActionBlock, rows) == 64);
};

#[cfg(test)]
mod tests {
    use core::mem::offset_of;

    use super::*;
    use crate::frame::{ActionHeader, ObservationHeader};
    use crate::image_size::ImageSize;

    /// Returns the fields that [`SCHEMA`] lists in braces after `name`.
    fn schema_fields(name: &str) -> Vec<&'static str> {
        let start = SCHEMA.find(&format!("{name} {{")).unwrap() + name.len() + 2;
        SCHEMA[start..].split('}').next().unwrap().split(", ").collect()
    }

    macro_rules! struct_fields {
        ($type:ty: $($field:ident as $text:literal),+ $(,)?) => {
            vec![$(format!("{}@{}", $text, offset_of!($type, $field))),+]
        };
    }

    #[test]
    fn schema_matches_struct_layouts() {
        let observation_header = struct_fields!(ObservationHeader:
            schema_hash as "schema u64", run as "run u64", sequence as "sequence u64", epoch as "epoch u32",
            n_envs as "n_envs u32", block_pages as "block_pages u32", morphology as "morphology u32",
            control_mode as "control_mode u32", images as "images u32",
            has_checksum as "has_checksum u32", checksum as "checksum u32", image_sizes as "image_sizes u16[4]");
        assert_eq!(schema_fields("obs header"), observation_header);
        let record = struct_fields!(EnvRecord:
            slot as "slot u32", query as "query u32", step as "step u32", state_dim as "state_dim u32",
            instruction_len as "instruction_len u32", execute as "execute u32", policy_seed as "policy_seed u64",
            reserved as "reserved 32", state as "state f32[64]", instruction as "instruction u8[1024]",
            padding as "zero");
        assert_eq!(schema_fields("env record"), record);
        let action_header = struct_fields!(ActionHeader:
            schema_hash as "schema u64", run as "run u64", sequence as "sequence u64", epoch as "epoch u32",
            n_envs as "n_envs u32", status as "status u32", has_checksum as "has_checksum u32",
            checksum as "checksum u32", reserved as "reserved 20");
        assert_eq!(schema_fields("act header"), action_header);
        let block = struct_fields!(ActionBlock:
            slot as "slot u32", query as "query u32", n_rows as "n_rows u32", action_dim as "action_dim u32",
            reserved as "reserved 48", rows as "rows f32[127*16]");
        assert_eq!(schema_fields("action block"), block);
    }

    /// A change of this value breaks every existing foreign host.
    #[test]
    fn schema_hash_is_unchanged() {
        assert_eq!(SCHEMA_HASH, 0x13c3_20f6_1ab5_2ed2, "found {SCHEMA_HASH:#018x}");
    }

    #[test]
    fn block_holds_all_tensors_without_a_spare_page() {
        let odd = ImageSizes { external: ImageSize { width: 99, height: 65 }, hand: ImageSize::square(64) };
        for sizes in [ImageSizes::BENCHMARK, odd] {
            for morphology in Morphology::ALL {
                let end = hand_offset(sizes) + morphology.n_arms() * sizes.hand.n_bytes();
                let bytes = block_pages(morphology, Some(sizes)) * PAGE_BYTES;
                assert!((end..end + PAGE_BYTES).contains(&bytes));
            }
        }
        assert_eq!(
            Morphology::ALL.map(|morphology| block_pages(morphology, Some(ImageSizes::BENCHMARK))),
            [87, 99]
        );
    }
}
