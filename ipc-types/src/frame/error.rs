//! Errors of messages.

use thiserror::Error;

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
