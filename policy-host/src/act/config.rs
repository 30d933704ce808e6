//! `config.json` of an ACT checkpoint: everything about the network that its tensors do not say themselves.

use std::path::Path;

use ipc_types::layout::{MAX_ACTION_DIM, MAX_HORIZON, MAX_STATE_DIM};
use ipc_types::{ControlMode, Morphology};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Name of the file in a checkpoint folder.
pub const CONFIG_FILE: &str = "config.json";

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
    /// Rows of an action chunk, at most [`MAX_HORIZON`].
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

/// Where instruction embeddings come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LanguageConfig {
    /// The encoder.
    pub encoder: TextEncoder,
    /// Width of an embedding.
    pub dim: usize,
}

/// The known instruction encoders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TextEncoder {
    /// [`crate::text`]: no weights.
    Hashed,
}

/// A configuration that cannot be used.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum ConfigError {
    #[error("{0}")]
    Read(#[from] std::io::Error),
    #[error("{0}")]
    Json(#[from] serde_json::Error),
    #[error("`{key}` is {found}, expected {expected}")]
    Value { key: &'static str, found: usize, expected: String },
}

impl ActConfig {
    /// Width of the latent variable; zero at inference.
    pub const LATENT_DIM: usize = 32;
    /// Side of every image as the network sees it.
    pub const IMAGE_SIDE: usize = 224;
    /// Side of the backbone's last feature map.
    pub const FEATURE_SIDE: usize = 7;

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
            n_cameras: n_cameras(morphology),
            num_queries: 30,
            hidden_dim: 512,
            dim_feedforward: 1600,
            nheads: 8,
            enc_layers: 4,
            dec_layers: 7,
            backbone: Backbone::ResNet18,
            backbone_width: 64,
            language: Some(LanguageConfig { encoder: TextEncoder::Hashed, dim: 512 }),
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
            language: Some(LanguageConfig { encoder: TextEncoder::Hashed, dim: 64 }),
            ..Self::full_size(morphology)
        }
    }

    /// Reads and checks `config.json` in `folder`.
    ///
    /// # Errors
    /// If it cannot be read or parsed, has an unknown or missing key, or a value that no network can have.
    pub fn read(folder: &Path) -> Result<Self, ConfigError> {
        let config: Self = serde_json::from_slice(&std::fs::read(folder.join(CONFIG_FILE))?)?;
        config.check()?;
        Ok(config)
    }

    /// Checks every value against its limits and, with a morphology, against the robot.
    ///
    /// # Errors
    /// The first value that does not fit.
    pub fn check(&self) -> Result<(), ConfigError> {
        let limits = [
            ("state_dim", self.state_dim, MAX_STATE_DIM),
            ("action_dim", self.action_dim, MAX_ACTION_DIM),
            ("n_cameras", self.n_cameras, 8),
            ("num_queries", self.num_queries, MAX_HORIZON),
            ("hidden_dim", self.hidden_dim, 4096),
            ("dim_feedforward", self.dim_feedforward, 16_384),
            ("nheads", self.nheads, 64),
            ("enc_layers", self.enc_layers, 32),
            ("dec_layers", self.dec_layers, 32),
            ("backbone_width", self.backbone_width, 256),
            ("language.dim", self.language.map_or(1, |language| language.dim), 4096),
        ];
        for (key, found, limit) in limits {
            if found == 0 || found > limit {
                return Err(ConfigError::Value { key, found, expected: format!("1 to {limit}") });
            }
        }
        if !self.hidden_dim.is_multiple_of(4) || !self.hidden_dim.is_multiple_of(self.nheads) {
            let expected = format!("a multiple of 4 and of nheads = {}", self.nheads);
            return Err(ConfigError::Value { key: "hidden_dim", found: self.hidden_dim, expected });
        }
        self.morphology.map_or(Ok(()), |morphology| self.check_robot(morphology))
    }

    fn check_robot(&self, morphology: Morphology) -> Result<(), ConfigError> {
        let needs = [
            ("state_dim", self.state_dim, morphology.state_dim()),
            ("action_dim", self.action_dim, self.control_mode.action_dim(morphology)),
            ("n_cameras", self.n_cameras, n_cameras(morphology)),
        ];
        for (key, found, need) in needs {
            if found != need {
                let robot = format!("{}, {}", morphology.name(), self.control_mode.name());
                return Err(ConfigError::Value { key, found, expected: format!("{need} ({robot})") });
            }
        }
        Ok(())
    }

    /// Tokens that images make: 49 a camera.
    #[must_use]
    pub fn n_image_tokens(&self) -> usize {
        self.n_cameras * Self::FEATURE_SIDE * Self::FEATURE_SIDE
    }

    /// Most tokens in the encoder: latent, state, language if it can be there, images.
    #[must_use]
    pub fn max_tokens(&self) -> usize {
        2 + usize::from(self.language.is_some()) + self.n_image_tokens()
    }
}

/// Images in an observation of a robot.
#[must_use]
pub(crate) fn n_cameras(morphology: Morphology) -> usize {
    morphology.n_external_cameras() + morphology.n_hand_cameras()
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
