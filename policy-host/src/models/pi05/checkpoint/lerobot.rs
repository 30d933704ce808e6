//! LeRobot's configuration of a π0.5 checkpoint.

use std::path::PathBuf;

use run_config::input;
use serde_json::{Map, Value};

use super::description::{Folder, Pi05Description};
use crate::formats::CheckpointError;
use crate::formats::files::{MAPPING_FILE, POSTPROCESSOR, PREPROCESSOR};
use crate::formats::lerobot::feature::{FeatureKind, FeatureShape, InputFeature, rename};
use crate::formats::lerobot::processor::{Processors, TokenizerSettings};
use crate::formats::lerobot::statistics::{ACTION, Modes, NormalisationMode, Normaliser};
use crate::formats::lerobot::{read_base, read_chunk};
use crate::formats::mapping::{PromptState, refuse_if};
use crate::formats::settings::{Features, IgnoreList, Settings, parse};
use crate::models::pi05::architecture::{MAX_STEPS, Pi05Architecture};
use crate::models::pi05::image::{BLACK, BLACK_SCALED_TWICE};
use crate::policy::execution::ChunkSettings;

/// Upper bound on the rows of a chunk and on the entries of a state.
pub(crate) const MAX_ROWS: usize = 1024;
/// Upper bound on the tokens of a prompt.
const MAX_PROMPT: usize = 4096;
/// Prefix of LeRobot's names for cameras that a configuration adds.
const EMPTY_CAMERA: &str = "observation.images.empty_camera_";
/// File in which `lerobot-train` stores its configuration beside the policy's.
const TRAINING: &str = "train_config.json";
/// A key that it has since LeRobot 0.5.
const SINCE_0_5: &str = "cudnn_deterministic";
/// LeRobot's name of PaliGemma's vocabulary.
const PALIGEMMA: &str = "google/paligemma-3b-pt-224";
/// Name of the state feature.
const STATE: &str = "observation.state";
/// Note about relative actions, which LeRobot executes in another way.
const RELATIVE_NOTE: &str = "relative actions are added to the state of their query, as in training; lerobot-eval adds them to \
                             the state of the control step in which they are executed";
/// Options of real-time chunking, which have no influence while it is switched off.
const RTC_OPTIONS: [&str; 5] =
    ["prefix_attention_schedule", "max_guidance_weight", "execution_horizon", "debug", "debug_maxlen"];
/// Settings of π0.5 that have no influence on actions: those of training and of compilation, those that the
/// tensors determine, and those of options that are refused.
const WITHOUT_INFLUENCE: [&str; 25] = [
    "paligemma_variant",
    "action_expert_variant",
    "time_sampling_beta_alpha",
    "time_sampling_beta_beta",
    "time_sampling_scale",
    "time_sampling_offset",
    "relative_exclude_joints",
    "action_feature_names",
    "rtc_training_max_delay",
    "memory_frames",
    "memory_stride",
    "memory_temporal_attention_every",
    "gradient_checkpointing",
    "compile_model",
    "compile_mode",
    "freeze_vision_encoder",
    "train_expert_only",
    "optimizer_lr",
    "optimizer_betas",
    "optimizer_eps",
    "optimizer_weight_decay",
    "optimizer_grad_clip_norm",
    "scheduler_warmup_steps",
    "scheduler_decay_steps",
    "scheduler_decay_lr",
];

/// The settings of LeRobot's `PI05Config` that inference depends on, with its defaults.
#[derive(Debug)]
pub(crate) struct Pi05Config {
    input_features: Features<FeatureShape>,
    output_features: Features<FeatureShape>,
    modes: Modes,
    chunk: ChunkSettings,
    pub(crate) max_state_dim: usize,
    max_action_dim: usize,
    pub(crate) num_inference_steps: usize,
    pub(crate) min_period: f64,
    pub(crate) max_period: f64,
    image_resolution: (usize, usize),
    empty_cameras: usize,
    pub(crate) tokenizer_max_length: usize,
    /// `true` if the configuration has `use_relative_actions`, as since LeRobot 0.5.1.
    has_relative_actions: bool,
    use_relative_actions: bool,
}

impl Pi05Config {
    /// Reads the settings. Those that are not supported or out of range are refused by name.
    pub(crate) fn read(
        settings: &mut Settings,
        ignore: &IgnoreList,
        notes: &mut Vec<String>,
    ) -> Result<Self, CheckpointError> {
        read_base(settings, notes)?;
        settings.discard(&WITHOUT_INFLUENCE);
        let has_relative_actions = settings.has("use_relative_actions");
        let use_relative_actions = settings.switch("use_relative_actions")?.unwrap_or(false);
        settings.refuse_switch("use_visual_memory", "false: a memory of earlier images is not supported")?;
        settings.refuse_switch(
            "use_proprioceptive_memory",
            "false: a memory of earlier states is not supported",
        )?;
        read_real_time_chunking(settings, ignore, notes)?;
        match settings.take_or("dtype", "float32".to_owned())?.as_str() {
            "float32" => {}
            "bfloat16" => {
                notes.push("computes in f32 from weights as stored, although `dtype` is bfloat16".to_owned());
            }
            found => return Err(settings.value("dtype", format!("`{found}`"), "float32 or bfloat16")),
        }
        let modes = [
            ("VISUAL", NormalisationMode::Identity),
            ("STATE", NormalisationMode::Quantiles),
            ("ACTION", NormalisationMode::Quantiles),
        ];
        let modes = Modes::from(modes.map(|(kind, mode)| (kind.to_owned(), mode)));
        let config = Self {
            chunk: read_chunk(settings, 50)?,
            input_features: settings.take_or("input_features", Features::default())?,
            output_features: settings.take_or("output_features", Features::default())?,
            modes: settings.take_or("normalization_mapping", modes)?,
            max_state_dim: settings.take_or("max_state_dim", 32)?,
            max_action_dim: settings.take_or("max_action_dim", 32)?,
            num_inference_steps: settings.take_or("num_inference_steps", 10)?,
            min_period: settings.take_or("min_period", 4e-3)?,
            max_period: settings.take_or("max_period", 4.0)?,
            image_resolution: settings.take_or("image_resolution", (224, 224))?,
            empty_cameras: settings.take_or("empty_cameras", 0)?,
            tokenizer_max_length: settings.take_or("tokenizer_max_length", 200)?,
            has_relative_actions,
            use_relative_actions,
        };
        let counts = [
            ("chunk_size", config.chunk.horizon, MAX_ROWS),
            ("max_state_dim", config.max_state_dim, MAX_ROWS),
            ("num_inference_steps", config.num_inference_steps, MAX_STEPS as usize),
            ("tokenizer_max_length", config.tokenizer_max_length, MAX_PROMPT),
        ];
        let outside = counts.into_iter().find(|(_, found, limit)| !(1..=*limit).contains(found));
        if let Some((key, found, limit)) = outside {
            return Err(settings.value(key, found, format!("1 to {limit}")));
        }
        let (min, max) = (config.min_period, config.max_period);
        if !(min > 0.0 && max >= min && max.is_finite()) {
            let expected = "positive numbers, the shorter one first";
            return Err(settings.value("min_period, max_period", format!("{min}, {max}"), expected));
        }
        Ok(config)
    }

    /// Adds the features that LeRobot adds when it loads a configuration.
    fn add_implied_features(&mut self) {
        let (height, width) = self.image_resolution;
        for idx in 0..self.empty_cameras {
            let camera = FeatureShape { kind: FeatureKind::Visual, shape: vec![3, height, width] };
            self.input_features.add(format!("{EMPTY_CAMERA}{idx}"), camera);
        }
        let state = FeatureShape { kind: FeatureKind::State, shape: vec![self.max_state_dim] };
        self.input_features.add(STATE.to_owned(), state);
        let action = FeatureShape { kind: FeatureKind::Action, shape: vec![self.max_action_dim] };
        self.output_features.add(ACTION.to_owned(), action);
    }
}

/// Refuses real-time chunking, unless it is switched off.
fn read_real_time_chunking(
    settings: &mut Settings,
    ignore: &IgnoreList,
    notes: &mut Vec<String>,
) -> Result<(), CheckpointError> {
    let Some(mut options) = settings.object("rtc_config", "rtc_config.")? else { return Ok(()) };
    if options.take("enabled")? == Some(false) {
        options.discard(&RTC_OPTIONS);
        return options.finish(ignore, notes);
    }
    Err(settings.value("rtc_config", "set", "null: real-time chunking is not supported"))
}

impl Folder<'_> {
    pub(crate) fn lerobot(&self, mut settings: Settings) -> Result<Pi05Description, CheckpointError> {
        let ignore = &self.sidecar.ignore;
        refuse_if(self.sidecar.chunk_size.is_some(), self.folder, "chunk_size", "openpi's checkpoints only")?;
        let mut notes = Vec::new();
        let mut config = Pi05Config::read(&mut settings, ignore, &mut notes)?;
        settings.finish(ignore, &mut notes)?;
        config.add_implied_features();
        let architecture = self.architecture(config.chunk.horizon)?;
        let action_dim = self.action_dim(&config, &architecture)?;
        let mut features = self.features(config.input_features, config.max_state_dim, &mut notes)?;
        let processors = Processors::of_pi05(self.folder, ignore, &mut notes)?;
        ignore.finish(self.folder)?;
        rename(&mut features, &processors.renames, &self.folder.join(PREPROCESSOR))?;
        let state = features.iter().find(|feature| feature.kind == FeatureKind::State);
        let Some((state, state_dim)) = state.map(|state| (state.name.clone(), state.shape[0])) else {
            return Err(self.value("input_features", "no state", "a feature of type STATE"));
        };
        let relative =
            processors.relative_entries(self.folder, config.use_relative_actions, action_dim, state_dim)?;
        if !relative.is_empty() {
            notes.push(RELATIVE_NOTE.to_owned());
        }
        let prompt_state = self.prompt_state(config.has_relative_actions, &mut notes)?;
        let inputs = processors.inputs;
        let missing = |file| Normaliser::missing_step(self.folder, file, &config.modes);
        let mut inputs = inputs.unwrap_or_else(|| missing(PREPROCESSOR));
        let mut outputs = processors.outputs.unwrap_or_else(|| missing(POSTPROCESSOR));
        let kinds: Vec<_> = features.iter().map(|feature| feature.kind).collect();
        inputs.note_differences(&config.modes, &kinds, &mut notes);
        outputs.note_differences(&config.modes, &[FeatureKind::Action], &mut notes);
        for camera in features.iter().filter(|feature| feature.kind == FeatureKind::Visual) {
            let mode = inputs.mode(&camera.name, camera.kind)?;
            if mode != NormalisationMode::Identity {
                let found = format!("{} for `{}`", mode.name(), camera.name);
                let expected = "IDENTITY, the only normalisation of π0.5's images that is supported; serve the checkpoint \
                                with `python -m hypogeum.lerobot`";
                return Err(self.value("normalization_mapping.VISUAL", found, expected));
            }
        }
        let (tokenizer_folder, max_tokens) =
            self.tokenizer(processors.tokenizer, config.tokenizer_max_length, &mut notes)?;
        Ok(Pi05Description {
            architecture,
            mapping: self.mapping(features, action_dim)?,
            state: inputs.scaling(&state, FeatureKind::State, state_dim)?,
            action: outputs.scaling(ACTION, FeatureKind::Action, action_dim)?,
            action_dim,
            relative,
            prompt_state,
            padding_value: match prompt_state {
                PromptState::Unpadded => BLACK,
                PromptState::Padded => BLACK_SCALED_TWICE,
            },
            max_state_dim: processors.max_state_dim.unwrap_or(config.max_state_dim),
            tokenizer_folder,
            max_tokens,
            n_steps: config.num_inference_steps,
            periods: (config.min_period, config.max_period),
            chunk: config.chunk,
            notes,
        })
    }

    /// Returns the convention of the prompt: the one that the mapping file names, or that of the version of
    /// LeRobot that wrote the folder.
    fn prompt_state(
        &self,
        has_relative_actions: bool,
        notes: &mut Vec<String>,
    ) -> Result<PromptState, CheckpointError> {
        if let Some(prompt_state) = self.sidecar.prompt_state {
            return Ok(prompt_state);
        }
        if has_relative_actions {
            return Ok(PromptState::Unpadded);
        }
        let path = self.folder.join(TRAINING);
        let (prompt_state, evidence) = match input::read(&path) {
            Ok(text) if parse::<Map<String, Value>>(&path, &text)?.contains_key(SINCE_0_5) => {
                (PromptState::Unpadded, format!("LeRobot 0.5, whose {TRAINING} has `{SINCE_0_5}`"))
            }
            Ok(_) => {
                (PromptState::Padded, format!("LeRobot before 0.5, whose {TRAINING} has no `{SINCE_0_5}`"))
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                let evidence = "LeRobot before 0.5.1, whose config.json has no `use_relative_actions`";
                (PromptState::Padded, evidence.to_owned())
            }
            Err(source) => return Err(CheckpointError::Read { path, source }),
        };
        let convention = match prompt_state {
            PromptState::Unpadded => "has one number per entry of the state",
            PromptState::Padded => {
                "has the state padded to `max_state_dim`, and the letterbox padding of images is -3"
            }
        };
        notes.push(format!(
            "was written by {evidence}: its prompt {convention}; `prompt_state` in {MAPPING_FILE} overrides this"
        ));
        Ok(prompt_state)
    }

    /// Checks the sizes in the configuration against those of the weights, and returns the number of entries
    /// of an action.
    fn action_dim(
        &self,
        config: &Pi05Config,
        architecture: &Pi05Architecture,
    ) -> Result<usize, CheckpointError> {
        let side = architecture.image_side();
        if config.image_resolution != (side, side) {
            let found = format!("{:?}", config.image_resolution);
            return Err(self.value(
                "image_resolution",
                found,
                format!("({side}, {side}), as in the weights"),
            ));
        }
        let width = architecture.action_width;
        if config.max_action_dim != width {
            return Err(self.value(
                "max_action_dim",
                config.max_action_dim,
                format!("{width}, as in the weights"),
            ));
        }
        let action = config.output_features.get(ACTION);
        match action.map(|feature| &feature.shape[..]) {
            Some(&[dim]) if (1..=width).contains(&dim) => Ok(dim),
            found => {
                let expected = format!("a shape [dim] of at most {width}");
                Err(self.value("output_features.action", format!("{found:?}"), expected))
            }
        }
    }

    /// Returns the folder of the vocabulary and the maximum number of tokens. Those of the preprocessor's
    /// step win over the configuration.
    fn tokenizer(
        &self,
        step: Option<TokenizerSettings>,
        max_length: usize,
        notes: &mut Vec<String>,
    ) -> Result<(PathBuf, usize), CheckpointError> {
        let here = self.folder.to_owned();
        let Some(TokenizerSettings { name, max_tokens }) = step else { return Ok((here, max_length)) };
        let folder = name.as_ref().map(|name| self.folder.join(name)).filter(|folder| folder.is_dir());
        if let Some(name) = name.filter(|name| name != PALIGEMMA && folder.is_none()) {
            notes.push(format!("reads the vocabulary in its folder, and was trained with `{name}`"));
        }
        let max_tokens = max_tokens.unwrap_or(MAX_PROMPT);
        if max_tokens > MAX_PROMPT {
            let found = max_tokens.to_string();
            return Err(self.value("tokenizer_processor.max_length", found, format!("1 to {MAX_PROMPT}")));
        }
        Ok((folder.unwrap_or(here), max_tokens))
    }

    /// Returns the input features in their order. An environment state is left out, which LeRobot's network
    /// does not read either.
    fn features(
        &self,
        inputs: Features<FeatureShape>,
        max_state_dim: usize,
        notes: &mut Vec<String>,
    ) -> Result<Vec<InputFeature>, CheckpointError> {
        let mut features = Vec::new();
        for (name, FeatureShape { kind, shape }) in inputs.0 {
            let fits = match kind {
                FeatureKind::Visual => matches!(shape[..], [3, _, _]),
                FeatureKind::State => matches!(shape[..], [dim] if dim <= max_state_dim),
                FeatureKind::Env => {
                    notes.push(format!("does not read `{name}`, like LeRobot's π0.5"));
                    continue;
                }
                FeatureKind::Action => false,
            };
            if !fits {
                let expected =
                    format!("an image [3, height, width], or a state of at most {max_state_dim} entries");
                return Err(self.value(
                    &format!("input_features.{name}"),
                    format!("{kind:?} {shape:?}"),
                    expected,
                ));
            }
            features.push(InputFeature::new(name, shape, kind));
        }
        Ok(features)
    }
}
