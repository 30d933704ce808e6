//! The statistics by which LeRobot normalises, wherever a version of it keeps them.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::file::TensorFile;
use super::mapping::FeatureKind;
use super::{CheckpointError, parse};
use crate::act::normalise::Affine;

/// The processors' files, since LeRobot 0.4.
const PREPROCESSOR: &str = "policy_preprocessor.json";
const POSTPROCESSOR: &str = "policy_postprocessor.json";
/// Steps of a processor that change no number for us: images and states come batched, on the CPU, under their own names.
const HARMLESS: [&str; 3] = ["rename_observations_processor", "to_batch_processor", "device_processor"];
/// The steps that do.
const NORMALISER: &str = "normalizer_processor";
const UNNORMALISER: &str = "unnormalizer_processor";
/// What LeRobot adds to, or puts in the place of, a width that is zero.
const DEFAULT_EPSILON: f32 = 1e-8;

/// How a kind of feature is normalised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub(super) enum Mode {
    Identity,
    MeanStd,
    MinMax,
    Quantiles,
    Quantile10,
}

/// A processor's file.
#[derive(Debug, Deserialize)]
struct Processor {
    steps: Vec<Step>,
}

#[derive(Debug, Deserialize)]
struct Step {
    registry_name: Option<String>,
    #[serde(default)]
    config: StepConfig,
    state_file: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct StepConfig {
    eps: Option<f32>,
    norm_map: BTreeMap<String, Mode>,
}

/// Where a feature's statistics are.
struct Place<'a> {
    file: &'a mut TensorFile,
    /// What stands before their names: of a processor's own file, `<feature>.`; among the weights of an older checkpoint,
    /// `<direction>.buffer_<feature, dots as underscores>.`
    prefix: String,
}

/// One direction: of inputs to the network, or of its actions back.
struct Direction {
    modes: BTreeMap<String, Mode>,
    epsilon: f32,
    /// `None` where nothing is normalised.
    file: Option<TensorFile>,
}

/// The statistics of a checkpoint.
pub(super) struct Statistics<'a> {
    inputs: Direction,
    outputs: Direction,
    weights: &'a mut TensorFile,
}

impl<'a> Statistics<'a> {
    /// Finds them in `folder`, or among the `weights` of an older checkpoint, whose configuration names the `modes`.
    pub(super) fn find(
        folder: &Path,
        modes: &BTreeMap<String, Mode>,
        weights: &'a mut TensorFile,
    ) -> Result<Self, CheckpointError> {
        let (inputs, outputs) = if folder.join(PREPROCESSOR).is_file() {
            (
                Direction::read(folder, PREPROCESSOR, NORMALISER)?,
                Direction::read(folder, POSTPROCESSOR, UNNORMALISER)?,
            )
        } else {
            let older = || Direction { modes: modes.clone(), epsilon: DEFAULT_EPSILON, file: None };
            (older(), older())
        };
        Ok(Self { inputs, outputs, weights })
    }

    /// What an input of `width` numbers (of an image: channels) goes through.
    pub(super) fn input(
        &mut self,
        name: &str,
        kind: FeatureKind,
        width: usize,
    ) -> Result<Option<Affine>, CheckpointError> {
        let mode = self.inputs.mode(kind);
        let epsilon = self.inputs.epsilon;
        let place = self.inputs.place(self.weights, "normalize_inputs", name);
        affine(place, mode, width, epsilon, |std| std + epsilon)
    }

    /// What actions come back through.
    pub(super) fn action(&mut self, name: &str, width: usize) -> Result<Option<Affine>, CheckpointError> {
        let mode = self.outputs.mode(FeatureKind::Action);
        let epsilon = self.outputs.epsilon;
        affine(self.outputs.place(self.weights, "unnormalize_outputs", name), mode, width, epsilon, |std| std)
    }
}

impl Direction {
    /// Reads a processor's file, whose steps must all be known.
    fn read(folder: &Path, file: &str, normaliser: &str) -> Result<Self, CheckpointError> {
        let path = folder.join(file);
        let text =
            std::fs::read(&path).map_err(|source| CheckpointError::Read { path: path.clone(), source })?;
        let processor: Processor = parse(&path, &text)?;
        let mut found = Self { modes: BTreeMap::new(), epsilon: DEFAULT_EPSILON, file: None };
        for (idx, step) in processor.steps.into_iter().enumerate() {
            let name = step.registry_name.unwrap_or_else(|| "a class".to_owned());
            if name == normaliser {
                let state = step.state_file.map(|state| TensorFile::open(&folder.join(state))).transpose()?;
                let epsilon = step.config.eps.unwrap_or(DEFAULT_EPSILON);
                found = Self { modes: step.config.norm_map, epsilon, file: state };
            } else if !HARMLESS.contains(&name.as_str()) {
                return Err(CheckpointError::Value {
                    path,
                    key: format!("steps[{idx}]"),
                    found: format!("`{name}`"),
                    expected: format!("`{normaliser}` or one of {}", HARMLESS.join(", ")),
                });
            }
        }
        // A processor without statistics leaves every feature as it is.
        if found.file.is_none() {
            found.modes.clear();
        }
        Ok(found)
    }

    fn mode(&self, kind: FeatureKind) -> Mode {
        let name = match kind {
            FeatureKind::Visual => "VISUAL",
            FeatureKind::State => "STATE",
            FeatureKind::Env => "ENV",
            FeatureKind::Action => "ACTION",
        };
        self.modes.get(name).copied().unwrap_or(Mode::Identity)
    }

    /// Where a feature's statistics are; nowhere, if a processor has none for it and so leaves it as it is.
    fn place<'a>(
        &'a mut self,
        weights: &'a mut TensorFile,
        direction: &str,
        feature: &str,
    ) -> Option<Place<'a>> {
        match &mut self.file {
            Some(file) => {
                let prefix = format!("{feature}.");
                file.names().iter().any(|name| name.starts_with(&prefix)).then_some(Place { file, prefix })
            }
            None => {
                let prefix = format!("{direction}.buffer_{}.", feature.replace('.', "_"));
                Some(Place { file: weights, prefix })
            }
        }
    }
}

/// What `width` numbers are shifted and scaled by; of a standard deviation, `scale_of`.
fn affine(
    place: Option<Place<'_>>,
    mode: Mode,
    width: usize,
    epsilon: f32,
    scale_of: impl Fn(f32) -> f32,
) -> Result<Option<Affine>, CheckpointError> {
    let Some(mut place) = place else { return Ok(None) };
    let mut between = |low: &str, high: &str| {
        let (low, high) = (place.read(low, width)?, place.read(high, width)?);
        let half = |low: f32, high: f32| if high == low { 0.5 * epsilon } else { 0.5 * (high - low) };
        let scale: Vec<f32> = low.iter().zip(&high).map(|(&low, &high)| half(low, high)).collect();
        let shift = low.iter().zip(&scale).map(|(low, half)| low + half).collect();
        Ok(Some(Affine { shift, scale }))
    };
    match mode {
        Mode::Identity => Ok(None),
        Mode::MinMax => between("min", "max"),
        Mode::Quantiles => between("q01", "q99"),
        Mode::Quantile10 => between("q10", "q90"),
        Mode::MeanStd => {
            let shift = place.read("mean", width)?;
            let scale = place.read("std", width)?.into_iter().map(scale_of).collect();
            Ok(Some(Affine { shift, scale }))
        }
    }
}

impl Place<'_> {
    /// One statistic: `[width]`, or `[width, 1, 1]` of an image's channels.
    fn read(&mut self, statistic: &str, width: usize) -> Result<Vec<f32>, CheckpointError> {
        let name = format!("{}{statistic}", self.prefix);
        let of_channels = self.file.shape(&name) == Some(&[width, 1, 1]);
        let shape: &[usize] = if of_channels { &[width, 1, 1] } else { &[width] };
        self.file.check(&name, shape)?;
        let numbers = self.file.read(&name)?;
        match numbers.iter().find(|x| !x.is_finite()) {
            None => Ok(numbers),
            Some(x) => Err(CheckpointError::Value {
                path: self.file.path().to_owned(),
                key: name,
                found: x.to_string(),
                expected: "a finite number: the checkpoint was saved without its dataset's statistics"
                    .to_owned(),
            }),
        }
    }
}
