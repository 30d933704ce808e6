//! The metadata that LeRobot reads: `info.json`, `stats.json`, `tasks.parquet` and the table of episodes.

use std::path::Path;

use anyhow::{Context, ensure};
use ipc_types::{ControlMode, Morphology};
use policy_host::text::hashed;
use serde_json::{Map, Value, json};

use crate::store::build_identity;
use crate::store::demos::dataset::features::{ACTION, FPS, LANGUAGE, LANGUAGE_DIM, STATE};
use crate::store::demos::dataset::journal::{EpisodeRecord, Journal, instructions};
use crate::store::demos::dataset::settings::DatasetSettings;
use crate::store::demos::dataset::stats::{FeatureStats, Histogram, QUANTILES};
use crate::store::demos::dataset::values::read_values;
use crate::store::parquet_table::{Cells, NamedCells, ParquetTable};

/// Maximum number of data files per folder.
const CHUNK_FILES: usize = 1000;
const EPISODES: &str = "meta/episodes/chunk-000/file-000.parquet";
/// Joints per arm.
const N_JOINTS: usize = 7;

/// Scalar features: name and dtype.
const SCALARS: [(&str, &str); 5] = [
    ("timestamp", "float32"),
    ("frame_index", "int64"),
    ("episode_index", "int64"),
    ("index", "int64"),
    ("task_index", "int64"),
];

/// Returns the path of a data file, relative to the dataset.
pub(crate) fn data_path(file_idx: usize) -> String {
    format!("data/chunk-{:03}/file-{:03}.parquet", file_idx / CHUNK_FILES, file_idx % CHUNK_FILES)
}

/// Writes all metadata, which is derived from the journal.
pub(crate) fn write(folder: &Path, journal: &Journal) -> anyhow::Result<()> {
    let text = |name: &str, value: &Value| {
        let path = folder.join(name);
        std::fs::write(&path, format!("{value:#}\n"))
            .with_context(|| format!("failed to write {}", path.display()))
    };
    text("meta/info.json", &info(journal))?;
    if journal.n_files() == 0 {
        return Ok(());
    }
    text("meta/stats.json", &stats(folder, journal)?)?;
    let episodes = folder.join(EPISODES);
    std::fs::create_dir_all(episodes.parent().unwrap_or(folder))?;
    ParquetTable::write(&episodes, episode_columns(journal), None)?;
    let tasks = instructions(journal.episodes());
    let columns = vec![
        ("task_index".to_owned(), Cells::Int((0..tasks.len() as i64).collect())),
        ("task".to_owned(), Cells::Text(tasks.iter().map(|&text| text.to_owned()).collect())),
    ];
    let pandas = ("pandas", pandas_metadata().to_string());
    ParquetTable::write(&folder.join("meta/tasks.parquet"), columns, Some(pandas))
}

fn info(journal: &Journal) -> Value {
    let settings = journal.settings();
    let n_episodes = journal.episodes().count();
    json!({
        "codebase_version": "v3.0",
        "robot_type": format!("{}_panda", settings.morphology.name()),
        "total_episodes": n_episodes,
        "total_frames": journal.episodes().map(|episode| episode.n_frames).sum::<u64>(),
        "total_tasks": instructions(journal.episodes()).len(),
        "chunks_size": CHUNK_FILES,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": FPS,
        "splits": {"train": format!("0:{n_episodes}")},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": null,
        "features": features(settings),
    })
}

/// Returns the description of the features, in column order.
fn features(settings: &DatasetSettings) -> Value {
    let &DatasetSettings { morphology, control_mode: mode, .. } = settings;
    let vector = |width: usize, names: Value| json!({"dtype": "float32", "shape": [width], "names": names});
    let parts = settings.state_parts().iter();
    let state: Vec<String> =
        parts.flat_map(|(part, width)| (0..*width).map(move |idx| format!("{part}.{idx}"))).collect();
    let mut features = Map::new();
    features.insert(STATE.into(), vector(state.len(), state.into()));
    if settings.has_embedding() {
        let mut language = vector(LANGUAGE_DIM, Value::Null);
        language["info"] = json!({"encoder": hashed::STATISTIC, "version": hashed::VERSION});
        features.insert(LANGUAGE.into(), language);
    }
    features.insert(ACTION.into(), vector(mode.action_dim(morphology), action_names(morphology, mode)));
    for (name, size) in settings.cameras() {
        let (shape, names) = ([size.height, size.width, 3], ["height", "width", "channels"]);
        features.insert(name, json!({"dtype": "image", "shape": shape, "names": names}));
    }
    for (name, dtype) in SCALARS {
        features.insert(name.into(), json!({"dtype": dtype, "shape": [1], "names": null}));
    }
    Value::Object(features)
}

/// Returns the names of the values of an action row.
fn action_names(morphology: Morphology, mode: ControlMode) -> Value {
    let of_arm: Vec<String> = match mode {
        ControlMode::JointPos => (1..=N_JOINTS).map(|joint| format!("joint{joint}")).collect(),
        ControlMode::EeDeltaPose => ["dx", "dy", "dz", "drx", "dry", "drz"].map(str::to_owned).into(),
        ControlMode::EePose => ["x", "y", "z", "rx", "ry", "rz"].map(str::to_owned).into(),
    };
    let of_arm = || of_arm.iter().map(String::as_str).chain(["gripper"]);
    let arms = 1..=morphology.n_arms();
    arms.flat_map(|arm| of_arm().map(move |name| format!("arm{arm}.{name}"))).collect()
}

/// Returns the metadata that Hugging Face's `datasets` expects in a data file.
pub(crate) fn hugging_face_metadata(settings: &DatasetSettings) -> String {
    let value = |dtype: &str| json!({"dtype": dtype, "_type": "Value"});
    let list = || json!({"feature": value("float32"), "_type": "List"});
    let language = settings.has_embedding().then_some(LANGUAGE);
    let vectors = [Some(STATE), language, Some(ACTION)].into_iter().flatten();
    let mut features: Map<String, Value> = vectors.map(|name| (name.to_owned(), list())).collect();
    features.extend(settings.cameras().map(|(name, _)| (name, json!({"_type": "Image"}))));
    features.extend(SCALARS.map(|(name, dtype)| (name.to_owned(), value(dtype))));
    json!({"info": {"features": features}}).to_string()
}

/// Returns the metadata that pandas expects. The instruction is the index of the table.
fn pandas_metadata() -> Value {
    let column = |name: &str, kind: &str, numpy: &str| json!({"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": null});
    json!({
        "index_columns": ["task"],
        "column_indexes": [{
            "name": null, "field_name": null, "pandas_type": "unicode", "numpy_type": "object",
            "metadata": {"encoding": "UTF-8"},
        }],
        "columns": [column("task_index", "int64", "int64"), column("task", "unicode", "object")],
        "attributes": {},
        "creator": {"library": "hypogeum", "version": build_identity::VERSION},
        "pandas_version": "2.0.0",
    })
}

/// Returns the nesting depth of a feature's statistics. Those of images have shape `[3, 1, 1]`.
fn depth(feature: &str) -> usize {
    if feature.starts_with("observation.images.") { 3 } else { 1 }
}

/// Returns the statistics by name.
fn lists(stats: &FeatureStats) -> impl Iterator<Item = (&'static str, &Vec<f64>)> {
    let quantiles = QUANTILES.iter().map(|(_, name)| *name).zip(&stats.quantiles);
    [("min", &stats.min), ("max", &stats.max), ("mean", &stats.mean), ("std", &stats.std)]
        .into_iter()
        .chain(quantiles)
}

/// Returns the statistics of all frames by feature and name.
fn stats(folder: &Path, journal: &Journal) -> anyhow::Result<Value> {
    let features = journal.episodes().next().map(|episode| &episode.stats).into_iter().flatten();
    let mut by_feature = Map::new();
    for (feature, of_first) in features {
        let is_image = depth(feature) == 3;
        let over = if is_image {
            image_stats(journal, feature)
        } else {
            FeatureStats::of_values(&all_values(folder, journal, feature)?, of_first.mean.len())
        };
        let nested = |numbers: &[f64]| -> Value {
            numbers.iter().map(|&x| if is_image { json!([[x]]) } else { json!(x) }).collect()
        };
        let mut lists: Map<String, Value> =
            lists(&over).map(|(name, numbers)| (name.to_owned(), nested(numbers))).collect();
        lists.insert("count".to_owned(), json!([over.count]));
        if feature == LANGUAGE {
            lists.insert(hashed::STATISTIC.to_owned(), json!([f64::from(hashed::VERSION)]));
        }
        by_feature.insert(feature.clone(), Value::Object(lists));
    }
    Ok(Value::Object(by_feature))
}

/// Reads all values of a feature. One feature fits into memory: of 2,800 episodes, the largest takes 0.1 GB.
fn all_values(folder: &Path, journal: &Journal, feature: &str) -> anyhow::Result<Vec<f32>> {
    let mut values = Vec::new();
    for (file_idx, episodes) in journal.files().iter().enumerate() {
        let path = folder.join(data_path(file_idx));
        let width = episodes.first().map_or(0, |episode| episode.stats[feature].mean.len());
        let n_frames: u64 = episodes.iter().map(|episode| episode.n_frames).sum();
        let (found, expected) = (read_values(&path, 0..episodes.len(), feature), n_frames as usize * width);
        let found = found.with_context(|| format!("failed to read {}", path.display()))?;
        ensure!(
            found.len() == expected,
            "{} has {} values in `{feature}`, expected {expected}",
            path.display(),
            found.len()
        );
        values.extend(found);
    }
    Ok(values)
}

/// Returns the statistics of a camera.
fn image_stats(journal: &Journal, feature: &str) -> FeatureStats {
    let mut over = <[Histogram; 3]>::default();
    journal
        .episodes()
        .filter_map(|episode| episode.histograms.get(feature))
        .for_each(|one| Histogram::add(&mut over, one));
    FeatureStats::of_images(&over, journal.episodes().map(|episode| episode.n_frames).sum())
}

fn episode_columns(journal: &Journal) -> Vec<NamedCells> {
    let all: Vec<&EpisodeRecord> = journal.episodes().collect();
    let files = journal.files().iter().enumerate();
    let file_of: Vec<usize> = files.flat_map(|(idx, episodes)| vec![idx; episodes.len()]).collect();
    let mut end = 0;
    let ends: Vec<i64> = all
        .iter()
        .map(|episode| {
            end += episode.n_frames as i64;
            end
        })
        .collect();
    let lengths: Vec<i64> = all.iter().map(|episode| episode.n_frames as i64).collect();
    let mut columns: Vec<NamedCells> = vec![
        ("episode_index".into(), Cells::Int((0..all.len() as i64).collect())),
        (
            "tasks".into(),
            Cells::TextList(all.iter().map(|episode| vec![episode.instruction.clone()]).collect()),
        ),
        ("length".into(), Cells::Int(lengths.clone())),
        (
            "data/chunk_index".into(),
            Cells::Int(file_of.iter().map(|idx| (idx / CHUNK_FILES) as i64).collect()),
        ),
        (
            "data/file_index".into(),
            Cells::Int(file_of.iter().map(|idx| (idx % CHUNK_FILES) as i64).collect()),
        ),
        (
            "dataset_from_index".into(),
            Cells::Int(ends.iter().zip(&lengths).map(|(end, n)| end - n).collect()),
        ),
        ("dataset_to_index".into(), Cells::Int(ends)),
    ];
    for feature in all.first().map(|episode| episode.stats.keys()).into_iter().flatten() {
        let stats: Vec<&FeatureStats> = all.iter().map(|episode| &episode.stats[feature]).collect();
        let names = stats.first().map(|stats| lists(stats).map(|(name, _)| name).collect::<Vec<_>>());
        for (idx, name) in names.unwrap_or_default().into_iter().enumerate() {
            let of_episode = |stats: &&FeatureStats| {
                lists(stats).nth(idx).map(|(_, numbers)| numbers.clone()).unwrap_or_default()
            };
            let cells =
                Cells::DoubleList { depth: depth(feature), lists: stats.iter().map(of_episode).collect() };
            columns.push((format!("stats/{feature}/{name}"), cells));
        }
        let counts = stats.iter().map(|stats| vec![stats.count as i64]).collect();
        columns.push((format!("stats/{feature}/count"), Cells::IntList(counts)));
    }
    for name in ["meta/episodes/chunk_index", "meta/episodes/file_index"] {
        columns.push((name.into(), Cells::Int(vec![0; all.len()])));
    }
    columns
}
