//! Tensors in memory-mapped safetensors files: read where they lie, never copied as a whole.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use half::{bf16, f16};
use memmap2::Mmap;
use rayon::prelude::*;
use run_config::input;
use safetensors::Dtype;
use serde::Deserialize;

use super::file::unwrapped;
use super::{MODEL_FILE, TensorFile, WeightsError};

/// File name of the list of shards in a checkpoint folder.
pub const INDEX_FILE: &str = "model.safetensors.index.json";

/// Element type of stored weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FloatType {
    /// 32-bit floating point.
    F32,
    /// 16-bit floating point with 5 bits of exponent.
    F16,
    /// 16-bit floating point with 8 bits of exponent, the upper half of an f32.
    Bf16,
}

/// A tensor in a memory-mapped file.
#[derive(Clone, Debug)]
pub struct StoredTensor {
    map: Arc<Mmap>,
    /// Bytes of the values within the file.
    range: Range<usize>,
    float_type: FloatType,
    shape: Vec<usize>,
}

/// The tensors of a checkpoint folder, in one file or in several shards.
#[derive(Debug)]
pub struct TensorFolder {
    shards: Vec<Shard>,
    /// Index of the shard that contains a tensor, by name.
    shard_of: BTreeMap<String, usize>,
}

#[derive(Debug)]
struct Shard {
    file: TensorFile,
    map: Arc<Mmap>,
}

/// Contents of the list of shards that transformers writes.
#[derive(Deserialize)]
struct ShardIndex {
    weight_map: BTreeMap<String, PathBuf>,
}

impl FloatType {
    /// Returns the size of a value in bytes.
    #[must_use]
    pub fn size(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::F16 | Self::Bf16 => 2,
        }
    }

    /// Returns the name in lower case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::F16 => "f16",
            Self::Bf16 => "bf16",
        }
    }
}

impl StoredTensor {
    /// Returns the shape of the row-major tensor.
    #[must_use]
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Returns the element type.
    #[must_use]
    pub fn float_type(&self) -> FloatType {
        self.float_type
    }

    /// Returns the values as stored: little-endian, not necessarily aligned.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.map[self.range.clone()]
    }

    /// Returns all values in f32.
    #[must_use]
    pub fn values(&self) -> Vec<f32> {
        let mut values = vec![0.0; self.shape.iter().product()];
        self.read(0, &mut values);
        values
    }

    /// Converts values to f32, starting with the `first`.
    ///
    /// # Panics
    /// If there are fewer values.
    pub fn read(&self, first: usize, out: &mut [f32]) {
        let size = self.float_type.size();
        let bytes = &self.bytes()[first * size..][..out.len() * size];
        let halves = bytes.as_chunks::<2>().0;
        match self.float_type {
            FloatType::F32 => {
                let values = bytes.as_chunks::<4>().0;
                out.iter_mut().zip(values).for_each(|(out, x)| *out = f32::from_le_bytes(*x));
            }
            FloatType::F16 => {
                out.iter_mut().zip(halves).for_each(|(out, x)| *out = f16::from_le_bytes(*x).to_f32());
            }
            FloatType::Bf16 => {
                out.iter_mut().zip(halves).for_each(|(out, x)| *out = bf16::from_le_bytes(*x).to_f32());
            }
        }
    }
}

impl StoredTensor {
    /// Returns `true` if no value is infinite or NaN. Reads all values, which also brings them into memory;
    /// the threads of the current rayon pool share the work.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        /// Bytes that a thread reads at a time.
        const CHUNK: usize = 4 << 20;
        let exponent_below = |bytes: &[u8], mask: u16| {
            let is_bad = |x: &[u8; 2]| u16::from_le_bytes(*x) & mask == mask;
            // A sum instead of a search, so that the compiler vectorises it.
            bytes.as_chunks::<2>().0.iter().map(|x| u32::from(is_bad(x))).sum::<u32>() == 0
        };
        let chunks = self.bytes().par_chunks(CHUNK);
        match self.float_type {
            FloatType::Bf16 => chunks.all(|chunk| exponent_below(chunk, 0x7f80)),
            FloatType::F16 => chunks.all(|chunk| exponent_below(chunk, 0x7c00)),
            FloatType::F32 => chunks.all(|chunk| {
                let is_bad = |x: &[u8; 4]| u32::from_le_bytes(*x) & 0x7f80_0000 == 0x7f80_0000;
                chunk.as_chunks::<4>().0.iter().map(|x| u32::from(is_bad(x))).sum::<u32>() == 0
            }),
        }
    }
}

impl TensorFolder {
    /// Opens the weights in a checkpoint folder and reads their headers: the shards that [`INDEX_FILE`]
    /// lists, or [`MODEL_FILE`].
    ///
    /// # Errors
    /// If a file cannot be read, is not a safetensors file or is truncated, or if a shard lacks a tensor that
    /// the list assigns to it.
    pub fn open(folder: &Path) -> Result<Self, WeightsError> {
        let index = folder.join(INDEX_FILE);
        if !index.is_file() {
            let shard = Shard::open(&folder.join(MODEL_FILE))?;
            let shard_of = shard.file.names().into_iter().map(|name| (name, 0)).collect();
            return Ok(Self { shards: vec![shard], shard_of });
        }
        let text =
            input::read(&index).map_err(|source| WeightsError::Read { path: index.clone(), source })?;
        let ShardIndex { weight_map } = serde_json::from_slice(&text)
            .map_err(|source| WeightsError::Index { path: index.clone(), source })?;
        if weight_map.is_empty() {
            return Err(WeightsError::EmptyIndex { path: index });
        }
        let (mut shards, mut names): (Vec<Shard>, Vec<PathBuf>) = (Vec::new(), Vec::new());
        let mut shard_of = BTreeMap::new();
        for (tensor, file) in weight_map {
            let tensor = unwrapped(&tensor);
            if file.components().count() != 1 {
                return Err(WeightsError::ShardPath { path: index, shard: file });
            }
            let position = names.iter().position(|name| *name == file);
            let idx = match position {
                Some(idx) => idx,
                None => {
                    shards.push(Shard::open(&folder.join(&file))?);
                    names.push(file);
                    shards.len() - 1
                }
            };
            if !shards[idx].file.contains(&tensor) {
                let (path, expected) = (folder.join(&names[idx]), format!("because {INDEX_FILE} lists it"));
                return Err(WeightsError::Missing { path, tensor, expected });
            }
            shard_of.insert(tensor, idx);
        }
        Ok(Self { shards, shard_of })
    }

    /// Returns the names of all tensors, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.shard_of.keys().map(String::as_str)
    }

    /// Returns the shape of a tensor, or `None` if there is no such tensor.
    #[must_use]
    pub fn shape(&self, name: &str) -> Option<&[usize]> {
        self.shards[*self.shard_of.get(name)?].file.shape(name)
    }

    /// Returns dtype and shape of a tensor as text, for example `BF16 [2048, 2048]`.
    #[must_use]
    pub fn describe(&self, name: &str) -> Option<String> {
        self.shards[*self.shard_of.get(name)?].file.describe(name)
    }

    /// Returns the path of the file that contains a tensor; of the first file if there is no such tensor.
    #[must_use]
    pub fn path_of(&self, name: &str) -> &Path {
        self.shards[self.shard_of.get(name).copied().unwrap_or(0)].file.path()
    }

    /// Checks that a tensor exists with this shape and a 32- or 16-bit float dtype.
    ///
    /// # Errors
    /// If the tensor is missing or differs.
    pub fn check(&self, name: &str, shape: &[usize]) -> Result<(), WeightsError> {
        self.shards[self.shard_of.get(name).copied().unwrap_or(0)].file.check(name, shape)
    }

    /// Returns a tensor without reading its values.
    ///
    /// # Errors
    /// If the tensor is missing or has no float dtype.
    pub fn tensor(&self, name: &str) -> Result<StoredTensor, WeightsError> {
        let shard = &self.shards[self.shard_of.get(name).copied().unwrap_or(0)];
        let (dtype, shape, range) = shard.file.locate(name)?;
        let float_type = match dtype {
            Dtype::BF16 => FloatType::Bf16,
            Dtype::F16 => FloatType::F16,
            _ => FloatType::F32,
        };
        Ok(StoredTensor { map: Arc::clone(&shard.map), range, float_type, shape: shape.to_vec() })
    }
}

impl Shard {
    fn open(path: &Path) -> Result<Self, WeightsError> {
        let read = |source| WeightsError::Read { path: path.to_owned(), source };
        let file = TensorFile::open(path)?;
        let handle = input::open(path).map_err(read)?;
        // SAFETY: the map is read-only, and values are converted from bytes, of which every pattern is valid.
        // A process that truncates the file while a policy runs ends that policy's host; whoever modifies it
        // otherwise, the host notices before it answers ([`crate::formats::content`]).
        let map = unsafe { Mmap::map(&handle) }.map_err(read)?;
        Ok(Self { file, map: Arc::new(map) })
    }
}
