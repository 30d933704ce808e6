//! Weight files: the safetensors reader, memory-mapped tensors, the errors, and the in-memory state dict.
//!
//! [`formats`](crate::formats), [`nn`](crate::nn) and [`text`](crate::text) build on this module; it
//! depends on none of them.

mod file;
mod mapped;
mod state_dict;

use std::path::PathBuf;

use thiserror::Error;

pub(crate) use self::file::EXTENSION;
pub use self::file::TensorFile;
pub use self::mapped::{FloatType, INDEX_FILE, StoredTensor, TensorFolder};
pub use self::state_dict::StateDict;

/// File name of the configuration in a checkpoint folder.
pub const CONFIG_FILE: &str = "config.json";
/// File name of the weights in a checkpoint folder.
pub const MODEL_FILE: &str = "model.safetensors";

/// Name and shape of a tensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorSpec {
    /// Name in the state dict.
    pub name: String,
    /// Shape of the row-major tensor.
    pub shape: Vec<usize>,
}

/// Errors that can occur while reading a safetensors file.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum WeightsError {
    #[error("failed to read {}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{} is not a valid list of shards", path.display())]
    Index { path: PathBuf, source: serde_json::Error },
    #[error("{} lists no tensor", path.display())]
    EmptyIndex { path: PathBuf },
    #[error("{}: `{}` is not the name of a file in the same folder", path.display(), shard.display())]
    ShardPath { path: PathBuf, shard: PathBuf },
    #[error("{} is not named `*.safetensors`, as files with tensors are", path.display())]
    Name { path: PathBuf },
    #[error("{} is not a safetensors file: {reason}", path.display())]
    Header { path: PathBuf, reason: String },
    #[error(
        "{} has {found} bytes, its header describes {expected}: the file is truncated or overwritten",
        path.display()
    )]
    Length { path: PathBuf, expected: u64, found: u64 },
    #[error("{}: tensor `{tensor}` is missing, expected {expected}", path.display())]
    Missing { path: PathBuf, tensor: String, expected: String },
    #[error("{}: tensor `{tensor}` is {found}, expected {expected}", path.display())]
    Mismatch { path: PathBuf, tensor: String, expected: String, found: String },
}
