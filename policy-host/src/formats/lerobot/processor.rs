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
use crate::weights::{CONFIG_FILE, TensorFile};

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

/// The step that makes actions relative to the state in training.
#[derive(Debug)]
struct RelativeActions {
    is_enabled: bool,
    /// Parts of the names of entries that stay absolute.
    exclude: Vec<String>,
    /// Names of the action's entries. Without them, all entries are relative.
    names: Option<Vec<String>>,
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
    /// The step that makes actions relative to the state in training, switched on or off.
    relative: Option<RelativeActions>,
    /// `true` if the step that adds the state to actions is switched on.
    is_absolute: bool,
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
            relative: None,
            is_absolute: false,
        };
        for (name, allowed) in [(PREPROCESSOR, before), (POSTPROCESSOR, after)] {
            let mut file = ProcessorFile { folder, path: folder.join(name), ignore, notes };
            for step in file.steps(allowed)? {
                file.apply(step, &mut processors)?;
            }
        }
        Ok(processors)
    }

    /// Returns which entries of an action are relative to those of the state with the same index, or an empty
    /// vector if none is. The steps of both files and the configuration must agree.
    pub(crate) fn relative_entries(
        &self,
        folder: &Path,
        is_configured: bool,
        action_dim: usize,
        state_dim: usize,
    ) -> Result<Vec<bool>, CheckpointError> {
        let mismatch = |file: &str, key: &str, found: String, expected: &str| CheckpointError::Value {
            path: folder.join(file),
            key: key.to_owned(),
            found,
            expected: expected.to_owned(),
        };
        let enabled = |kind: StepKind| format!("{}.enabled", kind.name());
        let relative = self.relative.as_ref().filter(|step| step.is_enabled);
        if relative.is_some() != self.is_absolute {
            let other = format!("{} is {}", enabled(StepKind::Relative), relative.is_some());
            let found = format!("{}, while {other}", self.is_absolute);
            let expected =
                "the same value in both: actions that are relative in training become absolute in a run";
            return Err(mismatch(POSTPROCESSOR, &enabled(StepKind::Absolute), found, expected));
        }
        if is_configured != self.is_absolute {
            let found =
                format!("{is_configured}, while {} is {}", enabled(StepKind::Absolute), self.is_absolute);
            return Err(mismatch(CONFIG_FILE, "use_relative_actions", found, "the same value in both"));
        }
        let Some(relative) = relative else { return Ok(Vec::new()) };
        if state_dim < action_dim {
            let expected =
                format!("at least {action_dim}, because every entry of an action is relative to one of them");
            let found = format!("{state_dim} entries");
            return Err(mismatch(CONFIG_FILE, "input_features.observation.state", found, &expected));
        }
        Ok(relative.entries(action_dim))
    }
}

impl RelativeActions {
    fn read(config: &mut Settings) -> Result<Self, CheckpointError> {
        Ok(Self {
            is_enabled: config.switch("enabled")?.unwrap_or(false),
            exclude: config.take_or("exclude_joints", Vec::new())?,
            names: config.take("action_names")?,
        })
    }

    /// Returns which entries of an action are relative: those whose name contains no excluded one. Case does
    /// not matter.
    fn entries(&self, action_dim: usize) -> Vec<bool> {
        let exclude: Vec<_> =
            self.exclude.iter().filter(|name| !name.is_empty()).map(|name| name.to_lowercase()).collect();
        let is_relative = |name: &String| {
            let name = name.to_lowercase();
            !exclude.iter().any(|excluded| name.contains(excluded))
        };
        let mut entries: Vec<_> = self.names.iter().flatten().take(action_dim).map(is_relative).collect();
        entries.resize(action_dim, true);
        entries
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
            StepKind::Relative => processors.relative = Some(RelativeActions::read(&mut config)?),
            StepKind::Absolute => {
                processors.is_absolute = config.switch("enabled")?.unwrap_or(false);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn narrow_state_cannot_carry_relative_actions() {
        let step = RelativeActions { is_enabled: true, exclude: vec!["gripper".to_owned()], names: None };
        let processors = Processors {
            renames: BTreeMap::new(),
            inputs: None,
            outputs: None,
            tokenizer: None,
            max_state_dim: None,
            relative: Some(step),
            is_absolute: true,
        };
        let entries = |state_dim| processors.relative_entries(Path::new("folder"), true, 7, state_dim);
        assert_eq!(entries(7).unwrap(), [true; 7]);
        let error = entries(6).unwrap_err().to_string();
        for words in ["folder/config.json", "observation.state", "6 entries", "at least 7"] {
            assert!(error.contains(words), "{error}");
        }
    }
}
