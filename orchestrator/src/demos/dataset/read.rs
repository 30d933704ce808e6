//! Reading back what replays need: the settings, the journal, and an episode's action rows.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use parquet::column::reader::get_typed_column_reader;
use parquet::data_type::FloatType;
use parquet::file::reader::{FileReader, SerializedFileReader};
use policy_host::PolicySpec;
use sim::TaskId;
use sim::show::EpisodeSpec;
use sim::stream::episode_seed;

use super::journal::{Settings, read_journal, read_settings};
use super::{ACTION, meta};
use crate::names::pick;
use crate::replay::StoredEpisode;

/// A finished dataset, or what there is of it.
pub(crate) struct Stored {
    folder: PathBuf,
    episodes: Vec<StoredEpisode>,
    /// By episode: its file, and its place in it.
    places: Vec<(usize, usize)>,
}

impl Stored {
    /// Opens the dataset in this folder.
    ///
    /// # Errors
    /// If it is none that `demos` made.
    pub(crate) fn open(folder: &Path) -> anyhow::Result<Self> {
        let Some(settings) = read_settings(folder)? else {
            bail!(
                "{} holds no dataset that `demos` made (no {})",
                folder.display(),
                super::journal::SETTINGS
            );
        };
        let Settings { perturbation, strength, profile, control_mode: mode, seed, .. } = settings;
        let (mut episodes, mut places) = (Vec::new(), Vec::new());
        for (file, records) in read_journal(folder)?.into_iter().enumerate() {
            for (place, record) in records.into_iter().enumerate() {
                let task = pick("task", &record.task, TaskId::ALL, TaskId::name)?;
                places.push((file, place));
                episodes.push(StoredEpisode {
                    policy: PolicySpec::Expert.kind().to_owned(),
                    subject: EpisodeSpec { task, perturbation, strength, profile },
                    index: record.index,
                    seed: episode_seed(seed, task.name(), record.index),
                    mode,
                    n_steps: record.n_frames as u32,
                    fingerprint: record.fingerprint,
                });
            }
        }
        Ok(Self { folder: folder.to_owned(), episodes, places })
    }

    pub(crate) fn episodes(&self) -> &[StoredEpisode] {
        &self.episodes
    }

    /// An episode's action rows `[n_steps, action_dim]`.
    ///
    /// # Errors
    /// If they cannot be read, or are not as many as the episode has frames.
    pub(crate) fn actions(&self, episode_idx: usize) -> anyhow::Result<Vec<f32>> {
        let (file, place) = self.places[episode_idx];
        let path = self.folder.join(meta::data_path(file));
        let expected = self.episodes[episode_idx].n_numbers();
        let actions = actions(&path, place, expected);
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
