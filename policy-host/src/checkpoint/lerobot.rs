//! LeRobot's ACT format, as written by `save_pretrained`: `config.json`, `model.safetensors`, and the
//! normalisation statistics. Since LeRobot 0.4 the statistics are in the files of the pre- and postprocessor;
//! before, they were buffers among the weights.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::mapping::{FeatureKind, InputFeature, Sidecar, map_features};
use super::processor::{NormalisationMode, Statistics};
use super::{CheckpointError, Description, TensorNames, parse};
use crate::act::architecture::{Architecture, ImageSize, InstructionInput, ResNet, TokenProjection};
use crate::act::normalise::Normalisation;
use crate::weights::{CONFIG_FILE, MODEL_FILE, TensorFile};

/// Pairs of the benchmark's and LeRobot's tensor name prefixes.
const PREFIXES: [(&str, &str); 9] = [
    ("transformer.", "model."),
    ("backbones.0.0.body.", "model.backbone."),
    ("action_head.", "model.action_head."),
    ("query_embed.", "model.decoder_pos_embed."),
    ("additional_pos_embed.", "model.encoder_1d_feature_pos_embed."),
    ("latent_out_proj.", "model.encoder_latent_input_proj."),
    ("input_proj_robot_state.", "model.encoder_robot_state_input_proj."),
    ("input_proj_env_state.", "model.encoder_env_state_input_proj."),
    ("input_proj.", "model.encoder_img_feat_input_proj."),
];
/// Name prefixes of tensors that only training uses, and of normalisation statistics.
const UNUSED: [&str; 5] = [
    "model.vae_encoder",
    "model.encoder_latent_input_proj.weight",
    "normalize_inputs.",
    "normalize_targets.",
    "unnormalize_outputs.",
];
/// Name of the action feature.
const ACTION: &str = "action";

/// The keys of `config.json` that inference depends on. All others are ignored.
#[derive(Debug, Deserialize)]
struct LeRobotConfig {
    input_features: BTreeMap<String, FeatureShape>,
    output_features: BTreeMap<String, FeatureShape>,
    normalization_mapping: BTreeMap<String, NormalisationMode>,
    #[serde(default = "one")]
    n_obs_steps: usize,
    chunk_size: usize,
    vision_backbone: String,
    replace_final_stride_with_dilation: Flag,
    pre_norm: bool,
    dim_model: usize,
    n_heads: usize,
    dim_feedforward: usize,
    feedforward_activation: String,
    n_encoder_layers: usize,
    n_decoder_layers: usize,
    temporal_ensemble_coeff: Option<f64>,
}

#[derive(Debug, Deserialize)]
pub(super) struct FeatureShape {
    #[serde(rename = "type")]
    pub(super) kind: FeatureKind,
    pub(super) shape: Vec<usize>,
}

/// A boolean that some LeRobot versions write as a number.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Flag {
    Bool(bool),
    Number(u8),
}

const fn one() -> usize {
    1
}

impl Flag {
    fn is_set(&self) -> bool {
        match *self {
            Self::Bool(set) => set,
            Self::Number(number) => number != 0,
        }
    }
}

impl LeRobotConfig {
    /// Returns the first option that this implementation does not support, as key, actual value and expected
    /// value.
    fn unsupported(&self) -> Option<(&'static str, String, &'static str)> {
        let backbones = "resnet18 or resnet34";
        [
            (self.n_obs_steps != 1, "n_obs_steps", self.n_obs_steps.to_string(), "1"),
            (self.backbone().is_none(), "vision_backbone", format!("`{}`", self.vision_backbone), backbones),
            (
                self.replace_final_stride_with_dilation.is_set(),
                "replace_final_stride_with_dilation",
                "true".to_owned(),
                "false",
            ),
            (self.pre_norm, "pre_norm", "true".to_owned(), "false"),
            (
                self.feedforward_activation != "relu",
                "feedforward_activation",
                format!("`{}`", self.feedforward_activation),
                "relu",
            ),
        ]
        .into_iter()
        .find_map(|(differs, key, found, expected)| differs.then_some((key, found, expected)))
    }

    fn backbone(&self) -> Option<ResNet> {
        match self.vision_backbone.as_str() {
            "resnet18" => Some(ResNet::RESNET_18),
            "resnet34" => Some(ResNet::RESNET_34),
            _ => None,
        }
    }
}

/// Reads the configuration, the processors and the observation mapping in `folder`. Opens the weights file
/// and stores it in `tensors`.
pub(super) fn describe(
    folder: &Path,
    text: &[u8],
    tensors: &mut Option<TensorFile>,
) -> Result<Description, CheckpointError> {
    let path = folder.join(CONFIG_FILE);
    let config: LeRobotConfig = parse(&path, text)?;
    let value = |key: &str, found: String, expected: &str| CheckpointError::Value {
        path: path.clone(),
        key: key.to_owned(),
        found,
        expected: expected.to_owned(),
    };
    if let Some((key, found, expected)) = config.unsupported() {
        return Err(value(key, found, expected));
    }
    let action = config.output_features.get(ACTION);
    let action_dim = match action.map(|action| &action.shape[..]) {
        Some(&[dim]) => dim,
        found => return Err(value("output_features.action", format!("{found:?}"), "a shape [dim]")),
    };
    let inputs = inputs(&config).map_err(|(name, shape)| {
        value(
            &format!("input_features.{name}"),
            format!("{shape:?}"),
            "[dim], or [3, height, width] for an image",
        )
    })?;
    let of_kind = |kind: FeatureKind| inputs.iter().filter(move |input| input.kind == kind);
    for kind in [FeatureKind::State, FeatureKind::Env] {
        if of_kind(kind).count() > 1 {
            return Err(value(
                "input_features",
                format!("{} features of type {kind:?}", of_kind(kind).count()),
                "at most one",
            ));
        }
    }
    let tensors = tensors.insert(TensorFile::open(&folder.join(MODEL_FILE))?);
    let mut architecture = architecture(&config, &inputs, action_dim);
    // The backbone name determines the depth, its first tensor the width.
    if let Some(&[width, ..]) = tensors.shape("model.backbone.conv1.weight") {
        architecture.backbone.width = width;
    }
    let statistics = Statistics::find(folder, &config.normalization_mapping, tensors)?;
    let normalisation = normalisation(statistics, &inputs, action_dim)?;
    let sidecar = Sidecar::read(folder)?;
    Ok(Description {
        architecture,
        normalisation,
        names: TensorNames { prefixes: &PREFIXES, unused: UNUSED.map(str::to_owned).into() },
        mapping: map_features(&inputs, action_dim, &sidecar),
        language: sidecar.language,
        ensemble_decay: config.temporal_ensemble_coeff,
    })
}

fn architecture(config: &LeRobotConfig, inputs: &[InputFeature], action_dim: usize) -> Architecture {
    let of_kind = |kind: FeatureKind| inputs.iter().filter(move |input| input.kind == kind);
    let dim = |kind: FeatureKind| of_kind(kind).next().map(|input| input.shape[0]);
    let size = |input: &InputFeature| ImageSize { height: input.shape[1], width: input.shape[2] };
    Architecture {
        cameras: of_kind(FeatureKind::Visual).map(size).collect(),
        state_dim: dim(FeatureKind::State),
        instruction: dim(FeatureKind::Env)
            .map(|dim| InstructionInput { dim, projection: TokenProjection::Linear }),
        action_dim,
        horizon: config.chunk_size,
        hidden_dim: config.dim_model,
        dim_feedforward: config.dim_feedforward,
        n_heads: config.n_heads,
        enc_layers: config.n_encoder_layers,
        dec_layers: config.n_decoder_layers,
        backbone: config.backbone().unwrap_or(ResNet::RESNET_18),
    }
}

fn normalisation(
    mut statistics: Statistics<'_>,
    inputs: &[InputFeature],
    action_dim: usize,
) -> Result<Normalisation, CheckpointError> {
    let mut normalisation = Normalisation::default();
    for input in inputs {
        let dim = if input.kind == FeatureKind::Visual { 3 } else { input.shape[0] };
        let shift_scale = statistics.input(&input.name, input.kind, dim)?;
        match input.kind {
            FeatureKind::Visual => normalisation.images.push(shift_scale),
            FeatureKind::State => normalisation.state = shift_scale,
            FeatureKind::Env => normalisation.instruction = shift_scale,
            FeatureKind::Action => {}
        }
    }
    normalisation.action = statistics.action(ACTION, action_dim)?;
    Ok(normalisation)
}

/// Returns the input features, cameras first, ordered by name; or the first feature whose shape is invalid.
fn inputs(config: &LeRobotConfig) -> Result<Vec<InputFeature>, (String, Vec<usize>)> {
    let mut inputs = Vec::new();
    for (name, FeatureShape { kind, shape }) in &config.input_features {
        let fits = match kind {
            FeatureKind::Visual => matches!(shape[..], [3, _, _]),
            FeatureKind::State | FeatureKind::Env => shape.len() == 1,
            FeatureKind::Action => false,
        };
        if !fits {
            return Err((name.clone(), shape.clone()));
        }
        inputs.push(InputFeature { name: name.clone(), shape: shape.clone(), kind: *kind });
    }
    inputs.sort_by_key(|input| input.kind);
    Ok(inputs)
}
