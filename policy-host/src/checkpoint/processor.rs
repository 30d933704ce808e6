//! LeRobot's normalisation statistics, in the locations that its versions use.

use std::collections::BTreeMap;
use std::path::Path;

use ipc_types::input;
use serde::Deserialize;

use super::mapping::FeatureKind;
use super::{CheckpointError, parse};
use crate::act::normalise::ShiftScale;
use crate::pi05::scaling::Scaling;
use crate::weights::TensorFile;

/// File name of the preprocessor, written since LeRobot 0.4.
const PREPROCESSOR: &str = "policy_preprocessor.json";
/// File name of the postprocessor, written since LeRobot 0.4.
const POSTPROCESSOR: &str = "policy_postprocessor.json";
/// Processor steps with no effect here: images and states are batched, on the CPU and correctly named
/// already.
const NO_OP_STEPS: [&str; 3] = ["rename_observations_processor", "to_batch_processor", "device_processor"];
/// Further steps of π0.5. The policy itself writes and splits the prompt, and its loader rejects relative
/// actions.
const PI05_STEPS: [&str; 4] = [
    "relative_actions_processor",
    "pi05_prepare_state_tokenizer_processor_step",
    "tokenizer_processor",
    "absolute_actions_processor",
];
/// Preprocessor step that normalises inputs.
const NORMALISER: &str = "normalizer_processor";
/// Postprocessor step that restores actions.
const UNNORMALISER: &str = "unnormalizer_processor";
/// Default of LeRobot's `eps`, which it adds to a standard deviation and substitutes for a zero range.
const DEFAULT_EPSILON: f32 = 1e-8;

/// Normalisation of one kind of feature, under LeRobot's names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub(super) enum NormalisationMode {
    Identity,
    MeanStd,
    MinMax,
    Quantiles,
    Quantile10,
}

/// Contents of a processor file.
#[derive(Debug, Deserialize)]
struct Processor {
    steps: Vec<ProcessorStep>,
}

#[derive(Debug, Deserialize)]
struct ProcessorStep {
    registry_name: Option<String>,
    #[serde(default)]
    config: StepConfig,
    state_file: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct StepConfig {
    eps: Option<f32>,
    norm_map: BTreeMap<String, NormalisationMode>,
}

/// Location of a feature's statistics.
struct StatisticsSource<'a> {
    file: &'a mut TensorFile,
    /// Prefix of the tensor names: `<feature>.` in a processor's own file; `<direction>.buffer_<feature>.`,
    /// with dots replaced by underscores, among the weights of an older checkpoint.
    prefix: String,
}

/// Statistics of one direction: network inputs, or actions back to the robot.
struct ProcessorStatistics {
    modes: BTreeMap<String, NormalisationMode>,
    epsilon: f32,
    /// The processor's state file, or `None` if the statistics are among the weights or nothing is
    /// normalised.
    file: Option<TensorFile>,
}

/// All statistics of a checkpoint.
pub(super) struct Statistics<'a> {
    inputs: ProcessorStatistics,
    outputs: ProcessorStatistics,
    weights: &'a mut TensorFile,
}

impl<'a> Statistics<'a> {
    /// Locates the statistics: in `folder`, or among the `weights` of an older checkpoint, whose
    /// configuration specifies the `modes`.
    pub(super) fn find(
        folder: &Path,
        modes: &BTreeMap<String, NormalisationMode>,
        weights: &'a mut TensorFile,
    ) -> Result<Self, CheckpointError> {
        let (inputs, outputs) = if folder.join(PREPROCESSOR).is_file() {
            (
                ProcessorStatistics::read(folder, PREPROCESSOR, NORMALISER, &[])?,
                ProcessorStatistics::read(folder, POSTPROCESSOR, UNNORMALISER, &[])?,
            )
        } else {
            let older = || ProcessorStatistics { modes: modes.clone(), epsilon: DEFAULT_EPSILON, file: None };
            (older(), older())
        };
        Ok(Self { inputs, outputs, weights })
    }

    /// Returns the normalisation of an input with `dim` entries (channels for an image).
    pub(super) fn input(
        &mut self,
        name: &str,
        kind: FeatureKind,
        dim: usize,
    ) -> Result<Option<ShiftScale>, CheckpointError> {
        let mode = self.inputs.mode(kind);
        let epsilon = self.inputs.epsilon;
        let source = self.inputs.source(self.weights, "normalize_inputs", name);
        shift_scale(source, mode, dim, epsilon, |std| std + epsilon)
    }

    /// Returns the normalisation of actions, which the policy applies in reverse.
    pub(super) fn action(&mut self, name: &str, dim: usize) -> Result<Option<ShiftScale>, CheckpointError> {
        let mode = self.outputs.mode(FeatureKind::Action);
        let epsilon = self.outputs.epsilon;
        shift_scale(
            self.outputs.source(self.weights, "unnormalize_outputs", name),
            mode,
            dim,
            epsilon,
            |std| std,
        )
    }
}

impl ProcessorStatistics {
    /// Reads a processor file. Steps other than the normaliser, [`NO_OP_STEPS`] and `others` are errors.
    fn read(folder: &Path, file: &str, normaliser: &str, others: &[&str]) -> Result<Self, CheckpointError> {
        let path = folder.join(file);
        let text =
            input::read(&path).map_err(|source| CheckpointError::Read { path: path.clone(), source })?;
        let processor: Processor = parse(&path, &text)?;
        let mut found = Self { modes: BTreeMap::new(), epsilon: DEFAULT_EPSILON, file: None };
        for (idx, step) in processor.steps.into_iter().enumerate() {
            let name = step.registry_name.unwrap_or_else(|| "an unregistered class".to_owned());
            if name == normaliser {
                let state = step.state_file.map(|state| TensorFile::open(&folder.join(state))).transpose()?;
                let epsilon = step.config.eps.unwrap_or(DEFAULT_EPSILON);
                found = Self { modes: step.config.norm_map, epsilon, file: state };
            } else if !NO_OP_STEPS.contains(&name.as_str()) && !others.contains(&name.as_str()) {
                return Err(CheckpointError::Value {
                    path,
                    key: format!("steps[{idx}]"),
                    found: format!("`{name}`"),
                    expected: format!(
                        "`{normaliser}` or one of {}",
                        [&NO_OP_STEPS, others].concat().join(", ")
                    ),
                });
            }
        }
        // A processor without statistics leaves every feature unchanged.
        if found.file.is_none() {
            found.modes.clear();
        }
        Ok(found)
    }

    fn mode(&self, kind: FeatureKind) -> NormalisationMode {
        let name = match kind {
            FeatureKind::Visual => "VISUAL",
            FeatureKind::State => "STATE",
            FeatureKind::Env => "ENV",
            FeatureKind::Action => "ACTION",
        };
        self.modes.get(name).copied().unwrap_or(NormalisationMode::Identity)
    }

    /// Returns the scaling of a feature with `dim` entries, from the processor's own file.
    fn scaling(&mut self, kind: FeatureKind, name: &str, dim: usize) -> Result<Scaling, CheckpointError> {
        let (mode, epsilon) = (self.mode(kind), self.epsilon);
        let prefix = format!("{name}.");
        let file =
            self.file.as_mut().filter(|file| file.names().iter().any(|name| name.starts_with(&prefix)));
        let Some(file) = file else { return Ok(Scaling::Identity) };
        let mut source = StatisticsSource { file, prefix };
        let mut range = |low: &str, high: &str| -> Result<Scaling, CheckpointError> {
            let (low, high) = (source.read(low, dim)?, source.read(high, dim)?);
            let width = |(low, high): (&f32, f32)| if high == *low { epsilon } else { high - low };
            Ok(Scaling::Range { width: low.iter().zip(high).map(width).collect(), low })
        };
        match mode {
            NormalisationMode::Identity => Ok(Scaling::Identity),
            NormalisationMode::MinMax => range("min", "max"),
            NormalisationMode::Quantiles => range("q01", "q99"),
            NormalisationMode::Quantile10 => range("q10", "q90"),
            NormalisationMode::MeanStd => {
                let (mean, std) = (source.read("mean", dim)?, source.read("std", dim)?);
                Ok(Scaling::MeanStd { mean, std, epsilon })
            }
        }
    }

    /// Returns the location of a feature's statistics, or `None` if the processor leaves the feature
    /// unchanged.
    fn source<'a>(
        &'a mut self,
        weights: &'a mut TensorFile,
        direction: &str,
        feature: &str,
    ) -> Option<StatisticsSource<'a>> {
        match &mut self.file {
            Some(file) => {
                let prefix = format!("{feature}.");
                file.names()
                    .iter()
                    .any(|name| name.starts_with(&prefix))
                    .then_some(StatisticsSource { file, prefix })
            }
            None => {
                let prefix = format!("{direction}.buffer_{}.", feature.replace('.', "_"));
                Some(StatisticsSource { file: weights, prefix })
            }
        }
    }
}

/// Reads the scaling of a π0.5 checkpoint's state and actions from its processor files.
///
/// # Errors
/// If a file or statistic is missing or invalid.
pub(super) fn pi05_scaling(
    folder: &Path,
    (state, state_dim): (&str, usize),
    (action, action_dim): (&str, usize),
) -> Result<(Scaling, Scaling), CheckpointError> {
    let mut inputs = ProcessorStatistics::read(folder, PREPROCESSOR, NORMALISER, &PI05_STEPS)?;
    let mut outputs = ProcessorStatistics::read(folder, POSTPROCESSOR, UNNORMALISER, &PI05_STEPS)?;
    Ok((
        inputs.scaling(FeatureKind::State, state, state_dim)?,
        outputs.scaling(FeatureKind::Action, action, action_dim)?,
    ))
}

/// Computes the shift and scale of `dim` entries. `scale_of` maps a standard deviation to its scale.
fn shift_scale(
    source: Option<StatisticsSource<'_>>,
    mode: NormalisationMode,
    dim: usize,
    epsilon: f32,
    scale_of: impl Fn(f32) -> f32,
) -> Result<Option<ShiftScale>, CheckpointError> {
    let Some(mut source) = source else { return Ok(None) };
    let mut between = |low: &str, high: &str| {
        let (low, high) = (source.read(low, dim)?, source.read(high, dim)?);
        let half_range = |low: f32, high: f32| if high == low { 0.5 * epsilon } else { 0.5 * (high - low) };
        let scale: Vec<f32> = low.iter().zip(&high).map(|(&low, &high)| half_range(low, high)).collect();
        let shift = low.iter().zip(&scale).map(|(low, half)| low + half).collect();
        Ok(Some(ShiftScale { shift, scale }))
    };
    match mode {
        NormalisationMode::Identity => Ok(None),
        NormalisationMode::MinMax => between("min", "max"),
        NormalisationMode::Quantiles => between("q01", "q99"),
        NormalisationMode::Quantile10 => between("q10", "q90"),
        NormalisationMode::MeanStd => {
            let shift = source.read("mean", dim)?;
            let scale = source.read("std", dim)?.into_iter().map(scale_of).collect();
            Ok(Some(ShiftScale { shift, scale }))
        }
    }
}

impl StatisticsSource<'_> {
    /// Reads one statistic of shape `[dim]`, or `[dim, 1, 1]` for the channels of an image.
    fn read(&mut self, statistic: &str, dim: usize) -> Result<Vec<f32>, CheckpointError> {
        let name = format!("{}{statistic}", self.prefix);
        let per_channel = self.file.shape(&name) == Some(&[dim, 1, 1]);
        let shape: &[usize] = if per_channel { &[dim, 1, 1] } else { &[dim] };
        self.file.check(&name, shape)?;
        let values = self.file.read(&name)?;
        match values.iter().find(|x| !x.is_finite()) {
            None => Ok(values),
            Some(x) => Err(CheckpointError::Value {
                path: self.file.path().to_owned(),
                key: name,
                found: x.to_string(),
                expected: "a finite value; the checkpoint was saved without dataset statistics".to_owned(),
            }),
        }
    }
}
