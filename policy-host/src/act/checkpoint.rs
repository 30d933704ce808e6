//! `model.safetensors` of an ACT checkpoint: every tensor checked by name, type and shape before one is read.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use safetensors::Dtype;
use safetensors::tensor::Metadata;
use thiserror::Error;

use super::config::{ActConfig, CONFIG_FILE, ConfigError};
use super::tensors::{IGNORED_SUFFIX, Role, STATISTICS, TensorSpec, tensor_specs};

/// Name of the file in a checkpoint folder.
pub const MODEL_FILE: &str = "model.safetensors";

/// Longest header that is read: a checkpoint of this kind has some 400 tensors of 100 bytes each.
const MAX_HEADER_BYTES: u64 = 16 << 20;

/// A checkpoint folder that cannot be loaded.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum CheckpointError {
    #[error("use {}: {source}", path.display())]
    Config { path: PathBuf, source: ConfigError },
    #[error("read {}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("read {}: not a safetensors file ({reason})", path.display())]
    Header { path: PathBuf, reason: String },
    #[error("read {}: its header describes {expected} bytes, the file has {found}: truncated or overwritten", path.display())]
    Length { path: PathBuf, expected: u64, found: u64 },
    #[error("use {}: tensor `{tensor}` is missing, expected {expected}", path.display())]
    Missing { path: PathBuf, tensor: String, expected: String },
    #[error("use {}: tensor `{tensor}` ({found}) belongs to no network of this {CONFIG_FILE}", path.display())]
    Unknown { path: PathBuf, tensor: String, found: String },
    #[error("use {}: tensor `{tensor}` is {found}, expected {expected}", path.display())]
    Mismatch { path: PathBuf, tensor: String, expected: String, found: String },
}

/// The tensors that inference needs, by name.
#[derive(Clone, Debug, Default)]
pub struct Weights {
    tensors: BTreeMap<String, Vec<f32>>,
}

impl Weights {
    /// Adds a tensor, row-major.
    pub fn insert(&mut self, name: String, numbers: Vec<f32>) {
        self.tensors.insert(name, numbers);
    }

    /// A tensor that the specification says is there.
    ///
    /// # Panics
    /// If it is not: weights are checked before they are used.
    #[must_use]
    pub fn get(&self, name: &str) -> &[f32] {
        self.tensors.get(name).unwrap_or_else(|| panic!("checked weights lack `{name}`"))
    }

    /// The optional statistics, in the order of [`STATISTICS`].
    #[must_use]
    pub fn statistics(&self) -> Option<[&[f32]; 4]> {
        self.tensors.contains_key(STATISTICS[0]).then(|| STATISTICS.map(|name| self.get(name)))
    }
}

/// A checkpoint whose configuration and header have been checked.
#[derive(Debug)]
pub struct Checkpoint {
    config: ActConfig,
    path: PathBuf,
    file: File,
    header: Metadata,
    data_start: u64,
}

impl Checkpoint {
    /// Reads `config.json` and the header of `model.safetensors` in `folder` and checks one against the other.
    ///
    /// # Errors
    /// The first thing that does not fit, with file, tensor, what was found and what was expected.
    pub fn open(folder: &Path) -> Result<Self, CheckpointError> {
        let config = ActConfig::read(folder)
            .map_err(|source| CheckpointError::Config { path: folder.join(CONFIG_FILE), source })?;
        let path = folder.join(MODEL_FILE);
        let read = |source| CheckpointError::Read { path: path.clone(), source };
        let mut file = File::open(&path).map_err(read)?;
        let found = file.metadata().map_err(read)?.len();
        let (header, data_start) = read_header(&mut file, &path, found)?;
        let expected = data_start + header.data_len() as u64;
        if expected != found {
            return Err(CheckpointError::Length { path, expected, found });
        }
        check_tensors(&config, &header, &path)?;
        Ok(Self { config, path, file, header, data_start })
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &ActConfig {
        &self.config
    }

    /// Reads what inference needs.
    ///
    /// # Errors
    /// If the file cannot be read to the end.
    pub fn weights(&mut self) -> Result<Weights, CheckpointError> {
        let specs = tensor_specs(&self.config);
        let live = specs.iter().filter(|spec| spec.role == Role::Live).map(|spec| spec.name.as_str());
        let mut weights = Weights::default();
        for name in live.chain(STATISTICS) {
            let Some(info) = self.header.info(name) else { continue };
            let (start, end) = info.data_offsets;
            let mut bytes = vec![0; end - start];
            let read = |source| CheckpointError::Read { path: self.path.clone(), source };
            self.file.seek(SeekFrom::Start(self.data_start + start as u64)).map_err(read)?;
            self.file.read_exact(&mut bytes).map_err(read)?;
            let numbers = bytes.as_chunks::<4>().0.iter().map(|&x| f32::from_le_bytes(x)).collect();
            weights.insert(name.to_owned(), numbers);
        }
        Ok(weights)
    }
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

fn check_tensors(config: &ActConfig, header: &Metadata, path: &Path) -> Result<(), CheckpointError> {
    let mut specs = tensor_specs(config);
    let wants_statistics = STATISTICS.iter().any(|name| header.info(name).is_some());
    if wants_statistics {
        let widths = [config.state_dim, config.state_dim, config.action_dim, config.action_dim];
        specs.extend(STATISTICS.iter().zip(widths).map(|(name, width)| TensorSpec {
            name: (*name).to_owned(),
            shape: vec![width],
            role: Role::Live,
        }));
    }
    for spec in &specs {
        let expected = describe(Dtype::F32, &spec.shape);
        let (path, tensor) = (path.to_owned(), spec.name.clone());
        match header.info(&spec.name) {
            Some(info) if info.dtype == Dtype::F32 && info.shape == spec.shape => {}
            Some(info) => {
                let found = describe(info.dtype, &info.shape);
                return Err(CheckpointError::Mismatch { path, tensor, expected, found });
            }
            None if spec.role == Role::Live => {
                return Err(CheckpointError::Missing { path, tensor, expected });
            }
            None => {}
        }
    }
    let known: std::collections::BTreeSet<&str> = specs.iter().map(|spec| spec.name.as_str()).collect();
    let names: BTreeMap<_, _> = header.tensors().into_iter().collect();
    let unknown =
        names.iter().find(|(name, _)| !known.contains(name.as_str()) && !name.ends_with(IGNORED_SUFFIX));
    unknown.map_or(Ok(()), |(name, info)| {
        let found = describe(info.dtype, &info.shape);
        Err(CheckpointError::Unknown { path: path.to_owned(), tensor: name.clone(), found })
    })
}

/// For example `F32 [512, 25]`.
fn describe(dtype: Dtype, shape: &[usize]) -> String {
    format!("{dtype:?} {shape:?}")
}
