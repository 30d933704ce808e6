//! The benchmark's ACT format: `config.json` of type `act_colosseum`, which holds the hyperparameters that
//! the tensors do not determine.

use std::path::Path;

use ipc_types::layout::{MAX_ACTION_DIM, MAX_STATE_DIM};
use ipc_types::{ControlMode, ImageSize, Morphology};
use serde::{Deserialize, Serialize};

use super::description::{ActDescription, TensorNames};
use crate::formats::CheckpointError;
use crate::formats::files::MAPPING_FILE;
use crate::formats::mapping::ObservationMapping;
use crate::formats::scaling::ShiftScale;
use crate::formats::settings::parse;
use crate::models::act::architecture::{
    Architecture, InstructionInput, Normalisation, ResNet, TokenProjection,
};
use crate::policy::execution::ChunkSettings;
use crate::text::LanguageConfig;
use crate::weights::{MODEL_FILE, TensorFile};

/// Tensors of the optional normalisation statistics. A checkpoint contains either all of them or none.
pub const STATISTICS: [&str; 4] =
    ["norm_stats.state_mean", "norm_stats.state_std", "norm_stats.action_mean", "norm_stats.action_std"];
/// Lower bound of the standard deviation in normalisation (docs/benchmark.md, "Policies and evaluation").
const MIN_STD: f32 = 0.01;
/// Height and width of every network input image, in pixels.
const IMAGE_SIDE: usize = 224;
/// Name prefixes of tensors that only training uses.
const UNUSED: [&str; 8] = [
    "encoder.",
    "pos_table",
    "cls_embed.",
    "encoder_state_proj.",
    "encoder_action_proj.",
    "latent_proj.",
    "latent_out_proj.weight",
    "lang_encoder.",
];

/// Hyperparameters of a network, as stored in `config.json`. Unknown keys are errors.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActConfig {
    /// Network type, always `act_colosseum`.
    #[serde(rename = "type")]
    pub kind: NetworkType,
    /// Robot that the network controls; `null` for parity data that matches no robot.
    #[serde(deserialize_with = "Option::deserialize")]
    pub morphology: Option<Morphology>,
    /// Control mode of its actions, under ManiSkill's name.
    pub control_mode: ControlMode,
    /// Dimension of the state vector.
    pub state_dim: usize,
    /// Dimension of an action.
    pub action_dim: usize,
    /// Number of images in an observation, hand cameras included.
    pub n_cameras: usize,
    /// Number of actions in a chunk.
    pub num_queries: usize,
    /// Model width, the dimension of a token.
    pub hidden_dim: usize,
    /// Hidden width of the feed-forward layers.
    pub dim_feedforward: usize,
    /// Number of attention heads.
    pub nheads: usize,
    /// Number of encoder layers, also in the training-only CVAE encoder.
    pub enc_layers: usize,
    /// Number of decoder layers. Only the first affects the output (docs/benchmark.md, "Policies and
    /// evaluation").
    pub dec_layers: usize,
    /// Image backbone, always `resnet18`.
    pub backbone: BackboneName,
    /// Channels of the backbone's first stage: 64 in the real network, fewer in small test checkpoints.
    pub backbone_width: usize,
    /// Language encoder used for training, or `null` for a network without an instruction token.
    #[serde(deserialize_with = "Option::deserialize")]
    pub language: Option<LanguageConfig>,
}

/// Network types of this format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum NetworkType {
    /// The benchmark's ACT with an instruction token.
    #[serde(rename = "act_colosseum")]
    ActColosseum,
}

/// Image backbones of this format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BackboneName {
    /// ResNet-18 without the classifier.
    #[serde(rename = "resnet18")]
    ResNet18,
}

impl ActConfig {
    /// Returns the benchmark's network for a robot (docs/benchmark.md, "Policies and evaluation"), with the
    /// weight-free language encoder.
    #[must_use]
    pub fn full_size(morphology: Morphology) -> Self {
        let control_mode = morphology.default_control_mode();
        Self {
            kind: NetworkType::ActColosseum,
            morphology: Some(morphology),
            control_mode,
            state_dim: morphology.state_dim(),
            action_dim: control_mode.action_dim(morphology),
            n_cameras: morphology.camera_names().len(),
            num_queries: 30,
            hidden_dim: 512,
            dim_feedforward: 1600,
            nheads: 8,
            enc_layers: 4,
            dec_layers: 7,
            backbone: BackboneName::ResNet18,
            backbone_width: 64,
            language: Some(LanguageConfig::Hashed { dim: 512 }),
        }
    }

    /// Returns a network of the same structure for tests and first trials: 1/16 to 1/8 of the widths, two
    /// encoder layers.
    #[must_use]
    pub fn tiny(morphology: Morphology) -> Self {
        Self {
            hidden_dim: 64,
            dim_feedforward: 128,
            nheads: 4,
            enc_layers: 2,
            dec_layers: 1,
            backbone_width: 4,
            language: Some(LanguageConfig::Hashed { dim: 64 }),
            ..Self::full_size(morphology)
        }
    }

    /// Returns the architecture of the network.
    #[must_use]
    pub fn architecture(&self) -> Architecture {
        let instruction = self.language.as_ref();
        Architecture {
            cameras: vec![ImageSize { height: IMAGE_SIDE, width: IMAGE_SIDE }; self.n_cameras],
            state_dim: Some(self.state_dim),
            instruction: instruction
                .map(|language| InstructionInput { dim: language.dim(), projection: TokenProjection::Mlp }),
            action_dim: self.action_dim,
            horizon: self.num_queries,
            hidden_dim: self.hidden_dim,
            dim_feedforward: self.dim_feedforward,
            n_heads: self.nheads,
            enc_layers: self.enc_layers,
            dec_layers: 1,
            backbone: ResNet { width: self.backbone_width, ..ResNet::RESNET_18 },
        }
    }

    /// Returns the normalisation used when the checkpoint contains no statistics.
    #[must_use]
    pub fn raw_normalisation(&self) -> Normalisation {
        Normalisation {
            images: vec![Some(ShiftScale::image_net()); self.n_cameras],
            ..Normalisation::default()
        }
    }

    /// Returns the mapping from the robot's observation to the network's input.
    ///
    /// # Errors
    /// If the configuration names no robot.
    pub fn mapping(&self) -> Result<ObservationMapping, String> {
        let Some(morphology) = self.morphology else {
            return Err("`morphology` is null, expected \"single\" or \"bimanual\"".to_owned());
        };
        Ok(ObservationMapping {
            // Images of hand cameras were enlarged in training, too.
            trained_sizes: Vec::new(),
            protocol: None,
            morphology,
            control_mode: self.control_mode,
            cameras: (0..self.n_cameras).collect(),
            state: std::iter::once(0..self.state_dim).collect(),
        })
    }

    /// Checks every value against its limits and, if a morphology is given, against the robot.
    ///
    /// # Errors
    /// The first invalid value, as key, actual value and expected value.
    fn check(&self) -> Result<(), (&'static str, usize, String)> {
        let limits = [
            ("state_dim", self.state_dim, MAX_STATE_DIM),
            ("action_dim", self.action_dim, MAX_ACTION_DIM),
            ("n_cameras", self.n_cameras, 8),
            ("num_queries", self.num_queries, Architecture::MAX_HORIZON),
            ("nheads", self.nheads, 64),
            ("dec_layers", self.dec_layers, 32),
        ];
        for (key, found, limit) in limits {
            if found == 0 || found > limit {
                return Err((key, found, format!("1 to {limit}")));
            }
        }
        let Some(morphology) = self.morphology else { return Ok(()) };
        let required = [
            ("state_dim", self.state_dim, morphology.state_dim()),
            ("action_dim", self.action_dim, self.control_mode.action_dim(morphology)),
            ("n_cameras", self.n_cameras, morphology.camera_names().len()),
        ];
        let robot = format!("{}, {}", morphology.name(), self.control_mode.name());
        let differs = required.into_iter().find(|(_, found, required)| found != required);
        differs.map_or(Ok(()), |(key, found, required)| Err((key, found, format!("{required} ({robot})"))))
    }
}

/// Reads the configuration at `path` and the normalisation statistics. Opens the weights file and stores it
/// in `tensors`.
pub(crate) fn describe(
    path: &Path,
    text: &[u8],
    tensors: &mut Option<TensorFile>,
) -> Result<ActDescription, CheckpointError> {
    let config: ActConfig = parse(path, text)?;
    config.check().map_err(|(key, found, expected)| CheckpointError::Value {
        path: path.to_owned(),
        key: key.to_owned(),
        found: found.to_string(),
        expected,
    })?;
    let tensors = tensors.insert(TensorFile::open(&path.with_file_name(MODEL_FILE))?);
    let sidecar = path.with_file_name(MAPPING_FILE);
    if sidecar.exists() {
        return Err(CheckpointError::Value {
            path: sidecar,
            key: "mapping".to_owned(),
            found: "a mapping file".to_owned(),
            expected: "none: the benchmark's own format describes its inputs in config.json".to_owned(),
        });
    }
    let mut normalisation = config.raw_normalisation();
    if STATISTICS.iter().any(|name| tensors.contains(name)) {
        let [state, action] = [(0, config.state_dim), (2, config.action_dim)].map(|(first, width)| {
            let mut read = |name: &str| {
                tensors.check(name, &[width])?;
                tensors.read(name)
            };
            let shift = read(STATISTICS[first])?;
            let scale = read(STATISTICS[first + 1])?.into_iter().map(|std| std.max(MIN_STD)).collect();
            Ok::<_, CheckpointError>(ShiftScale::new(shift, scale))
        });
        (normalisation.state, normalisation.action) = (Some(state?), Some(action?));
    }
    let later_layers = (1..config.dec_layers).map(|layer| format!("transformer.decoder.layers.{layer}."));
    let unused = UNUSED.into_iter().chain(STATISTICS).map(str::to_owned).chain(later_layers).collect();
    Ok(ActDescription {
        architecture: config.architecture(),
        normalisation,
        names: TensorNames { prefixes: &[], unused },
        mapping: config.mapping(),
        chunk: ChunkSettings { horizon: config.num_queries, execute: None, ensemble_decay: None },
        language: config.language,
        notes: Vec::new(),
    })
}
