//! The benchmark's ACT: `config.json` of type `act_colosseum`, everything about the network that its tensors do not say
//! themselves.

use std::path::Path;

use ipc_types::layout::{MAX_ACTION_DIM, MAX_STATE_DIM};
use ipc_types::{ControlMode, Morphology};
use serde::{Deserialize, Serialize};

use super::file::TensorFile;
use super::{CheckpointError, Description, MODEL_FILE, Naming, Wiring, parse};
use crate::act::architecture::{Architecture, ImageSize, InstructionInput, Projection, ResNet};
use crate::act::normalise::{Affine, Normalisation};
use crate::text::LanguageConfig;

/// Names of the optional normalisation statistics: all of them or none.
pub const STATISTICS: [&str; 4] =
    ["norm_stats.state_mean", "norm_stats.state_std", "norm_stats.action_mean", "norm_stats.action_std"];
/// Smallest standard deviation that normalisation divides by (spec/eval.md §1.3).
const MIN_STD: f32 = 0.01;
/// Side of every image as the network sees it.
const IMAGE_SIDE: usize = 224;
/// Beginnings of the names of what only training uses.
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

/// Hyperparameters of one network, as its `config.json` spells them. Unknown keys are errors.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActConfig {
    /// Always `act_colosseum`.
    #[serde(rename = "type")]
    pub kind: Kind,
    /// The robot it drives; `null` for parity data that fits no robot.
    #[serde(deserialize_with = "Option::deserialize")]
    pub morphology: Option<Morphology>,
    /// How its action rows are meant, by ManiSkill's name.
    #[serde(with = "control_mode_name")]
    pub control_mode: ControlMode,
    /// Width of the state vector.
    pub state_dim: usize,
    /// Width of an action row.
    pub action_dim: usize,
    /// Images in an observation, hand cameras included.
    pub n_cameras: usize,
    /// Rows of an action chunk.
    pub num_queries: usize,
    /// Width of a token.
    pub hidden_dim: usize,
    /// Inner width of the feed-forward layers.
    pub dim_feedforward: usize,
    /// Attention heads.
    pub nheads: usize,
    /// Encoder layers; the training-only encoder of the variational part has as many.
    pub enc_layers: usize,
    /// Decoder layers. Only the first reaches the output (spec/eval.md §1.2).
    pub dec_layers: usize,
    /// Always `resnet18`.
    pub backbone: Backbone,
    /// Channels of the backbone's first stage: 64 is the real network, less makes small checkpoints.
    pub backbone_width: usize,
    /// The encoder of instructions it was trained with, or `null` for a network without a language token.
    #[serde(deserialize_with = "Option::deserialize")]
    pub language: Option<LanguageConfig>,
}

/// The network type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kind {
    /// The benchmark's ACT with a language token.
    #[serde(rename = "act_colosseum")]
    ActColosseum,
}

/// The image network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Backbone {
    /// ResNet-18 without its classifier.
    #[serde(rename = "resnet18")]
    ResNet18,
}

impl ActConfig {
    /// The benchmark's network for a robot: spec/eval.md §1.1, with the weight-free instruction encoder.
    #[must_use]
    pub fn full_size(morphology: Morphology) -> Self {
        let control_mode = morphology.default_control_mode();
        Self {
            kind: Kind::ActColosseum,
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
            backbone: Backbone::ResNet18,
            backbone_width: 64,
            language: Some(LanguageConfig::Hashed { dim: 512 }),
        }
    }

    /// A network of the same shape small enough for tests and first trials: a sixteenth to an eighth of the widths, two encoder
    /// layers.
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

    /// The network it describes.
    #[must_use]
    pub fn architecture(&self) -> Architecture {
        let instruction = self.language.as_ref();
        Architecture {
            cameras: vec![ImageSize { height: IMAGE_SIDE, width: IMAGE_SIDE }; self.n_cameras],
            state_dim: Some(self.state_dim),
            instruction: instruction
                .map(|language| InstructionInput { dim: language.dim(), projection: Projection::Mlp }),
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

    /// What its numbers go through when its checkpoint holds no statistics.
    #[must_use]
    pub fn raw_normalisation(&self) -> Normalisation {
        Normalisation { images: vec![Some(Affine::image_net()); self.n_cameras], ..Normalisation::default() }
    }

    /// How a robot's observation becomes its input.
    ///
    /// # Errors
    /// If it names no robot.
    pub fn wiring(&self) -> Result<Wiring, String> {
        let Some(morphology) = self.morphology else {
            return Err("`morphology` is null, expected \"single\" or \"bimanual\"".to_owned());
        };
        Ok(Wiring {
            morphology,
            control_mode: self.control_mode,
            cameras: (0..self.n_cameras).collect(),
            state: std::iter::once(0..self.state_dim).collect(),
        })
    }

    /// Checks every value against its limits and, with a morphology, against the robot: key, what was found, what was
    /// expected.
    ///
    /// # Errors
    /// The first value that does not fit.
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
        let needs = [
            ("state_dim", self.state_dim, morphology.state_dim()),
            ("action_dim", self.action_dim, self.control_mode.action_dim(morphology)),
            ("n_cameras", self.n_cameras, morphology.camera_names().len()),
        ];
        let robot = format!("{}, {}", morphology.name(), self.control_mode.name());
        let differs = needs.into_iter().find(|(_, found, need)| found != need);
        differs.map_or(Ok(()), |(key, found, need)| Err((key, found, format!("{need} ({robot})"))))
    }
}

/// Reads what `config.json` at `path` says, and the statistics among the tensors, which are opened for it.
pub(super) fn describe(
    path: &Path,
    text: &[u8],
    tensors: &mut Option<TensorFile>,
) -> Result<Description, CheckpointError> {
    let config: ActConfig = parse(path, text)?;
    config.check().map_err(|(key, found, expected)| CheckpointError::Value {
        path: path.to_owned(),
        key: key.to_owned(),
        found: found.to_string(),
        expected,
    })?;
    let tensors = tensors.insert(TensorFile::open(&path.with_file_name(MODEL_FILE))?);
    let mut normalisation = config.raw_normalisation();
    if STATISTICS.iter().any(|name| tensors.has(name)) {
        let [state, action] = [(0, config.state_dim), (2, config.action_dim)].map(|(first, width)| {
            let mut read = |name: &str| {
                tensors.check(name, &[width])?;
                tensors.read(name)
            };
            let shift = read(STATISTICS[first])?;
            let scale = read(STATISTICS[first + 1])?.into_iter().map(|std| std.max(MIN_STD)).collect();
            Ok::<_, CheckpointError>(Affine { shift, scale })
        });
        (normalisation.state, normalisation.action) = (Some(state?), Some(action?));
    }
    let later_layers = (1..config.dec_layers).map(|layer| format!("transformer.decoder.layers.{layer}."));
    let unused = UNUSED.into_iter().chain(STATISTICS).map(str::to_owned).chain(later_layers).collect();
    Ok(Description {
        architecture: config.architecture(),
        normalisation,
        naming: Naming { prefixes: &[], unused },
        wiring: config.wiring(),
        language: config.language,
        ensemble_decay: None,
    })
}

/// A control mode by ManiSkill's name, or none.
pub(super) fn optional_control_mode<'de, D: serde::Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<ControlMode>, D::Error> {
    control_mode_name::deserialize(deserializer).map(Some)
}

/// Control modes by ManiSkill's names.
mod control_mode_name {
    use ipc_types::ControlMode;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
    pub(super) fn serialize<S: Serializer>(mode: &ControlMode, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(mode.name())
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<ControlMode, D::Error> {
        let name = String::deserialize(deserializer)?;
        ControlMode::ALL.into_iter().find(|mode| mode.name() == name).ok_or_else(|| {
            let known = ControlMode::ALL.map(ControlMode::name).join(", ");
            D::Error::custom(format!("unknown control_mode `{name}`, expected one of {known}"))
        })
    }
}
