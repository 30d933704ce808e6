//! π0.5 checkpoint folders, as written by LeRobot's `save_pretrained` and by openpi's PyTorch trainer.
//!
//! LeRobot's contain `config.json`, weights in one file or in shards, and the pre- and postprocessor.
//! openpi's contain weights under names without `model.`, and `assets/…/norm_stats.json`; its robot and
//! cameras are described in `hypogeum.json`. Both need `tokenizer.model`, PaliGemma's SentencePiece model.

mod description;
mod lerobot;
pub mod names;
mod openpi;

use std::path::{Path, PathBuf};
#[cfg(feature = "gpu")]
use std::sync::Arc;

use run_config::allotment::available_memory;
use run_config::input;

use self::description::Folder;
pub use self::description::Pi05Description;
use self::names::Pi05Names;
#[cfg(feature = "gpu")]
use super::GpuPi05Network;
use super::model::{Pi05Model, Pi05Options};
use crate::formats::CheckpointError;
#[cfg(feature = "gpu")]
use crate::formats::CheckpointFolderError;
use crate::formats::mapping::{Sidecar, refuse_if};
use crate::formats::settings::Settings;
#[cfg(feature = "gpu")]
use crate::models::LoadGpuError;
use crate::nn::Precision;
#[cfg(feature = "gpu")]
use crate::nn::gpu::GpuDevice;
use crate::text::paligemma::PaliGemmaTokenizer;
use crate::weights::{CONFIG_FILE, INDEX_FILE, MODEL_FILE, TensorFolder};

/// A checkpoint whose configuration and weights headers have been checked against each other.
#[derive(Debug)]
pub struct Pi05Checkpoint {
    folder: PathBuf,
    tensors: TensorFolder,
    names: Pi05Names,
    description: Pi05Description,
}

/// Returns `true` if the folder itself contains the weights of a checkpoint.
pub(crate) fn is_pi05_folder(folder: &Path) -> bool {
    [CONFIG_FILE, MODEL_FILE, INDEX_FILE].iter().any(|name| folder.join(name).is_file())
}

impl Pi05Checkpoint {
    /// Reads the configuration in `folder` and the headers of its weights, and checks one against the other.
    ///
    /// # Errors
    /// The first mismatch found, with file, tensor, actual and expected value.
    pub fn open(folder: &Path) -> Result<Self, CheckpointError> {
        let path = folder.join(CONFIG_FILE);
        let mut settings = match input::read(&path) {
            Ok(text) => Settings::parse(&path, &text)?,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Settings::parse(&path, b"{}")?,
            Err(source) => return Err(CheckpointError::Read { path, source }),
        };
        let format: Option<String> = settings.take("type")?;
        if let Some(found) = format.as_ref().filter(|format| *format != "pi05") {
            return Err(CheckpointError::format(path, found, "`pi05`"));
        }
        let tensors = TensorFolder::open(folder)?;
        let names = Pi05Names::of(&tensors);
        let sidecar = Sidecar::read(folder)?;
        refuse_if(sidecar.language.is_some(), folder, "language", "ACT: π0.5 reads the instruction itself")?;
        let parts = Folder { folder, tensors: &tensors, names: &names, sidecar: &sidecar };
        let description = match format {
            Some(_) => parts.lerobot(settings),
            None => parts.openpi(settings),
        }?;
        let checkpoint = Self { folder: folder.to_owned(), tensors, names, description };
        checkpoint.check_tensors()?;
        Ok(checkpoint)
    }

    /// Returns the contents of the configuration.
    #[must_use]
    pub fn description(&self) -> &Pi05Description {
        &self.description
    }

    /// Returns the folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the weights.
    #[must_use]
    pub fn tensors(&self) -> &TensorFolder {
        &self.tensors
    }

    /// Loads the vocabulary.
    ///
    /// # Errors
    /// If the file is absent or damaged, or does not fit the embedding.
    pub fn tokenizer(&self) -> Result<PaliGemmaTokenizer, CheckpointError> {
        let Pi05Description { architecture, max_tokens, tokenizer_folder, .. } = &self.description;
        Ok(PaliGemmaTokenizer::load(tokenizer_folder, architecture.vocabulary, *max_tokens)?)
    }

    /// Checks that the weights fit into the memory that is available.
    ///
    /// # Errors
    /// If they do not.
    pub fn check_memory(&self, precision: Precision) -> Result<(), CheckpointError> {
        let Some(available) = available_memory() else { return Ok(()) };
        let bytes = |(size, name): (usize, &str)| {
            let stored = self.tensors.tensor(name).map_or(4, |tensor| tensor.float_type().size());
            size as u64 * if precision == Precision::Int8 { 1 } else { stored as u64 }
        };
        let specs = self.description.architecture.tensor_specs(&self.names);
        let sizes = specs.iter().map(|spec| (spec.shape.iter().product::<usize>(), spec.name.as_str()));
        let needed: u64 = sizes.map(bytes).sum();
        if needed <= available {
            return Ok(());
        }
        let (needed_mib, available_mib) = (needed >> 20, available >> 20);
        Err(CheckpointError::Memory { path: self.folder.clone(), needed_mib, available_mib })
    }

    /// Builds the network, after checking that all weights are finite. The threads of the current rayon pool
    /// share the work.
    ///
    /// # Errors
    /// If a value is not finite.
    pub fn load(&self, precision: Precision, n_steps: usize) -> Result<Pi05Model, CheckpointError> {
        self.check_values()?;
        let options = self.options(precision, n_steps);
        Ok(Pi05Model::load(&self.tensors, &self.names, self.description.architecture, options)?)
    }

    /// Like [`load`](Self::load), onto a device, with the weights as stored.
    ///
    /// # Errors
    /// If a value is not finite, or the device cannot hold the network, or fails.
    #[cfg(feature = "gpu")]
    pub fn load_on_gpu(&self, gpu: &Arc<GpuDevice>, n_steps: usize) -> Result<GpuPi05Network, LoadGpuError> {
        self.check_values().map_err(CheckpointFolderError::from)?;
        let Pi05Description { architecture, mapping, .. } = &self.description;
        let options = self.options(Precision::F32, n_steps);
        let tensors = (&self.tensors, &self.names);
        GpuPi05Network::load(gpu, tensors, *architecture, options, mapping.cameras.len())
    }

    fn options(&self, precision: Precision, n_steps: usize) -> Pi05Options {
        let Pi05Description { architecture, mapping, max_tokens, periods, .. } = &self.description;
        let max_prefix = mapping.cameras.len() * architecture.vision.n_patches + max_tokens;
        Pi05Options { precision, n_steps, periods: *periods, max_prefix }
    }

    /// Checks that all weights are finite, also those that only training uses.
    fn check_values(&self) -> Result<(), CheckpointError> {
        for name in self.tensors.names() {
            if !self.tensors.tensor(name)?.is_finite() {
                let path = self.tensors.path_of(name).to_owned();
                return Err(CheckpointError::NotFinite { path, tensor: name.to_owned() });
            }
        }
        Ok(())
    }

    fn check_tensors(&self) -> Result<(), CheckpointError> {
        let mut known = std::collections::BTreeSet::new();
        for spec in self.description.architecture.tensor_specs(&self.names) {
            self.tensors.check(&spec.name, &spec.shape)?;
            known.insert(spec.name);
        }
        let unexpected =
            self.tensors.names().find(|name| !known.contains(*name) && !self.names.is_unused(name));
        unexpected.map_or(Ok(()), |tensor| {
            let found = self.tensors.describe(tensor).unwrap_or_default();
            let path = self.tensors.path_of(tensor).to_owned();
            Err(CheckpointError::UnexpectedTensor { path, tensor: tensor.to_owned(), found })
        })
    }
}
