//! Reading back what replays need: the settings, the journal, and an episode's action rows.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use parquet::column::reader::get_typed_column_reader;
use parquet::data_type::FloatType;
use parquet::file::reader::{FileReader, SerializedFileReader};

use super::journal::{EpisodeRecord, Settings, read_journal, read_settings};
use super::{ACTION, meta};

/// A finished dataset, or what there is of it.
pub(in crate::demos) struct Stored {
    folder: PathBuf,
    settings: Settings,
    /// By index of the episode: its file, its place in it, and what is remembered of it.
    episodes: Vec<(usize, usize, EpisodeRecord)>,
}

impl Stored {
    /// Opens the dataset in this folder.
    ///
    /// # Errors
    /// If it is none that `demos` made.
    pub(in crate::demos) fn open(folder: &Path) -> anyhow::Result<Self> {
        let Some(settings) = read_settings(folder)? else {
            bail!(
                "{} holds no dataset that `demos` made (no {})",
                folder.display(),
                super::journal::SETTINGS
            );
        };
        let files = read_journal(folder)?.into_iter().enumerate();
        let episodes = files.flat_map(|(file, episodes)| {
            episodes.into_iter().enumerate().map(move |(place, episode)| (file, place, episode))
        });
        Ok(Self { folder: folder.to_owned(), settings, episodes: episodes.collect() })
    }

    pub(in crate::demos) fn settings(&self) -> &Settings {
        &self.settings
    }

    pub(in crate::demos) fn n_episodes(&self) -> usize {
        self.episodes.len()
    }

    /// What is remembered of an episode.
    pub(in crate::demos) fn record(&self, episode_idx: usize) -> &EpisodeRecord {
        &self.episodes[episode_idx].2
    }

    /// An episode's action rows `[n_frames, action_dim]`.
    ///
    /// # Errors
    /// If they cannot be read, or are not as many as the episode has frames.
    pub(in crate::demos) fn actions(&self, episode_idx: usize) -> anyhow::Result<Vec<f32>> {
        let (file, place, record) = &self.episodes[episode_idx];
        let path = self.folder.join(meta::data_path(*file));
        let expected =
            record.n_frames as usize * self.settings.control_mode.action_dim(self.settings.morphology);
        let actions = actions(&path, *place, expected);
        let actions =
            actions.with_context(|| format!("failed to read episode {episode_idx} in {}", path.display()))?;
        let found = actions.len();
        ensure!(
            found == expected,
            "{}: episode {episode_idx} has {found} numbers in `{ACTION}`, expected {expected}",
            path.display()
        );
        Ok(actions)
    }
}

fn actions(path: &Path, place: usize, expected: usize) -> anyhow::Result<Vec<f32>> {
    let reader = SerializedFileReader::new(File::open(path)?)?;
    ensure!(
        place < reader.num_row_groups(),
        "it has {} row groups, expected more than {place}",
        reader.num_row_groups()
    );
    let group = reader.get_row_group(place)?;
    let mut columns = group.metadata().columns().iter();
    let is_action = |parts: &[String]| parts.first().is_some_and(|first| first == ACTION);
    let idx = columns.position(|column| is_action(column.column_path().parts()));
    let mut column =
        get_typed_column_reader::<FloatType>(group.get_column_reader(idx.context("it has no `action`")?)?);
    let (mut numbers, mut definitions, mut repeats) = (Vec::new(), Vec::new(), Vec::new());
    loop {
        let before = numbers.len();
        column.read_records(expected, Some(&mut definitions), Some(&mut repeats), &mut numbers)?;
        if numbers.len() == before {
            return Ok(numbers);
        }
    }
}
