//! Checksums of messages, by which each side notices that something else has written to the other's memory.

use bytemuck::{NoUninit, bytes_of, cast_slice};
use crc32fast::Hasher;

use crate::layout::Page;

/// Returns the CRC-32 (as in zlib) of a header and its pages.
pub(crate) fn checksum<H: NoUninit>(header: &H, pages: &[Page]) -> u32 {
    let mut hasher = Hasher::new();
    hasher.update(bytes_of(header));
    hasher.update(cast_slice(pages));
    hasher.finalize()
}
