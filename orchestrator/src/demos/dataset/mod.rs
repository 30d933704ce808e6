//! A folder of demonstrations in LeRobot's dataset format v3, with what it takes to go on with it and to replay it.
//!
//! Frames lie in Parquet files of some episodes each. A file counts once `meta/hypogeum.jsonl` names it: what was cut short is
//! made again, so that an interrupted dataset ends up with the same bytes as one made at a stretch. All else in `meta/` is
//! written from that journal.

mod column;
mod journal;
mod meta;
mod read;
mod stats;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use ipc_types::Morphology;
use policy_host::text::hashed_embedding;

use self::column::{Cells, Column, Table};
use self::journal::Journal;
use self::stats::{Histogram, Stats};

pub(super) use self::journal::{EpisodeRecord, Settings};
pub(crate) use self::read::Stored;

/// Frames per second.
const FPS: u32 = 20;
/// Width of the instruction's embedding.
const LANGUAGE_DIM: usize = 64;
/// A data file is closed when it has as many bytes of images.
const FILE_BYTES: usize = 32 << 20;

const STATE: &str = "observation.state";
const LANGUAGE: &str = "observation.environment_state";
const ACTION: &str = "action";

/// A dataset that grows.
pub(super) struct Dataset {
    folder: PathBuf,
    journal: Journal,
    /// The file that is being written, which the journal does not know yet.
    open: Option<OpenFile>,
}

struct OpenFile {
    table: Table,
    /// Its name as long as it is open, which no reader of datasets takes for data.
    draft: PathBuf,
    /// Its name.
    path: PathBuf,
    episodes: Vec<EpisodeRecord>,
    n_bytes: usize,
}

/// An episode to be added.
pub(super) struct Episode {
    pub(super) task: String,
    pub(super) instruction: String,
    /// Index of the episode under the suite seed.
    pub(super) index: u32,
    pub(super) fingerprint: u64,
    /// `[n_frames, action_dim]`.
    pub(super) actions: Vec<f32>,
    /// `[n_frames, state_dim]`.
    pub(super) states: Vec<f32>,
    pub(super) images: Vec<Images>,
}

/// One camera's images.
#[derive(Default)]
pub(super) struct Images {
    /// Encoded.
    files: Vec<Vec<u8>>,
    histograms: [Histogram; 3],
}

impl Images {
    /// Adds an image `[side, side, 3]` and the file it is kept as.
    pub(super) fn push(&mut self, pixels: &[u8], file: Vec<u8>) {
        Histogram::count(&mut self.histograms, pixels);
        self.files.push(file);
    }
}

impl Dataset {
    /// Opens the dataset in this folder, or begins one.
    ///
    /// # Errors
    /// If what is there was made with other settings, or is no dataset of ours.
    pub(super) fn open(folder: &Path, settings: Settings) -> anyhow::Result<Self> {
        let journal = Journal::open(folder, settings)?;
        Ok(Self { folder: folder.to_owned(), journal, open: None })
    }

    /// Demonstrations of a task, and the first episode that has not been tried for it.
    pub(super) fn progress(&self, task: &str) -> (u32, u32) {
        let of_task = || self.episodes().filter(|episode| episode.task == task);
        (of_task().count() as u32, of_task().map(|episode| episode.index + 1).max().unwrap_or(0))
    }

    /// All episodes, those of the open file included.
    pub(super) fn episodes(&self) -> impl Iterator<Item = &EpisodeRecord> {
        self.journal.episodes().chain(self.open.iter().flat_map(|open| &open.episodes))
    }

    /// Frames in all.
    pub(super) fn n_frames(&self) -> u64 {
        self.episodes().map(|episode| episode.n_frames).sum()
    }

    /// Adds an episode.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn push(&mut self, episode: Episode) -> anyhow::Result<()> {
        let (first, episode_idx) = (self.n_frames(), self.episodes().count() as u64);
        let task_idx = self.task_idx(&episode.instruction);
        let morphology = self.journal.settings().morphology;
        let n_bytes: usize = episode.images.iter().flat_map(|images| &images.files).map(Vec::len).sum();
        let (columns, record) = columns(morphology, episode, (episode_idx, first, task_idx));
        let open = match &mut self.open {
            Some(open) => open,
            none => {
                let path = self.folder.join(meta::data_path(self.journal.n_files()));
                std::fs::create_dir_all(path.parent().unwrap_or(&self.folder))
                    .with_context(|| format!("failed to make the folder of {}", path.display()))?;
                let note = ("huggingface", meta::hugging_face_note(morphology));
                let draft = path.with_extension("draft");
                let table = Table::create(&draft, &columns, Some(note))?;
                none.insert(OpenFile { table, draft, path, episodes: Vec::new(), n_bytes: 0 })
            }
        };
        open.table.push(columns).with_context(|| format!("failed to write {}", open.path.display()))?;
        open.episodes.push(record);
        open.n_bytes += n_bytes;
        if open.n_bytes >= FILE_BYTES { self.close_file() } else { Ok(()) }
    }

    /// Closes the file at hand: its episodes count from now on.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn close_file(&mut self) -> anyhow::Result<()> {
        let Some(OpenFile { table, draft, path, episodes, .. }) = self.open.take() else { return Ok(()) };
        let written = table.finish().and_then(|()| Ok(std::fs::rename(&draft, &path)?));
        written.with_context(|| format!("failed to write {}", path.display()))?;
        self.journal.push(episodes)
    }

    /// Forgets the file at hand, and writes what readers need to know of the others.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn write_meta(&mut self) -> anyhow::Result<()> {
        if let Some(open) = self.open.take() {
            std::fs::remove_file(&open.draft)
                .with_context(|| format!("failed to remove {}", open.draft.display()))?;
        }
        meta::write(&self.folder, &self.journal)
    }

    /// Index of an instruction: LeRobot's tasks are what is said.
    fn task_idx(&self, instruction: &str) -> usize {
        let said = instructions(self.episodes());
        said.iter().position(|known| *known == instruction).unwrap_or(said.len())
    }
}

/// Each instruction once, in the order of their first episodes.
fn instructions<'a>(episodes: impl Iterator<Item = &'a EpisodeRecord>) -> Vec<&'a str> {
    let mut said: Vec<&str> = Vec::new();
    for episode in episodes {
        if !said.contains(&episode.instruction.as_str()) {
            said.push(&episode.instruction);
        }
    }
    said
}

/// A camera's feature.
fn camera_feature(camera: &str) -> String {
    format!("observation.images.{}", camera.strip_suffix("_camera").unwrap_or(camera))
}

/// An episode's rows, and what is remembered of it.
fn columns(
    morphology: Morphology,
    episode: Episode,
    (episode_idx, first, task_idx): (u64, u64, usize),
) -> (Vec<Column>, EpisodeRecord) {
    let state_dim = morphology.state_dim();
    let n_frames = episode.states.len() / state_dim;
    let action_dim = episode.actions.len() / n_frames;
    let embedding = hashed_embedding(&episode.instruction, LANGUAGE_DIM);
    let numbers = [
        (STATE, state_dim, episode.states),
        (LANGUAGE, LANGUAGE_DIM, embedding.repeat(n_frames)),
        (ACTION, action_dim, episode.actions),
    ];
    let mut stats = BTreeMap::new();
    let mut columns: Vec<Column> = Vec::new();
    for (name, width, numbers) in numbers {
        stats.insert(name.to_owned(), Stats::of_numbers(&numbers, width));
        columns.push((name.to_owned(), Cells::FloatList { width, numbers }));
    }
    for (camera, Images { files, histograms }) in morphology.camera_names().iter().zip(episode.images) {
        let name = camera_feature(camera);
        stats.insert(name.clone(), Stats::of_colors(&histograms, n_frames as u64));
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
    stats.insert("timestamp".to_owned(), Stats::of_numbers(&timestamps, 1));
    columns.push(("timestamp".to_owned(), Cells::Float(timestamps)));
    for (name, numbers) in counts {
        let floats: Vec<f32> = numbers.iter().map(|&x| x as f32).collect();
        stats.insert(name.to_owned(), Stats::of_numbers(&floats, 1));
        columns.push((name.to_owned(), Cells::Int(numbers)));
    }
    let record = EpisodeRecord {
        task: episode.task,
        instruction: episode.instruction,
        index: episode.index,
        n_frames: n_frames as u64,
        fingerprint: crate::replay::shown(episode.fingerprint),
        stats,
    };
    (columns, record)
}
