//! Reading of datasets for replays: the settings, the journal and action rows.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use policy_host::PolicySpec;
use sim::episode::EpisodeSpec;
use sim::scene::stream::episode_seed;

use crate::selection::selectors::parse_task;
use crate::store::demos::dataset::features::ACTION;
use crate::store::demos::dataset::journal::{read_journal, read_settings};
use crate::store::demos::dataset::meta;
use crate::store::demos::dataset::settings::DatasetSettings;
use crate::store::demos::dataset::values::read_values;
use crate::store::stored_episode::StoredEpisode;

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
            bail!(
                "{} contains no dataset of `demos` (no {})",
                folder.display(),
                crate::store::demos::dataset::journal::SETTINGS
            );
        };
        let DatasetSettings { perturbation, strength, profile, control_mode: mode, seed, protocol, .. } =
            settings;
        let (mut episodes, mut locations) = (Vec::new(), Vec::new());
        for (file, records) in read_journal(folder)?.into_iter().enumerate() {
            for (group_idx, record) in records.into_iter().enumerate() {
                let task = parse_task(&record.task)?;
                locations.push((file, group_idx));
                episodes.push(StoredEpisode {
                    policy: PolicySpec::Expert.kind(),
                    subject: EpisodeSpec { task, perturbation, strength, profile },
                    index: record.index,
                    seed: episode_seed(seed, task.name(), record.index),
                    mode,
                    images: protocol.image_size,
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
