//! A folder of demonstrations in LeRobot's dataset format v3, with the records needed to resume and to replay
//! it.
//!
//! Frames are stored in Parquet files of several episodes each. A file counts once `meta/hypogeum.jsonl`
//! lists it; an unfinished file is written again, so that an interrupted dataset ends up with the same bytes
//! as an uninterrupted one. All other files in `meta/` are derived from that journal.

mod features;
mod journal;
mod meta;
mod read;
mod settings;
mod stats;
mod values;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use policy_host::text::hashed_embedding;
use sim::TaskId;
use sim::demo::Recording;

use self::features::{ACTION, FPS, LANGUAGE, LANGUAGE_DIM, STATE};
use self::journal::{Journal, instructions};
use self::stats::{FeatureStats, Histogram};
use crate::store::parquet_table::{Cells, NamedCells, ParquetTable};
use crate::store::stored_episode::format_fingerprint;

pub(crate) use self::journal::EpisodeRecord;
pub(crate) use self::read::StoredDataset;
pub(crate) use self::settings::DatasetSettings;

/// Bytes of images after which a data file is closed.
const FILE_BYTES: usize = 32 << 20;

/// Appends episodes to a dataset.
pub(crate) struct DatasetWriter {
    folder: PathBuf,
    journal: Journal,
    /// The file being written, which is not in the journal yet.
    open: Option<OpenFile>,
}

struct OpenFile {
    table: ParquetTable,
    /// Path while the file is open. Readers of datasets ignore its extension.
    draft: PathBuf,
    /// Path of the finished file.
    path: PathBuf,
    episodes: Vec<EpisodeRecord>,
    n_bytes: usize,
}

/// An episode to append.
pub(crate) struct DatasetEpisode {
    pub(crate) task: String,
    pub(crate) instruction: String,
    /// Index of the episode under the suite seed.
    pub(crate) index: u32,
    pub(crate) fingerprint: u64,
    /// Action rows `[n_frames, action_dim]`.
    pub(crate) actions: Vec<f32>,
    /// Robot states `[n_frames, state_dim]`.
    pub(crate) states: Vec<f32>,
    /// Images by camera.
    pub(crate) images: Vec<CameraImages>,
}

/// The images of one camera.
#[derive(Clone, Default)]
pub(crate) struct CameraImages {
    /// Encoded images, one per frame.
    files: Vec<Vec<u8>>,
    histograms: [Histogram; 3],
}

impl DatasetEpisode {
    /// Returns the episode of a recording, with the images of its frames.
    pub(crate) fn new(
        task: TaskId,
        instruction: String,
        index: u32,
        recording: &Recording,
        images: Vec<CameraImages>,
    ) -> Self {
        Self {
            task: task.name().to_owned(),
            instruction,
            index,
            fingerprint: recording.fingerprint(),
            actions: recording.actions().to_vec(),
            states: recording.states().to_vec(),
            images,
        }
    }
}

impl CameraImages {
    /// Adds an image `[height, width, 3] u8` and its encoded file.
    pub(crate) fn push(&mut self, pixels: &[u8], file: Vec<u8>) {
        Histogram::count(&mut self.histograms, pixels);
        self.files.push(file);
    }
}

impl DatasetWriter {
    /// Opens the dataset in `folder`, or creates one.
    ///
    /// # Errors
    /// If the folder contains a dataset with other settings, or something else.
    pub(crate) fn open(folder: &Path, settings: DatasetSettings) -> anyhow::Result<Self> {
        let journal = Journal::open(folder, settings)?;
        Ok(Self { folder: folder.to_owned(), journal, open: None })
    }

    /// Returns the number of demonstrations of a task and the index of its first untried episode.
    pub(crate) fn progress(&self, task: &str) -> (u32, u32) {
        let of_task = || self.episodes().filter(|episode| episode.task == task);
        (of_task().count() as u32, of_task().map(|episode| episode.index + 1).max().unwrap_or(0))
    }

    /// Returns all episodes, including those of the open file.
    pub(crate) fn episodes(&self) -> impl Iterator<Item = &EpisodeRecord> {
        self.journal.episodes().chain(self.open.iter().flat_map(|open| &open.episodes))
    }

    /// Returns the total number of frames.
    pub(crate) fn n_frames(&self) -> u64 {
        self.episodes().map(|episode| episode.n_frames).sum()
    }

    /// Appends an episode.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn push(&mut self, episode: DatasetEpisode) -> anyhow::Result<()> {
        let (first, episode_idx) = (self.n_frames(), self.episodes().count() as u64);
        let task_idx = self.task_idx(&episode.instruction);
        let settings = self.journal.settings();
        let n_bytes: usize = episode.images.iter().flat_map(|images| &images.files).map(Vec::len).sum();
        let (columns, record) = columns(settings, episode, (episode_idx, first, task_idx));
        let open = match &mut self.open {
            Some(open) => open,
            none => {
                let path = self.folder.join(meta::data_path(self.journal.n_files()));
                std::fs::create_dir_all(path.parent().unwrap_or(&self.folder))
                    .with_context(|| format!("failed to create the folder of {}", path.display()))?;
                let note = ("huggingface", meta::hugging_face_metadata(settings));
                let draft = path.with_extension("draft");
                let table = ParquetTable::create(&draft, &columns, Some(note))?;
                none.insert(OpenFile { table, draft, path, episodes: Vec::new(), n_bytes: 0 })
            }
        };
        open.table.push(columns).with_context(|| format!("failed to write {}", open.path.display()))?;
        open.episodes.push(record);
        open.n_bytes += n_bytes;
        if open.n_bytes >= FILE_BYTES { self.close_file() } else { Ok(()) }
    }

    /// Closes the open file and adds its episodes to the journal.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn close_file(&mut self) -> anyhow::Result<()> {
        let Some(OpenFile { table, draft, path, episodes, .. }) = self.open.take() else { return Ok(()) };
        let written = table.finish().and_then(|()| Ok(std::fs::rename(&draft, &path)?));
        written.with_context(|| format!("failed to write {}", path.display()))?;
        self.journal.push(episodes)
    }

    /// Discards the open file and writes the metadata of the others.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write_meta(&mut self) -> anyhow::Result<()> {
        if let Some(open) = self.open.take() {
            std::fs::remove_file(&open.draft)
                .with_context(|| format!("failed to remove {}", open.draft.display()))?;
        }
        meta::write(&self.folder, &self.journal)
    }

    /// Returns the index of an instruction. LeRobot's tasks are distinct instructions.
    fn task_idx(&self, instruction: &str) -> usize {
        let known = instructions(self.episodes());
        known.iter().position(|other| *other == instruction).unwrap_or(known.len())
    }
}

/// Returns the rows of an episode and its journal record.
fn columns(
    settings: &DatasetSettings,
    episode: DatasetEpisode,
    (episode_idx, first, task_idx): (u64, u64, usize),
) -> (Vec<NamedCells>, EpisodeRecord) {
    let rows = episode.states.chunks_exact(settings.morphology.state_dim());
    let n_frames = rows.len();
    let action_dim = episode.actions.len() / n_frames;
    let state_dim = settings.state_parts().iter().map(|(_, width)| width).sum();
    let states: Vec<f32> = rows.flat_map(|row| &row[..state_dim]).copied().collect();
    let mut numbers = vec![(STATE, state_dim, states)];
    if settings.has_embedding() {
        let embedding = hashed_embedding(&episode.instruction, LANGUAGE_DIM);
        numbers.push((LANGUAGE, LANGUAGE_DIM, embedding.repeat(n_frames)));
    }
    numbers.push((ACTION, action_dim, episode.actions));
    let (mut stats, mut counted) = (BTreeMap::new(), BTreeMap::new());
    let mut columns: Vec<NamedCells> = Vec::new();
    for (name, width, numbers) in numbers {
        stats.insert(name.to_owned(), FeatureStats::of_values(&numbers, width));
        columns.push((name.to_owned(), Cells::FloatList { width, numbers }));
    }
    for ((name, _), CameraImages { files, histograms }) in settings.cameras().zip(episode.images) {
        stats.insert(name.clone(), FeatureStats::of_images(&histograms, n_frames as u64));
        counted.insert(name.clone(), histograms);
        columns.push((name, Cells::Image(files)));
    }
    let timestamps: Vec<f32> = (0..n_frames).map(|frame| frame as f32 / FPS as f32).collect();
    let frames = 0..n_frames as i64;
    let counts = [
        ("frame_index", frames.clone().collect()),
        ("episode_index", vec![episode_idx as i64; n_frames]),
        ("index", frames.map(|frame| first as i64 + frame).collect()),
        ("task_index", vec![task_idx as i64; n_frames]),
    ];
    stats.insert("timestamp".to_owned(), FeatureStats::of_values(&timestamps, 1));
    columns.push(("timestamp".to_owned(), Cells::Float(timestamps)));
    for (name, numbers) in counts {
        let floats: Vec<f32> = numbers.iter().map(|&x| x as f32).collect();
        stats.insert(name.to_owned(), FeatureStats::of_values(&floats, 1));
        columns.push((name.to_owned(), Cells::Int(numbers)));
    }
    let record = EpisodeRecord {
        task: episode.task,
        instruction: episode.instruction,
        index: episode.index,
        n_frames: n_frames as u64,
        fingerprint: format_fingerprint(episode.fingerprint),
        stats,
        histograms: counted,
    };
    (columns, record)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use ipc_types::{ControlMode, Morphology};
    use policy_host::text::hashed;
    use run_config::Protocol;
    use serde_json::Value;
    use sim::Perturbation;
    use sim::Profile;
    use sim::perturb::Strength;

    use super::*;
    use crate::store::demos::ImageFormat;

    /// Frames per episode. Of their sum, every stored quantile is the value of one frame.
    const LENGTHS: [usize; 2] = [60, 141];
    const N_FRAMES: usize = LENGTHS[0] + LENGTHS[1];

    fn open(folder: &Path) -> DatasetWriter {
        let settings = DatasetSettings {
            code: "a".to_owned(),
            morphology: Morphology::Single,
            control_mode: ControlMode::EeDeltaPose,
            perturbation: Perturbation::None.into(),
            strength: Strength::FULL,
            profile: Profile::Strict,
            seed: 1,
            images: ImageFormat::Jpeg,
            shrink: 1,
            protocol: Protocol::default(),
        };
        DatasetWriter::open(folder, settings).unwrap()
    }

    /// Returns an episode whose numbers and images of one pixel have the values `first..` in reverse order.
    fn episode(index: usize) -> DatasetEpisode {
        let first: usize = LENGTHS[..index].iter().sum();
        let values: Vec<u8> = (first..first + LENGTHS[index]).rev().map(|value| value as u8).collect();
        let rows = |width: usize| values.iter().flat_map(|&value| vec![f32::from(value); width]).collect();
        let mut images = CameraImages::default();
        values.iter().for_each(|&value| images.push(&[value; 3], vec![value]));
        let n_cameras = Morphology::Single.camera_names().len();
        DatasetEpisode {
            task: "RaiseCube".to_owned(),
            instruction: "raise the cube".to_owned(),
            index: index as u32,
            fingerprint: 0,
            actions: rows(7),
            states: rows(Morphology::Single.state_dim()),
            images: vec![images; n_cameras],
        }
    }

    fn record(dataset: &mut DatasetWriter, index: usize) {
        dataset.push(episode(index)).unwrap();
        dataset.close_file().unwrap();
    }

    fn stats(folder: &Path) -> Value {
        serde_json::from_slice(&fs::read(folder.join("meta/stats.json")).unwrap()).unwrap()
    }

    #[test]
    fn quantiles_are_those_of_all_frames() {
        let dir = tempfile::tempdir().unwrap();
        let mut dataset = open(dir.path());
        (0..LENGTHS.len()).for_each(|index| record(&mut dataset, index));
        dataset.write_meta().unwrap();
        let stats = stats(dir.path());
        for (name, frame) in [("q01", 2.0), ("q10", 20.0), ("q50", 100.0), ("q90", 180.0), ("q99", 198.0)] {
            for feature in [STATE, ACTION] {
                let found = stats[feature][name].as_array().unwrap();
                assert!(found.iter().all(|value| *value == frame), "{feature} {name}: {found:?}");
            }
            assert_eq!(stats["index"][name][0], frame);
            assert_eq!(stats["observation.images.hand"][name][2][0][0], frame / 255.0, "{name}");
        }
        assert_eq!(stats[LANGUAGE][hashed::STATISTIC], serde_json::json!([1.0]));
        assert_eq!(stats[ACTION]["count"][0], N_FRAMES);
    }

    #[test]
    fn statistics_are_equal_when_episodes_are_appended() {
        let dir = tempfile::tempdir().unwrap();
        let [whole, appended] = ["whole", "appended"].map(|name| dir.path().join(name));
        let mut dataset = open(&whole);
        for index in 0..LENGTHS.len() {
            record(&mut dataset, index);
            let mut dataset = open(&appended);
            record(&mut dataset, index);
            dataset.write_meta().unwrap();
        }
        dataset.write_meta().unwrap();
        let text = |folder: &Path| fs::read_to_string(folder.join("meta/stats.json")).unwrap();
        assert_eq!(text(&whole), text(&appended));
    }

    #[test]
    fn dataset_of_other_code_is_not_continued() {
        let dir = tempfile::tempdir().unwrap();
        let mut dataset = open(dir.path());
        record(&mut dataset, 0);
        let settings = dataset.journal.settings().clone();
        drop(dataset);
        let other = DatasetSettings { code: "b".to_owned(), ..settings };
        let message = DatasetWriter::open(dir.path(), other).err().unwrap().to_string();
        assert!(message.contains("code is \"a\" in the dataset, but \"b\""), "{message}");
        assert_eq!(open(dir.path()).episodes().count(), 1);
    }
}
