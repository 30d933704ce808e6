//! Reading of datasets: the settings, the journal and action rows for replays, the values of a feature for
//! statistics.

use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use parquet::basic::Type as Physical;
use parquet::column::reader::{ColumnReader, get_typed_column_reader};
use parquet::data_type::{DataType, FloatType, Int64Type};
use parquet::file::reader::{FileReader, SerializedFileReader};
use policy_host::PolicySpec;
use sim::scene::stream::episode_seed;
use sim::show::EpisodeSpec;

use super::journal::{DatasetSettings, read_journal, read_settings};
use super::{ACTION, meta};
use crate::selection::parse_task;
use crate::stored_episode::StoredEpisode;

/// Rows that are decoded at a time.
const RECORDS_PER_READ: usize = 1024;

/// A dataset to read, which may still be growing.
pub(crate) struct StoredDataset {
    folder: PathBuf,
    episodes: Vec<StoredEpisode>,
    /// By episode: the index of its file and of its row group there.
    locations: Vec<(usize, usize)>,
}

impl StoredDataset {
    /// Opens the dataset in `folder`.
    ///
    /// # Errors
    /// If the folder contains no dataset of `demos`.
    pub(crate) fn open(folder: &Path) -> anyhow::Result<Self> {
        let Some(settings) = read_settings(folder)? else {
            bail!("{} contains no dataset of `demos` (no {})", folder.display(), super::journal::SETTINGS);
        };
        let DatasetSettings { perturbation, strength, profile, control_mode: mode, seed, .. } = settings;
        let (mut episodes, mut locations) = (Vec::new(), Vec::new());
        for (file, records) in read_journal(folder)?.into_iter().enumerate() {
            for (group_idx, record) in records.into_iter().enumerate() {
                let task = parse_task(&record.task)?;
                locations.push((file, group_idx));
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
        Ok(Self { folder: folder.to_owned(), episodes, locations })
    }

    pub(crate) fn episodes(&self) -> &[StoredEpisode] {
        &self.episodes
    }

    /// Reads the action rows `[n_steps, action_dim]` of an episode.
    ///
    /// # Errors
    /// If they cannot be read, or their number differs from the number of frames.
    pub(crate) fn actions(&self, episode_idx: usize) -> anyhow::Result<Vec<f32>> {
        let (file, group_idx) = self.locations[episode_idx];
        let path = self.folder.join(meta::data_path(file));
        let expected = self.episodes[episode_idx].n_action_values();
        let actions = read_values(&path, group_idx..group_idx + 1, ACTION);
        let actions =
            actions.with_context(|| format!("failed to read episode {episode_idx} in {}", path.display()))?;
        let found = actions.len();
        ensure!(
            found == expected,
            "{}: episode {episode_idx} has {found} values in `{ACTION}`, expected {expected}",
            path.display()
        );
        Ok(actions)
    }
}

/// Reads the values of a feature in some row groups of a data file.
///
/// # Errors
/// If the file has no such rows, or no numbers of that name.
pub(crate) fn read_values(path: &Path, groups: Range<usize>, feature: &str) -> anyhow::Result<Vec<f32>> {
    let reader = SerializedFileReader::new(File::open(path)?)?;
    let n_groups = reader.num_row_groups();
    ensure!(groups.end <= n_groups, "it has {n_groups} row groups, expected at least {}", groups.end);
    let mut values = Vec::new();
    for group_idx in groups {
        let group = reader.get_row_group(group_idx)?;
        let columns = group.metadata().columns();
        let is_wanted = |parts: &[String]| parts.first().is_some_and(|first| first == feature);
        let idx = columns.iter().position(|column| is_wanted(column.column_path().parts()));
        let idx = idx.with_context(|| format!("it has no `{feature}`"))?;
        let column = group.get_column_reader(idx)?;
        match columns[idx].column_type() {
            Physical::FLOAT => values.extend(read_column::<FloatType>(column)?),
            Physical::INT64 => values.extend(read_column::<Int64Type>(column)?.iter().map(|&x| x as f32)),
            other => bail!("`{feature}` has the type {other}, expected FLOAT or INT64"),
        }
    }
    Ok(values)
}

fn read_column<T: DataType>(column: ColumnReader) -> anyhow::Result<Vec<T::T>> {
    let mut column = get_typed_column_reader::<T>(column);
    let (mut values, mut definitions, mut repeats) = (Vec::new(), Vec::new(), Vec::new());
    loop {
        let before = values.len();
        column.read_records(RECORDS_PER_READ, Some(&mut definitions), Some(&mut repeats), &mut values)?;
        if values.len() == before {
            return Ok(values);
        }
    }
}
