//! LeRobot's pre- and postprocessor: the steps before and after the network, in the order in which they run.
//!
//! Every step and every key of its configuration is read, has no influence, or is refused by name.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::feature::FeatureShape;
use super::statistics::{DEFAULT_EPSILON, Modes, Normaliser, StatisticsFile};
use crate::formats::error::CheckpointError;
use crate::formats::files::{POSTPROCESSOR, PREPROCESSOR};
use crate::formats::settings::{IgnoreList, Settings};
use crate::weights::TensorFile;

/// Data types to which a processor may cast, because tensors have them here.
const FLOAT_TYPES: [&str; 2] = ["float32", "float"];
/// LeRobot's kinds of features.
const KINDS: [&str; 6] = ["STATE", "VISUAL", "ENV", "ACTION", "REWARD", "LANGUAGE"];
/// Key under which LeRobot's pipelines pass the instruction.
const TASK: &str = "task";

/// A kind of step, by its registered name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StepKind {
    Rename,
    Batch,
    Device,
    Relative,
    Normalise,
    Prompt,
    Tokenize,
    Unnormalise,
    Absolute,
}

/// The steps that a file may have, in the order in which they must come. Those that change no value may be
/// anywhere.
type Allowed = &'static [StepKind];

const PREPROCESSOR_STEPS: Allowed =
    &[StepKind::Rename, StepKind::Normalise, StepKind::Batch, StepKind::Device];
const POSTPROCESSOR_STEPS: Allowed = &[StepKind::Unnormalise, StepKind::Batch, StepKind::Device];
const PI05_PREPROCESSOR_STEPS: Allowed = &[
    StepKind::Rename,
    StepKind::Normalise,
    StepKind::Prompt,
    StepKind::Tokenize,
    StepKind::Relative,
    StepKind::Batch,
    StepKind::Device,
];
const PI05_POSTPROCESSOR_STEPS: Allowed =
    &[StepKind::Unnormalise, StepKind::Absolute, StepKind::Batch, StepKind::Device];

/// Settings of the step that splits a prompt into tokens.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct TokenizerSettings {
    /// Name or subfolder of the vocabulary.
    pub(crate) name: Option<String>,
    /// Maximum number of tokens, if longer prompts are cut off.
    pub(crate) max_tokens: Option<usize>,
}

/// Contents of both files.
#[derive(Debug)]
pub(crate) struct Processors {
    /// New names of the environment's features by their own names.
    pub(crate) renames: BTreeMap<String, String>,
    pub(crate) inputs: Option<Normaliser>,
    pub(crate) outputs: Option<Normaliser>,
    /// Only π0.5 has this step.
    pub(crate) tokenizer: Option<TokenizerSettings>,
    /// Number of entries to which π0.5's step pads the state in the prompt, in versions that do.
    pub(crate) max_state_dim: Option<usize>,
}

/// One step of a file.
struct ProcessorStep {
    kind: StepKind,
    /// Key of the step in messages, for example `steps[3]`.
    key: String,
    config: Settings,
    state_file: Option<String>,
}

/// A processor file.
struct ProcessorFile<'a> {
    folder: &'a Path,
    path: PathBuf,
    ignore: &'a IgnoreList,
    notes: &'a mut Vec<String>,
}

impl StepKind {
    const ALL: [Self; 9] = [
        Self::Rename,
        Self::Batch,
        Self::Device,
        Self::Relative,
        Self::Normalise,
        Self::Prompt,
        Self::Tokenize,
        Self::Unnormalise,
        Self::Absolute,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Rename => "rename_observations_processor",
            Self::Batch => "to_batch_processor",
            Self::Device => "device_processor",
            Self::Relative => "relative_actions_processor",
            Self::Normalise => "normalizer_processor",
            Self::Prompt => "pi05_prepare_state_tokenizer_processor_step",
            Self::Tokenize => "tokenizer_processor",
            Self::Unnormalise => "unnormalizer_processor",
            Self::Absolute => "absolute_actions_processor",
        }
    }

    /// Returns `true` for a step without which a network has no input.
    fn is_required(self) -> bool {
        matches!(self, Self::Prompt | Self::Tokenize)
    }

    /// Returns `true` for a step that changes no value, as far as it is supported.
    fn is_free(self) -> bool {
        matches!(self, Self::Batch | Self::Device | Self::Relative | Self::Absolute)
    }
}

impl Processors {
    /// Reads ACT's files in `folder`, or returns `None` if there is no preprocessor.
    pub(crate) fn of_act(
        folder: &Path,
        ignore: &IgnoreList,
        notes: &mut Vec<String>,
    ) -> Result<Option<Self>, CheckpointError> {
        if !folder.join(PREPROCESSOR).is_file() && !folder.join(POSTPROCESSOR).is_file() {
            return Ok(None);
        }
        Self::read(folder, [PREPROCESSOR_STEPS, POSTPROCESSOR_STEPS], ignore, notes).map(Some)
    }

    /// Reads π0.5's files in `folder`.
    pub(crate) fn of_pi05(
        folder: &Path,
        ignore: &IgnoreList,
        notes: &mut Vec<String>,
    ) -> Result<Self, CheckpointError> {
        Self::read(folder, [PI05_PREPROCESSOR_STEPS, PI05_POSTPROCESSOR_STEPS], ignore, notes)
    }

    fn read(
        folder: &Path,
        [before, after]: [Allowed; 2],
        ignore: &IgnoreList,
        notes: &mut Vec<String>,
    ) -> Result<Self, CheckpointError> {
        let mut processors = Self {
            renames: BTreeMap::new(),
            inputs: None,
            outputs: None,
            tokenizer: None,
            max_state_dim: None,
        };
        for (name, allowed) in [(PREPROCESSOR, before), (POSTPROCESSOR, after)] {
            let mut file = ProcessorFile { folder, path: folder.join(name), ignore, notes };
            for step in file.steps(allowed)? {
                file.apply(step, &mut processors)?;
            }
        }
        Ok(processors)
    }
}

impl ProcessorFile<'_> {
    /// Reads the steps and checks their order.
    fn steps(&mut self, allowed: Allowed) -> Result<Vec<ProcessorStep>, CheckpointError> {
        let mut file = Settings::read(&self.path)?;
        file.discard(&["name"]);
        let mut steps: Vec<ProcessorStep> = Vec::new();
        for (idx, entry) in file.objects("steps")?.into_iter().enumerate() {
            let step = self.step(format!("steps[{idx}]"), entry, allowed)?;
            let rank = |kind: StepKind| allowed.iter().position(|allowed| *allowed == kind);
            let earlier = steps.iter().filter(|earlier| !earlier.kind.is_free() && !step.kind.is_free());
            if let Some(earlier) = earlier.max_by_key(|earlier| rank(earlier.kind))
                && rank(earlier.kind) >= rank(step.kind)
            {
                let found = format!("`{}` after `{}`", step.kind.name(), earlier.kind.name());
                let order: Vec<_> =
                    allowed.iter().filter(|kind| !kind.is_free()).map(|kind| kind.name()).collect();
                let expected = format!("each at most once, in the order {}", order.join(", "));
                return Err(file.value(&step.key, found, expected));
            }
            steps.push(step);
        }
        let is_absent = |kind: &&StepKind| kind.is_required() && steps.iter().all(|step| step.kind != **kind);
        if let Some(absent) = allowed.iter().find(is_absent) {
            let found = format!("a list without `{}`", absent.name());
            return Err(file.value("steps", found, "the steps that write π0.5's prompt"));
        }
        file.finish(self.ignore, self.notes)?;
        Ok(steps)
    }

    fn step(
        &mut self,
        key: String,
        mut entry: Settings,
        allowed: Allowed,
    ) -> Result<ProcessorStep, CheckpointError> {
        let class: Option<String> = entry.take("class")?;
        let name: Option<String> = entry.take("registry_name")?;
        let name = name.or(class).unwrap_or_default();
        let known = allowed.iter().copied().find(|kind| kind.name() == name);
        let Some(kind) = known else {
            let names: Vec<_> =
                StepKind::ALL.iter().filter(|kind| allowed.contains(kind)).map(|kind| kind.name()).collect();
            let expected = format!(
                "one of {}. Serve the checkpoint with `python -m hypogeum.lerobot`, which runs LeRobot's own steps",
                names.join(", ")
            );
            return Err(CheckpointError::Value {
                path: self.path.clone(),
                key,
                found: format!("`{name}`"),
                expected,
            });
        };
        let scope = format!("{}.", kind.name());
        let empty = || Settings::parse(&self.path, b"{}");
        let config = entry.object("config", &scope)?.map_or_else(empty, Ok)?;
        let state_file = entry.take("state_file")?;
        // Files that the configuration names as well.
        entry.discard(&["artifacts"]);
        entry.finish(self.ignore, self.notes)?;
        Ok(ProcessorStep { kind, key, config, state_file })
    }

    /// Reads the configuration of a step.
    fn apply(&mut self, step: ProcessorStep, processors: &mut Processors) -> Result<(), CheckpointError> {
        let ProcessorStep { kind, key: _, mut config, state_file } = step;
        match kind {
            StepKind::Batch => {}
            StepKind::Rename => processors.renames = config.take_or("rename_map", BTreeMap::new())?,
            StepKind::Device => {
                let found: Option<String> = config.take("float_dtype")?;
                if let Some(found) = found.filter(|found| !FLOAT_TYPES.contains(&found.as_str())) {
                    let expected = "float32, in which networks compute here";
                    return Err(config.value("float_dtype", format!("`{found}`"), expected));
                }
                config.discard(&["device"]);
            }
            StepKind::Relative | StepKind::Absolute => {
                config.refuse_switch(
                    "enabled",
                    "false: relative actions are not supported; serve the checkpoint with `python -m hypogeum.lerobot`",
                )?;
                config.discard(&["exclude_joints", "action_names"]);
            }
            StepKind::Normalise => {
                processors.inputs = Some(self.normaliser(kind, &mut config, state_file)?);
            }
            StepKind::Unnormalise => {
                processors.outputs = Some(self.normaliser(kind, &mut config, state_file)?);
            }
            StepKind::Prompt => {
                processors.max_state_dim = config.take("max_state_dim")?;
                expect_task(&mut config)?;
                if config.take("include_state_in_prompt")? == Some(false) {
                    let expected = "true: a prompt without the state is not supported";
                    return Err(config.value("include_state_in_prompt", "false", expected));
                }
            }
            StepKind::Tokenize => processors.tokenizer = Some(tokenizer(&mut config)?),
        }
        config.finish(self.ignore, self.notes)
    }

    fn normaliser(
        &self,
        kind: StepKind,
        config: &mut Settings,
        state_file: Option<String>,
    ) -> Result<Normaliser, CheckpointError> {
        let features: BTreeMap<String, FeatureShape> = config.require("features", "the features by name")?;
        let modes: Modes = config.require("norm_map", "a mode for each kind of feature")?;
        if let Some(unknown) = modes.keys().find(|kind| !KINDS.contains(&kind.as_str())) {
            return Err(config.value(
                "norm_map",
                format!("`{unknown}`"),
                format!("one of {}", KINDS.join(", ")),
            ));
        }
        let file = match state_file {
            Some(name) if Path::new(&name).components().count() == 1 => {
                StatisticsFile::Own(TensorFile::open(&self.folder.join(name))?)
            }
            Some(name) => {
                return Err(config.value(
                    "state_file",
                    format!("`{name}`"),
                    "the name of a file in the folder",
                ));
            }
            None => StatisticsFile::Absent,
        };
        Ok(Normaliser {
            path: self.path.clone(),
            step: kind.name(),
            modes,
            kinds: Some(features.into_iter().map(|(name, feature)| (name, feature.kind)).collect()),
            only: config.take::<BTreeSet<String>>("normalize_observation_keys")?,
            epsilon: config.take_or("eps", DEFAULT_EPSILON)?,
            file,
        })
    }
}

/// Reads the configuration of the step that splits prompts into tokens. Padding is masked, so that its side
/// and its length do not matter.
fn tokenizer(config: &mut Settings) -> Result<TokenizerSettings, CheckpointError> {
    /// Default of LeRobot's `max_length`.
    const MAX_LENGTH: usize = 512;
    expect_task(config)?;
    config.discard(&["padding", "padding_side"]);
    let name = config.take("tokenizer_name")?;
    let max_length = config.take_or("max_length", MAX_LENGTH)?;
    if max_length == 0 {
        return Err(config.value("max_length", 0, "at least 1"));
    }
    let truncates = config.take_or("truncation", true)?;
    Ok(TokenizerSettings { name, max_tokens: truncates.then_some(max_length) })
}

fn expect_task(config: &mut Settings) -> Result<(), CheckpointError> {
    match config.take::<String>("task_key")? {
        Some(found) if found != TASK => Err(config.value(
            "task_key",
            format!("`{found}`"),
            format!("`{TASK}`, the episode's instruction"),
        )),
        _ => Ok(()),
    }
}
