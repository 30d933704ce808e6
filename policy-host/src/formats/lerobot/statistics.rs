//! Normalisation statistics of a LeRobot checkpoint: in the files of its processors, or among the weights of
//! an older one. Where a feature is to be normalised, its statistics must be there.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::feature::FeatureKind;
use crate::formats::error::CheckpointError;
use crate::formats::files::{POSTPROCESSOR, PREPROCESSOR};
use crate::formats::scaling::{Scaling, ShiftScale};
use crate::text::hashed;
use crate::weights::{CONFIG_FILE, TensorFile};

/// Number of tensors that an error lists.
const MAX_LISTED: usize = 12;
/// Default of LeRobot's `eps`, which it adds to a standard deviation and substitutes for a zero range.
pub(crate) const DEFAULT_EPSILON: f32 = 1e-8;
/// Name of the action feature, which is normalised by that name.
pub(crate) const ACTION: &str = "action";

/// Normalisation of one kind of feature, under LeRobot's names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub(crate) enum NormalisationMode {
    Identity,
    MeanStd,
    MinMax,
    Quantiles,
    Quantile10,
}

/// Normalisation by kind of feature.
pub(crate) type Modes = BTreeMap<String, NormalisationMode>;

/// Normalisation of one direction: network inputs, or actions back to the robot.
#[derive(Debug)]
pub(crate) struct Normaliser {
    /// File whose settings these are.
    pub(crate) path: PathBuf,
    /// Name of the step in that file.
    pub(crate) step: &'static str,
    pub(crate) modes: Modes,
    /// Kinds of the features that the step knows; `None` if all are known.
    pub(crate) kinds: Option<BTreeMap<String, FeatureKind>>,
    /// Features to which the step is restricted, if it is.
    pub(crate) only: Option<BTreeSet<String>>,
    pub(crate) epsilon: f32,
    pub(crate) file: StatisticsFile,
}

/// Location of statistics.
#[derive(Debug)]
pub(crate) enum StatisticsFile {
    /// The step names no file.
    Absent,
    /// The step's own file, with names `<feature>.<statistic>`.
    Own(TensorFile),
    /// The weights of an older checkpoint, with names `<prefix>.buffer_<feature>.<statistic>`, in which dots
    /// of the feature's name are underscores.
    Weights(TensorFile, &'static str),
}

/// The statistics that a mode needs: its two tensors.
#[derive(Clone, Debug)]
enum Statistics {
    MeanStd(Vec<f32>, Vec<f32>),
    Range(Vec<f32>, Vec<f32>),
}

impl Normaliser {
    /// Returns the normalisations of inputs and of actions: those of the processors, which may lack one, or
    /// without processors those of `modes`, with statistics among the `weights`.
    pub(crate) fn of_act(
        folder: &Path,
        processors: Option<[Option<Self>; 2]>,
        modes: &Modes,
        weights: &TensorFile,
    ) -> Result<[Self; 2], CheckpointError> {
        if let Some([inputs, outputs]) = processors {
            let inputs = inputs.unwrap_or_else(|| Self::missing_step(folder, PREPROCESSOR, modes));
            let outputs = outputs.unwrap_or_else(|| Self::missing_step(folder, POSTPROCESSOR, modes));
            return Ok([inputs, outputs]);
        }
        let among_weights = |prefix| -> Result<Self, CheckpointError> {
            Ok(Self {
                path: folder.join(CONFIG_FILE),
                step: "normalization_mapping",
                modes: modes.clone(),
                kinds: None,
                only: None,
                epsilon: DEFAULT_EPSILON,
                file: StatisticsFile::Weights(TensorFile::open(weights.path())?, prefix),
            })
        };
        Ok([among_weights("normalize_inputs")?, among_weights("unnormalize_outputs")?])
    }

    /// Returns the normalisation of a processor without that step: `modes` must be identities.
    pub(crate) fn missing_step(folder: &Path, file: &str, modes: &Modes) -> Self {
        let step = if file == PREPROCESSOR { "normalizer_processor" } else { "unnormalizer_processor" };
        Self {
            path: folder.join(file),
            step,
            modes: modes.clone(),
            kinds: None,
            only: None,
            epsilon: DEFAULT_EPSILON,
            file: StatisticsFile::Absent,
        }
    }

    /// Returns `true` if the instruction's hashed embedding is recorded as the source of a feature.
    pub(crate) fn records_hashed_embedding(&mut self, feature: &str) -> Result<bool, CheckpointError> {
        let StatisticsFile::Own(file) = &mut self.file else { return Ok(false) };
        let name = format!("{feature}.{}", hashed::STATISTIC);
        if !file.contains(&name) {
            return Ok(false);
        }
        match file.read(&name)?[..] {
            [version] if version == f32::from(hashed::VERSION) => Ok(true),
            ref found => Err(CheckpointError::Value {
                path: file.path().to_owned(),
                key: name,
                found: format!("{found:?}"),
                expected: format!("{}, the version of the encoder in this program", hashed::VERSION),
            }),
        }
    }

    /// Returns the mode of a feature, whose kind in `config.json` is `kind`.
    ///
    /// # Errors
    /// If the step does not know a feature that it has to normalise.
    pub(crate) fn mode(&self, name: &str, kind: FeatureKind) -> Result<NormalisationMode, CheckpointError> {
        let is_action = kind == FeatureKind::Action;
        let mode =
            |kind: FeatureKind| self.modes.get(kind.name()).copied().unwrap_or(NormalisationMode::Identity);
        // LeRobot finds the action by its name alone.
        let known = self.kinds.as_ref().filter(|_| !is_action);
        let mode = match known.map(|kinds| kinds.get(name)) {
            None => mode(kind),
            Some(Some(own)) => mode(*own),
            Some(None) if mode(kind) == NormalisationMode::Identity => NormalisationMode::Identity,
            Some(None) => {
                return Err(CheckpointError::Value {
                    path: self.path.clone(),
                    key: format!("{}.features", self.step),
                    found: format!("no `{name}`"),
                    expected: format!(
                        "every input that `norm_map` normalises: LeRobot leaves the others as they are. Add it, or set {} to \
                         IDENTITY if the network was trained without normalisation",
                        kind.name()
                    ),
                });
            }
        };
        let is_excluded = self.only.as_ref().is_some_and(|only| !is_action && !only.contains(name));
        Ok(if is_excluded { NormalisationMode::Identity } else { mode })
    }

    /// Returns the statistics of a feature with `dim` entries (channels for an image), or `None` if it is not
    /// normalised.
    fn statistics(
        &mut self,
        name: &str,
        kind: FeatureKind,
        dim: usize,
    ) -> Result<Option<Statistics>, CheckpointError> {
        let mode = self.mode(name, kind)?;
        let needed = match mode {
            NormalisationMode::Identity => return Ok(None),
            NormalisationMode::MeanStd => ["mean", "std"],
            NormalisationMode::MinMax => ["min", "max"],
            NormalisationMode::Quantiles => ["q01", "q99"],
            NormalisationMode::Quantile10 => ["q10", "q90"],
        };
        let missing = |path: &Path, needed: String, found: String| CheckpointError::Statistics {
            path: path.to_owned(),
            feature: name.to_owned(),
            mode: mode.name(),
            needed,
            found,
        };
        let (file, prefix) = match &mut self.file {
            StatisticsFile::Own(file) => (file, format!("{name}.")),
            StatisticsFile::Weights(file, direction) => {
                let prefix = format!("{direction}.buffer_{}.", name.replace('.', "_"));
                if !file.names().iter().any(|name| name.starts_with(*direction)) {
                    let found = format!("neither {PREPROCESSOR} nor statistics among the weights");
                    return Err(missing(&self.path, needed.join(" and "), found));
                }
                (file, prefix)
            }
            StatisticsFile::Absent => {
                let found = format!("no `state_file` of the step `{}`", self.step);
                return Err(missing(&self.path, needed.join(" and "), found));
            }
        };
        let names = needed.map(|statistic| format!("{prefix}{statistic}"));
        if let Some(absent) = names.iter().find(|name| !file.contains(name)) {
            let is_statistic = |name: &String| {
                !matches!(self.file, StatisticsFile::Weights(..)) || name.starts_with("normalize_")
            };
            return Err(missing(
                file_path(&self.file, &self.path),
                format!("`{absent}`"),
                listed(tensor_names(&self.file).into_iter().filter(is_statistic), name),
            ));
        }
        let [first, second] = names;
        let (first, second) = (read(file, &first, dim)?, read(file, &second, dim)?);
        Ok(Some(match mode {
            NormalisationMode::MeanStd => Statistics::MeanStd(first, second),
            _ => Statistics::Range(first, second),
        }))
    }

    /// Returns the normalisation of an input with `dim` entries (channels for an image).
    pub(crate) fn input(
        &mut self,
        name: &str,
        kind: FeatureKind,
        dim: usize,
    ) -> Result<Option<ShiftScale>, CheckpointError> {
        let epsilon = self.epsilon;
        Ok(self.statistics(name, kind, dim)?.map(|found| found.shift_scale(epsilon, |std| std + epsilon)))
    }

    /// Returns the normalisation of actions, which the policy applies in reverse.
    pub(crate) fn action(&mut self, dim: usize) -> Result<Option<ShiftScale>, CheckpointError> {
        let epsilon = self.epsilon;
        let found = self.statistics(ACTION, FeatureKind::Action, dim)?;
        Ok(found.map(|found| found.shift_scale(epsilon, |std| std)))
    }

    /// Returns the scaling of a vector with `dim` entries.
    pub(crate) fn scaling(
        &mut self,
        name: &str,
        kind: FeatureKind,
        dim: usize,
    ) -> Result<Scaling, CheckpointError> {
        let epsilon = self.epsilon;
        Ok(match self.statistics(name, kind, dim)? {
            None => Scaling::Identity,
            Some(Statistics::MeanStd(mean, std)) => Scaling::MeanStd { mean, std, epsilon },
            Some(Statistics::Range(low, high)) => {
                let width = |(low, high): (&f32, f32)| if high == *low { epsilon } else { high - low };
                Scaling::Range { width: low.iter().zip(high).map(width).collect(), low }
            }
        })
    }

    /// Notes the kinds of `inputs` and actions that the step normalises otherwise than `config.json` says.
    pub(crate) fn note_differences(&self, config: &Modes, kinds: &[FeatureKind], notes: &mut Vec<String>) {
        let mode = |modes: &Modes, kind: FeatureKind| {
            modes.get(kind.name()).copied().unwrap_or(NormalisationMode::Identity)
        };
        for &kind in kinds {
            let (own, other) = (mode(&self.modes, kind), mode(config, kind));
            if own != other {
                notes.push(format!(
                    "normalises {} by {}, as the step `{}` says, although {CONFIG_FILE} says {}",
                    kind.name(),
                    own.name(),
                    self.step,
                    other.name()
                ));
            }
        }
    }
}

impl NormalisationMode {
    /// Returns LeRobot's name.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Identity => "IDENTITY",
            Self::MeanStd => "MEAN_STD",
            Self::MinMax => "MIN_MAX",
            Self::Quantiles => "QUANTILES",
            Self::Quantile10 => "QUANTILE10",
        }
    }
}

impl Statistics {
    /// Returns the shift and the scale. `scale_of` maps a standard deviation to its scale.
    fn shift_scale(self, epsilon: f32, scale_of: impl Fn(f32) -> f32) -> ShiftScale {
        match self {
            Self::MeanStd(mean, std) => ShiftScale::new(mean, std.into_iter().map(scale_of).collect()),
            Self::Range(low, high) => {
                let entry = |(&low, &high): (&f32, &f32)| {
                    let half = 0.5 * (high - low);
                    if half == 0.0 { (low, (0.5 * epsilon, -1.0)) } else { (low + half, (half, 0.0)) }
                };
                let (shift, (scale, offset)) = low.iter().zip(&high).map(entry).unzip();
                ShiftScale { shift, scale, offset }
            }
        }
    }
}

fn tensor_names(file: &StatisticsFile) -> Vec<String> {
    match file {
        StatisticsFile::Absent => Vec::new(),
        StatisticsFile::Own(file) | StatisticsFile::Weights(file, _) => file.names(),
    }
}

fn file_path<'a>(file: &'a StatisticsFile, otherwise: &'a Path) -> &'a Path {
    match file {
        StatisticsFile::Absent => otherwise,
        StatisticsFile::Own(file) | StatisticsFile::Weights(file, _) => file.path(),
    }
}

/// Returns the first names of a list as text, those that contain the name of a feature before the others.
fn listed(names: impl Iterator<Item = String>, feature: &str) -> String {
    let mut names: Vec<_> = names.collect();
    names.sort_by_key(|name| !name.contains(feature));
    let shown = names[..names.len().min(MAX_LISTED)].join(", ");
    match names.len() {
        0 => "no statistics".to_owned(),
        1..=MAX_LISTED => shown,
        n => format!("{shown} and {} more", n - MAX_LISTED),
    }
}

/// Reads one statistic of shape `[dim]`, or `[dim, 1, 1]` for the channels of an image.
fn read(file: &mut TensorFile, name: &str, dim: usize) -> Result<Vec<f32>, CheckpointError> {
    let per_channel = file.shape(name) == Some(&[dim, 1, 1]);
    let shape: &[usize] = if per_channel { &[dim, 1, 1] } else { &[dim] };
    file.check(name, shape)?;
    let values = file.read(name)?;
    match values.iter().find(|x| !x.is_finite()) {
        None => Ok(values),
        Some(x) => Err(CheckpointError::Value {
            path: file.path().to_owned(),
            key: name.to_owned(),
            found: x.to_string(),
            expected: "a finite value; the checkpoint was saved without dataset statistics".to_owned(),
        }),
    }
}
