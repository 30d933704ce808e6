//! Errors of loading the networks in a checkpoint folder onto a device.

use thiserror::Error;

use crate::formats::folder::CheckpointFolderError;
use crate::nn::gpu::GpuError;

/// Errors that can occur while loading a policy onto a device.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the variants are transparent")]
pub enum LoadGpuError {
    #[error(transparent)]
    Folder(#[from] CheckpointFolderError),
    #[error(transparent)]
    Device(#[from] GpuError),
}
