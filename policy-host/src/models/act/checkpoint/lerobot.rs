//! LeRobot's ACT format, as written by `save_pretrained`: `config.json`, `model.safetensors`, and the
//! normalisation statistics. Since LeRobot 0.4 the statistics are in the files of the pre- and postprocessor;
//! before, they were buffers among the weights.

use std::collections::BTreeMap;
use std::path::Path;

use super::description::{ActDescription, TensorNames};
use crate::formats::CheckpointError;
use crate::formats::files::PREPROCESSOR;
use crate::formats::lerobot::feature::{FeatureKind, FeatureShape, InputFeature, rename};
use crate::formats::lerobot::processor::Processors;
use crate::formats::lerobot::statistics::{ACTION, Modes, NormalisationMode, Normaliser};
use crate::formats::lerobot::{read_base, read_chunk};
use crate::formats::mapping::{Sidecar, map_features, refuse_if};
use crate::formats::settings::Settings;
use crate::models::act::architecture::{
    Architecture, InstructionInput, Normalisation, ResNet, TokenProjection,
};
use crate::policy::execution::ChunkSettings;
use crate::text::LanguageConfig;
use crate::weights::{MODEL_FILE, TensorFile};

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
/// Settings of ACT that have no influence on actions: those of training, and of tensors that inference does
/// not read.
const WITHOUT_INFLUENCE: [&str; 9] = [
    "pretrained_backbone_weights",
    "use_vae",
    "latent_dim",
    "n_vae_encoder_layers",
    "dropout",
    "kl_weight",
    "optimizer_lr",
    "optimizer_weight_decay",
    "optimizer_lr_backbone",
];

/// The settings of `config.json` that a network depends on, with LeRobot's defaults.
#[derive(Debug)]
struct LeRobotConfig {
    input_features: BTreeMap<String, FeatureShape>,
    action_dim: usize,
    modes: Modes,
    chunk: ChunkSettings,
    backbone: ResNet,
    dim_model: usize,
    n_heads: usize,
    dim_feedforward: usize,
    n_encoder_layers: usize,
    n_decoder_layers: usize,
}

impl LeRobotConfig {
    /// Reads LeRobot's `ACTConfig`. Settings that are not supported are refused by name.
    fn read(settings: &mut Settings, notes: &mut Vec<String>) -> Result<Self, CheckpointError> {
        read_base(settings, notes)?;
        settings.discard(&WITHOUT_INFLUENCE);
        settings.refuse_switch("replace_final_stride_with_dilation", "false")?;
        settings.refuse_switch("pre_norm", "false")?;
        let activation = settings.take_or("feedforward_activation", "relu".to_owned())?;
        if activation != "relu" {
            return Err(settings.value("feedforward_activation", format!("`{activation}`"), "relu"));
        }
        let backbone = settings.take_or("vision_backbone", "resnet18".to_owned())?;
        let backbone = match backbone.as_str() {
            "resnet18" => ResNet::RESNET_18,
            "resnet34" => ResNet::RESNET_34,
            found => {
                return Err(settings.value("vision_backbone", format!("`{found}`"), "resnet18 or resnet34"));
            }
        };
        let normalised =
            || ["VISUAL", "STATE", "ACTION"].map(|kind| (kind.to_owned(), NormalisationMode::MeanStd));
        let chunk = read_chunk(settings, 100)?;
        Ok(Self {
            chunk: read_ensemble(settings, chunk)?,
            input_features: settings.require("input_features", "the inputs of the network by name")?,
            action_dim: read_action_dim(settings)?,
            modes: settings.take_or("normalization_mapping", Modes::from(normalised()))?,
            backbone,
            dim_model: settings.take_or("dim_model", 512)?,
            n_heads: settings.take_or("n_heads", 8)?,
            dim_feedforward: settings.take_or("dim_feedforward", 3200)?,
            n_encoder_layers: settings.take_or("n_encoder_layers", 4)?,
            n_decoder_layers: settings.take_or("n_decoder_layers", 1)?,
        })
    }
}

/// Reads the weight of averaged predictions, which only ACT has.
fn read_ensemble(settings: &mut Settings, chunk: ChunkSettings) -> Result<ChunkSettings, CheckpointError> {
    let ensemble_decay = settings.take::<f64>("temporal_ensemble_coeff")?;
    if let (Some(_), Some(execute @ 2..)) = (ensemble_decay, chunk.execute) {
        let expected = "1, because `temporal_ensemble_coeff` queries at every step";
        return Err(settings.value("n_action_steps", execute, expected));
    }
    Ok(ChunkSettings { ensemble_decay, ..chunk })
}

/// Reads the number of entries of an action.
fn read_action_dim(settings: &mut Settings) -> Result<usize, CheckpointError> {
    let outputs: BTreeMap<String, FeatureShape> =
        settings.require("output_features", "the feature `action`")?;
    let action = outputs.get(ACTION).map(|action| &action.shape[..]);
    match action {
        Some(&[dim]) => Ok(dim),
        found => Err(settings.value("output_features.action", format!("{found:?}"), "a shape [dim]")),
    }
}

/// Reads the configuration, the processors and the observation mapping in `folder`. Opens the weights file
/// and stores it in `tensors`.
pub(crate) fn describe(
    folder: &Path,
    mut settings: Settings,
    tensors: &mut Option<TensorFile>,
) -> Result<ActDescription, CheckpointError> {
    let mut notes = Vec::new();
    let mut sidecar = Sidecar::read(folder)?;
    sidecar.refuse_pi05_keys(folder)?;
    let config = LeRobotConfig::read(&mut settings, &mut notes)?;
    let mut inputs = inputs(&config).map_err(|(name, shape)| {
        let key = format!("input_features.{name}");
        settings.value(&key, format!("{shape:?}"), "[dim], or [3, height, width] for an image")
    })?;
    if inputs.is_empty() {
        return Err(settings.value("input_features", "empty", "at least one input"));
    }
    let of_kind = |kind: FeatureKind| inputs.iter().filter(move |input| input.kind == kind);
    for kind in [FeatureKind::State, FeatureKind::Env] {
        if of_kind(kind).count() > 1 {
            let found = format!("{} features of type {kind:?}", of_kind(kind).count());
            return Err(settings.value("input_features", found, "at most one"));
        }
    }
    let processors = Processors::of_act(folder, &sidecar.ignore, &mut notes)?;
    if let Some(processors) = &processors {
        rename(&mut inputs, &processors.renames, &folder.join(PREPROCESSOR))?;
    }
    settings.finish(&sidecar.ignore, &mut notes)?;
    sidecar.ignore.finish(folder)?;
    let tensors = tensors.insert(TensorFile::open(&folder.join(MODEL_FILE))?);
    let mut architecture = architecture(&config, &inputs);
    // The backbone name determines the depth, its first tensor the width.
    if let Some(&[width, ..]) = tensors.shape("model.backbone.conv1.weight") {
        architecture.backbone.width = width;
    }
    let processors = processors.map(|Processors { inputs, outputs, .. }| [inputs, outputs]);
    let [mut before, after] = Normaliser::of_act(folder, processors, &config.modes, tensors)?;
    let kinds: Vec<_> = inputs.iter().map(|input| input.kind).collect();
    before.note_differences(&config.modes, &kinds, &mut notes);
    after.note_differences(&config.modes, &[FeatureKind::Action], &mut notes);
    find_encoder(folder, &inputs, &mut before, &mut sidecar, &mut notes)?;
    Ok(ActDescription {
        architecture,
        normalisation: normalisation(before, after, &inputs, config.action_dim)?,
        names: TensorNames { prefixes: &PREFIXES, unused: UNUSED.map(str::to_owned).into() },
        mapping: map_features(&inputs, config.action_dim, &sidecar),
        language: sidecar.language,
        chunk: config.chunk,
        notes,
    })
}

/// Takes the encoder of the environment state from the statistics, where `hypogeum demos` records it, unless
/// the mapping file names one.
fn find_encoder(
    folder: &Path,
    inputs: &[InputFeature],
    statistics: &mut Normaliser,
    sidecar: &mut Sidecar,
    notes: &mut Vec<String>,
) -> Result<(), CheckpointError> {
    let Some(input) = inputs.iter().find(|input| input.kind == FeatureKind::Env) else {
        return refuse_if(
            sidecar.language.is_some(),
            folder,
            "language",
            "a network with an environment state",
        );
    };
    if sidecar.language.is_none() && statistics.records_hashed_embedding(&input.name)? {
        sidecar.language = Some(LanguageConfig::Hashed { dim: input.shape[0] });
        notes.push(format!(
            "`{}` is the hashed embedding of the instruction, as its training data recorded",
            input.name
        ));
    }
    Ok(())
}

fn architecture(config: &LeRobotConfig, inputs: &[InputFeature]) -> Architecture {
    let of_kind = |kind: FeatureKind| inputs.iter().filter(move |input| input.kind == kind);
    let dim = |kind: FeatureKind| of_kind(kind).next().map(|input| input.shape[0]);
    Architecture {
        cameras: inputs.iter().filter_map(InputFeature::image_size).collect(),
        state_dim: dim(FeatureKind::State),
        instruction: dim(FeatureKind::Env)
            .map(|dim| InstructionInput { dim, projection: TokenProjection::Linear }),
        action_dim: config.action_dim,
        horizon: config.chunk.horizon,
        hidden_dim: config.dim_model,
        dim_feedforward: config.dim_feedforward,
        n_heads: config.n_heads,
        enc_layers: config.n_encoder_layers,
        dec_layers: config.n_decoder_layers,
        backbone: config.backbone,
    }
}

fn normalisation(
    mut before: Normaliser,
    mut after: Normaliser,
    inputs: &[InputFeature],
    action_dim: usize,
) -> Result<Normalisation, CheckpointError> {
    let mut normalisation = Normalisation::default();
    for input in inputs {
        let dim = if input.kind == FeatureKind::Visual { 3 } else { input.shape[0] };
        let shift_scale = before.input(&input.name, input.kind, dim)?;
        match input.kind {
            FeatureKind::Visual => normalisation.images.push(shift_scale),
            FeatureKind::State => normalisation.state = shift_scale,
            FeatureKind::Env => normalisation.instruction = shift_scale,
            FeatureKind::Action => {}
        }
    }
    normalisation.action = after.action(action_dim)?;
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
        inputs.push(InputFeature::new(name.clone(), shape.clone(), *kind));
    }
    inputs.sort_by_key(|input| input.kind);
    Ok(inputs)
}
