//! Description of an ACT checkpoint, which both of its formats produce.

use crate::formats::mapping::ObservationMapping;
use crate::models::act::architecture::{Architecture, Normalisation};
use crate::policy::execution::ChunkSettings;
use crate::text::LanguageConfig;

/// Contents of a folder's configuration, independent of its format.
#[derive(Debug)]
pub(crate) struct ActDescription {
    pub(crate) architecture: Architecture,
    pub(crate) normalisation: Normalisation,
    pub(crate) names: TensorNames,
    /// Mapping from the robot's observation to the network's input, or the reason why there is none.
    pub(crate) mapping: Result<ObservationMapping, String>,
    pub(crate) language: Option<LanguageConfig>,
    /// Use of its chunks.
    pub(crate) chunk: ChunkSettings,
    /// Sentences for the user about its settings.
    pub(crate) notes: Vec<String>,
}

/// Tensor naming of a checkpoint format, relative to the benchmark's names.
#[derive(Debug)]
pub(crate) struct TensorNames {
    /// Pairs of the benchmark's prefix and the stored prefix. The first match applies.
    pub(crate) prefixes: &'static [(&'static str, &'static str)],
    /// Prefixes of stored names that inference does not need.
    pub(crate) unused: Vec<String>,
}

impl TensorNames {
    /// Returns the name under which the file stores a tensor.
    pub(crate) fn stored(&self, name: &str) -> String {
        let renamed = self
            .prefixes
            .iter()
            .find_map(|(from, to)| name.strip_prefix(from).map(|rest| format!("{to}{rest}")));
        renamed.unwrap_or_else(|| name.to_owned())
    }
}
