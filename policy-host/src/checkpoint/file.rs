//! A safetensors file: its header checked before a number is read, its numbers as f32.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use half::{bf16, f16};
use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};

use super::CheckpointError;

/// Longest header that is read: a checkpoint of this kind has some 400 tensors of 100 bytes each.
const MAX_HEADER_BYTES: u64 = 16 << 20;

/// An open file with a sound header.
#[derive(Debug)]
pub struct TensorFile {
    path: PathBuf,
    file: File,
    header: Metadata,
    data_start: u64,
}

impl TensorFile {
    /// Opens the file and reads its header.
    ///
    /// # Errors
    /// If it cannot be read, is no safetensors file, or has another length than its header says.
    pub fn open(path: &Path) -> Result<Self, CheckpointError> {
        let path = path.to_owned();
        let read = |source| CheckpointError::Read { path: path.clone(), source };
        let mut file = File::open(&path).map_err(read)?;
        let found = file.metadata().map_err(read)?.len();
        let (header, data_start) = read_header(&mut file, &path, found)?;
        let expected = data_start + header.data_len() as u64;
        if expected != found {
            return Err(CheckpointError::Length { path, expected, found });
        }
        Ok(Self { path, file, header, data_start })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Names of its tensors, sorted.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = self.header.tensors().into_keys().collect();
        names.sort();
        names
    }

    /// Type and shape of a tensor, for example `F32 [512, 25]`.
    #[must_use]
    pub fn describe(&self, name: &str) -> Option<String> {
        self.header.info(name).map(|info| describe(info.dtype, &info.shape))
    }

    /// Whether there is a tensor of this name.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.header.info(name).is_some()
    }

    /// Shape of a tensor, if there is one of this name.
    #[must_use]
    pub fn shape(&self, name: &str) -> Option<&[usize]> {
        self.header.info(name).map(|info| &info.shape[..])
    }

    /// Checks that a tensor is there, of this shape, and of 32- or 16-bit numbers.
    ///
    /// # Errors
    /// If it is not.
    pub fn check(&self, name: &str, shape: &[usize]) -> Result<(), CheckpointError> {
        let (path, tensor, expected) = (self.path.clone(), name.to_owned(), describe(Dtype::F32, shape));
        match self.header.info(name) {
            Some(info) if is_number(info.dtype) && info.shape == shape => Ok(()),
            Some(info) => {
                let found = describe(info.dtype, &info.shape);
                Err(CheckpointError::Mismatch { path, tensor, expected, found })
            }
            None => Err(CheckpointError::Missing { path, tensor, expected }),
        }
    }

    /// A tensor's numbers, row-major.
    ///
    /// # Errors
    /// If it is not there, holds no numbers, or cannot be read.
    pub fn read(&mut self, name: &str) -> Result<Vec<f32>, CheckpointError> {
        let Some(&TensorInfo { dtype, ref shape, data_offsets: (start, end) }) = self.header.info(name)
        else {
            let (path, tensor) = (self.path.clone(), name.to_owned());
            return Err(CheckpointError::Missing { path, tensor, expected: "numbers".to_owned() });
        };
        if !is_number(dtype) {
            let (path, tensor, found) = (self.path.clone(), name.to_owned(), describe(dtype, shape));
            return Err(CheckpointError::Mismatch {
                path,
                tensor,
                expected: describe(Dtype::F32, shape),
                found,
            });
        }
        let mut bytes = vec![0; end - start];
        let read = |source| CheckpointError::Read { path: self.path.clone(), source };
        self.file.seek(SeekFrom::Start(self.data_start + start as u64)).map_err(read)?;
        self.file.read_exact(&mut bytes).map_err(read)?;
        let halves = || bytes.as_chunks::<2>().0.iter().copied();
        Ok(match dtype {
            Dtype::F16 => halves().map(|x| f16::from_le_bytes(x).to_f32()).collect(),
            Dtype::BF16 => halves().map(|x| bf16::from_le_bytes(x).to_f32()).collect(),
            _ => bytes.as_chunks::<4>().0.iter().map(|&x| f32::from_le_bytes(x)).collect(),
        })
    }
}

fn is_number(dtype: Dtype) -> bool {
    matches!(dtype, Dtype::F32 | Dtype::F16 | Dtype::BF16)
}

/// Reads the header of a safetensors file of `found` bytes; also the offset of the first tensor.
fn read_header(file: &mut File, path: &Path, found: u64) -> Result<(Metadata, u64), CheckpointError> {
    let header = |reason: String| CheckpointError::Header { path: path.to_owned(), reason };
    let read = |source| CheckpointError::Read { path: path.to_owned(), source };
    if found < 8 {
        return Err(header(format!("{found} bytes long")));
    }
    let mut length = [0; 8];
    file.read_exact(&mut length).map_err(read)?;
    let length = u64::from_le_bytes(length);
    if length > MAX_HEADER_BYTES || length + 8 > found {
        return Err(header(format!("a header of {length} bytes in a file of {found}")));
    }
    let mut bytes = vec![0; length as usize];
    file.read_exact(&mut bytes).map_err(read)?;
    let metadata = serde_json::from_slice(&bytes).map_err(|error| header(error.to_string()))?;
    Ok((metadata, 8 + length))
}

fn describe(dtype: Dtype, shape: &[usize]) -> String {
    format!("{dtype:?} {shape:?}")
}
