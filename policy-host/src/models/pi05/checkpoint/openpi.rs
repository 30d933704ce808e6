//! openpi's layout of a π0.5 checkpoint.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use run_config::input;
use serde::Deserialize;

use super::description::{Folder, Pi05Description};
use super::lerobot::MAX_ROWS;
use crate::formats::files::MAPPING_FILE;
use crate::formats::lerobot::feature::{FeatureKind, InputFeature};
use crate::formats::scaling::Scaling;
use crate::formats::settings::{Settings, parse};
use crate::formats::{CheckpointError, ObservationMapping};
use crate::models::pi05::image::BLACK;
use crate::policy::execution::ChunkSettings;

/// Cameras of openpi's networks, in their order.
const OPENPI_CAMERAS: [&str; 3] = ["base_0_rgb", "left_wrist_0_rgb", "right_wrist_0_rgb"];
/// Term that openpi adds to the width of a range.
const OPENPI_EPSILON: f32 = 1e-6;
/// Depth to which the folder of openpi's statistics may be nested under `assets`.
const MAX_ASSET_DEPTH: usize = 4;

/// Settings of openpi's `config.json`, which only its converter writes, that the tensors determine, or that
/// have no influence on actions.
const WITHOUT_INFLUENCE: [&str; 5] =
    ["action_dim", "paligemma_variant", "action_expert_variant", "pytorch_compile_mode", "dtype"];
/// openpi's defaults: the length of a prompt, and what LeRobot took over from it.
const MAX_TOKENS: usize = 200;
const MAX_STATE_DIM: usize = 32;
const N_STEPS: usize = 10;
const PERIODS: (f64, f64) = (4e-3, 4.0);
/// Name of the state feature in a mapping.
const STATE: &str = "observation.state";

/// Contents of openpi's statistics.
#[derive(Debug, Deserialize)]
struct OpenpiStatistics {
    norm_stats: BTreeMap<String, OpenpiRange>,
}

#[derive(Debug, Deserialize)]
struct OpenpiRange {
    #[serde(default, deserialize_with = "quantiles")]
    q01: Vec<f32>,
    #[serde(default, deserialize_with = "quantiles")]
    q99: Vec<f32>,
}

/// Reads quantiles, which openpi stores as `null` if they were not computed.
fn quantiles<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Vec<f32>, D::Error> {
    Option::deserialize(deserializer).map(Option::unwrap_or_default)
}

impl Folder<'_> {
    pub(crate) fn openpi(&self, mut settings: Settings) -> Result<Pi05Description, CheckpointError> {
        let ignore = &self.sidecar.ignore;
        let mut notes = Vec::new();
        let action_horizon = settings.take("action_horizon")?;
        let max_tokens = settings.take_or("max_token_len", MAX_TOKENS)?;
        for (key, needed) in [("pi05", true), ("discrete_state_input", true)] {
            if let Some(found) = settings.take::<bool>(key)?.filter(|found| *found != needed) {
                return Err(settings.value(key, found, format!("{needed}, as π0.5 has it")));
            }
        }
        if let Some(found) = settings.take::<String>("precision")?.filter(|found| found != "float32") {
            notes.push(format!("computes in f32 from weights as stored, although `precision` is {found}"));
        }
        settings.discard(&WITHOUT_INFLUENCE);
        settings.finish(ignore, &mut notes)?;
        ignore.finish(self.folder)?;
        let horizon = self.horizon(action_horizon)?;
        let architecture = self.architecture(horizon)?;
        let side = architecture.image_side();
        let statistics = self.openpi_statistics()?;
        notes.push(
            "actions are taken as absolute: openpi's files do not say whether it trained on delta actions"
                .to_owned(),
        );
        let (state, action) = (&statistics["state"], &statistics["actions"]);
        let robot = (self.sidecar.morphology, self.sidecar.control_mode);
        let action_dim = match robot {
            (Some(morphology), Some(mode)) => mode.action_dim(morphology),
            _ => action.q01.len(),
        };
        let image =
            |name: &&str| InputFeature::new((*name).to_owned(), vec![3, side, side], FeatureKind::Visual);
        let mut features: Vec<_> = OPENPI_CAMERAS.iter().map(image).collect();
        let state_dim = match self.sidecar.mapping.get(STATE) {
            // The statistics may be padded; the mapping determines the width.
            Some(source) => self.sidecar.width_of(source).unwrap_or(state.q01.len()),
            None => state.q01.len(),
        };
        features.push(InputFeature::new(STATE.to_owned(), vec![state_dim], FeatureKind::State));
        let mapping = ObservationMapping { trained_sizes: Vec::new(), ..self.mapping(features, action_dim)? };
        if action_dim > architecture.action_width {
            let found = format!("{action_dim} entries");
            return Err(self.value("actions", found, format!("at most {}", architecture.action_width)));
        }
        for (key, range, dim) in [("state", state, state_dim), ("actions", action, action_dim)] {
            if range.q01.len() < dim {
                let found = format!("statistics of {} entries", range.q01.len());
                return Err(self.value(key, found, format!("at least {dim}, as the robot has")));
            }
        }
        Ok(Pi05Description {
            architecture,
            mapping,
            state: state.scaling(state_dim),
            action: action.scaling(action_dim),
            action_dim,
            relative: Vec::new(),
            prompt_state: self.sidecar.prompt_state.unwrap_or_default(),
            padding_value: BLACK,
            max_state_dim: MAX_STATE_DIM,
            tokenizer_folder: self.folder.to_owned(),
            max_tokens,
            n_steps: N_STEPS,
            periods: PERIODS,
            chunk: ChunkSettings { horizon, execute: None, ensemble_decay: None },
            notes,
        })
    }

    /// Returns the number of rows of an action chunk: `action_horizon`, or the sidecar's `chunk_size`.
    fn horizon(&self, action_horizon: Option<usize>) -> Result<usize, CheckpointError> {
        let horizon = action_horizon.or(self.sidecar.chunk_size).ok_or_else(|| CheckpointError::Value {
            path: self.folder.join(MAPPING_FILE),
            key: "chunk_size".to_owned(),
            found: "no value".to_owned(),
            expected: "the number of rows of an action chunk, which openpi's checkpoint does not contain"
                .to_owned(),
        })?;
        if horizon > MAX_ROWS {
            return Err(self.value("chunk_size", horizon, format!("1 to {MAX_ROWS}")));
        }
        Ok(horizon)
    }

    /// Reads the only statistics under `assets`.
    fn openpi_statistics(&self) -> Result<BTreeMap<String, OpenpiRange>, CheckpointError> {
        let assets = self.folder.join("assets");
        let mut found = Vec::new();
        find_statistics(&assets, MAX_ASSET_DEPTH, &mut found);
        let [path] = &found[..] else {
            return Err(CheckpointError::Value {
                path: assets,
                key: "norm_stats.json".to_owned(),
                found: format!("{} files", found.len()),
                expected: "exactly one, openpi's statistics".to_owned(),
            });
        };
        let text =
            input::read(path).map_err(|source| CheckpointError::Read { path: path.clone(), source })?;
        let OpenpiStatistics { norm_stats } = parse(path, &text)?;
        for key in ["state", "actions"] {
            let invalid = |found: String, expected: &str| CheckpointError::Value {
                path: path.clone(),
                key: key.to_owned(),
                found,
                expected: expected.to_owned(),
            };
            let Some(range) = norm_stats.get(key) else {
                return Err(invalid("no entry".to_owned(), "q01 and q99"));
            };
            if range.q01.is_empty() && range.q99.is_empty() {
                let expected = "q01 and q99, by which π0.5 normalises: compute the statistics with openpi's \
                                compute_norm_stats.py for a configuration of π0.5";
                return Err(invalid("no quantiles".to_owned(), expected));
            }
            let (low, high) = (range.q01.len(), range.q99.len());
            if low != high || range.q01.iter().chain(&range.q99).any(|x| !x.is_finite()) {
                return Err(invalid(
                    format!("{low} and {high} entries"),
                    "q01 and q99 of equal length, finite",
                ));
            }
        }
        Ok(norm_stats)
    }
}

impl OpenpiRange {
    /// Returns the scaling of the first `dim` entries.
    fn scaling(&self, dim: usize) -> Scaling {
        let ranges = self.q01.iter().zip(&self.q99).take(dim);
        Scaling::Range {
            low: ranges.clone().map(|(low, _)| *low).collect(),
            width: ranges.map(|(low, high)| high - low + OPENPI_EPSILON).collect(),
        }
    }
}

/// Collects the paths of openpi's statistics under a folder.
fn find_statistics(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() && depth > 0 {
            find_statistics(&path, depth - 1, found);
        } else if path.file_name().is_some_and(|name| name == "norm_stats.json") && path.is_file() {
            found.push(path);
        }
    }
}
