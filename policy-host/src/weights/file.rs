//! Reader of safetensors files. The header is validated when the file is opened; values are converted to f32.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use half::{bf16, f16};
use run_config::input;
use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};

use super::WeightsError;

/// Extension of safetensors files. Others are not part of a checkpoint's content
/// ([`crate::formats::content`]).
pub(crate) const EXTENSION: &str = "safetensors";
/// Maximum header length. An ACT checkpoint has about 400 tensors with 100 header bytes each.
const MAX_HEADER_BYTES: u64 = 16 << 20;

/// Parts of names that PyTorch's wrappers add: `torch.compile` and data parallel training.
const WRAPPERS: [&str; 2] = ["_orig_mod", "module"];

/// An open safetensors file with a valid header. Prefixes of PyTorch's wrappers are left out of all names.
#[derive(Debug)]
pub struct TensorFile {
    path: PathBuf,
    file: File,
    header: Metadata,
    /// Stored names by names without the prefixes of [`WRAPPERS`].
    stored: BTreeMap<String, String>,
    /// Byte offset of the first tensor.
    data_start: u64,
}

impl TensorFile {
    /// Opens the file and reads its header.
    ///
    /// # Errors
    /// If the file cannot be read, is not a safetensors file, or its length differs from what the header
    /// implies.
    pub fn open(path: &Path) -> Result<Self, WeightsError> {
        let path = path.to_owned();
        if path.extension() != Some(OsStr::new(EXTENSION)) {
            return Err(WeightsError::Name { path });
        }
        let read = |source| WeightsError::Read { path: path.clone(), source };
        let mut file = input::open(&path).map_err(read)?;
        let found = file.metadata().map_err(read)?.len();
        let (header, data_start) = read_header(&mut file, &path, found)?;
        let expected = data_start + header.data_len() as u64;
        if expected != found {
            return Err(WeightsError::Length { path, expected, found });
        }
        let mut stored = BTreeMap::new();
        for name in header.tensors().into_keys() {
            if let Some(other) = stored.insert(unwrapped(&name), name.clone()) {
                let reason = format!("`{other}` and `{name}` are the same tensor");
                return Err(WeightsError::Header { path, reason });
            }
        }
        Ok(Self { path, file, header, stored, data_start })
    }

    /// Returns the path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the names of all tensors, sorted.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        self.stored.keys().cloned().collect()
    }

    /// Returns the dtype and shape of a tensor as text, for example `F32 [512, 25]`.
    #[must_use]
    pub fn describe(&self, name: &str) -> Option<String> {
        self.info(name).map(|info| describe(info.dtype, &info.shape))
    }

    /// Returns `true` if the file contains a tensor with this name.
    #[must_use]
    pub fn contains(&self, name: &str) -> bool {
        self.info(name).is_some()
    }

    /// Returns the shape of a tensor, or `None` if the file does not contain it.
    #[must_use]
    pub fn shape(&self, name: &str) -> Option<&[usize]> {
        self.info(name).map(|info| &info.shape[..])
    }

    fn info(&self, name: &str) -> Option<&TensorInfo> {
        self.header.info(self.stored.get(name)?)
    }

    /// Checks that a tensor exists with this shape and a 32- or 16-bit float dtype.
    ///
    /// # Errors
    /// If the tensor is missing or differs.
    pub fn check(&self, name: &str, shape: &[usize]) -> Result<(), WeightsError> {
        let (path, tensor, expected) = (self.path.clone(), name.to_owned(), describe(Dtype::F32, shape));
        match self.info(name) {
            Some(info) if is_float(info.dtype) && info.shape == shape => Ok(()),
            Some(info) => {
                let found = describe(info.dtype, &info.shape);
                Err(WeightsError::Mismatch { path, tensor, expected, found })
            }
            None => Err(WeightsError::Missing { path, tensor, expected }),
        }
    }

    /// Returns dtype and shape of a tensor, and the bytes of the file that contain its values.
    ///
    /// # Errors
    /// If the tensor is missing or has no float dtype.
    pub(crate) fn locate(&self, name: &str) -> Result<(Dtype, &[usize], Range<usize>), WeightsError> {
        let (path, tensor) = (self.path.clone(), name.to_owned());
        let Some(&TensorInfo { dtype, ref shape, data_offsets: (start, end) }) = self.info(name) else {
            return Err(WeightsError::Missing { path, tensor, expected: "a float tensor".to_owned() });
        };
        if !is_float(dtype) {
            let (expected, found) = (describe(Dtype::F32, shape), describe(dtype, shape));
            return Err(WeightsError::Mismatch { path, tensor, expected, found });
        }
        let first = self.data_start as usize;
        Ok((dtype, shape, first + start..first + end))
    }

    /// Reads the values of a tensor, row-major, and converts them to f32.
    ///
    /// # Errors
    /// If the tensor is missing, has no float dtype, or cannot be read.
    pub fn read(&mut self, name: &str) -> Result<Vec<f32>, WeightsError> {
        let (dtype, _, range) = self.locate(name)?;
        let mut bytes = vec![0; range.len()];
        let read = |source| WeightsError::Read { path: self.path.clone(), source };
        self.file.seek(SeekFrom::Start(range.start as u64)).map_err(read)?;
        self.file.read_exact(&mut bytes).map_err(read)?;
        let half_words = || bytes.as_chunks::<2>().0.iter().copied();
        Ok(match dtype {
            Dtype::F16 => half_words().map(|x| f16::from_le_bytes(x).to_f32()).collect(),
            Dtype::BF16 => half_words().map(|x| bf16::from_le_bytes(x).to_f32()).collect(),
            _ => bytes.as_chunks::<4>().0.iter().map(|&x| f32::from_le_bytes(x)).collect(),
        })
    }
}

/// Returns the name of a tensor without the parts that wrappers add.
pub(crate) fn unwrapped(name: &str) -> String {
    let parts: Vec<&str> = name.split('.').filter(|part| !WRAPPERS.contains(part)).collect();
    parts.join(".")
}

fn is_float(dtype: Dtype) -> bool {
    matches!(dtype, Dtype::F32 | Dtype::F16 | Dtype::BF16)
}

/// Reads the header of a safetensors file of `file_len` bytes. Returns it with the byte offset of the first
/// tensor.
fn read_header(file: &mut File, path: &Path, file_len: u64) -> Result<(Metadata, u64), WeightsError> {
    let invalid = |reason: String| WeightsError::Header { path: path.to_owned(), reason };
    let read = |source| WeightsError::Read { path: path.to_owned(), source };
    if file_len < 8 {
        return Err(invalid(format!("it has only {file_len} bytes")));
    }
    let mut length = [0; 8];
    file.read_exact(&mut length).map_err(read)?;
    let length = u64::from_le_bytes(length);
    if length > MAX_HEADER_BYTES || length + 8 > file_len {
        return Err(invalid(format!("it claims a header of {length} bytes in a file of {file_len}")));
    }
    let mut bytes = vec![0; length as usize];
    file.read_exact(&mut bytes).map_err(read)?;
    let metadata = serde_json::from_slice(&bytes).map_err(|error| invalid(error.to_string()))?;
    Ok((metadata, 8 + length))
}

fn describe(dtype: Dtype, shape: &[usize]) -> String {
    format!("{dtype:?} {shape:?}")
}
