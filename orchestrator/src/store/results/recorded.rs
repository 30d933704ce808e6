//! Reading of a results file for replays: episodes whose actions were recorded.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context, bail, ensure};
use ipc_types::{ControlMode, ImageSizes};
use policy_host::PolicySpec;
use rusqlite::{Connection, params};
use serde::de::DeserializeOwned;
use sim::episode::EpisodeSpec;
use sim::perturb::{Composition, Strength};
use sim::{Profile, expert};

use crate::selection::names::pick;
use crate::selection::policy::Identity;
use crate::selection::selectors::{parse_perturbation, parse_task};
use crate::store::results::columns::Column;
use crate::store::results::{integrity, manifest, open, schema};
use crate::store::stored_episode::StoredEpisode;

/// The episodes of a results file whose actions were recorded.
#[derive(Debug)]
pub(crate) struct RecordedEpisodes {
    path: PathBuf,
    connection: Mutex<Connection>,
    episodes: Vec<StoredEpisode>,
}

impl RecordedEpisodes {
    /// Opens a results file for reading.
    ///
    /// # Errors
    /// If it is not a results file, or has no recorded actions.
    pub(crate) fn open(path: &Path) -> anyhow::Result<Self> {
        let connection = open::open_read_only(path)?;
        let episodes = read_episodes(&connection)
            .with_context(|| format!("failed to read the results file {}", path.display()))?;
        ensure!(
            !episodes.is_empty(),
            "{} has no recorded actions: it was made with --keep-actions=false, or by an early version",
            path.display()
        );
        Ok(Self { path: path.to_owned(), connection: Mutex::new(connection), episodes })
    }

    pub(crate) fn episodes(&self) -> &[StoredEpisode] {
        &self.episodes
    }

    /// Reads the action rows `[n_steps, action_dim]` of an episode.
    ///
    /// # Errors
    /// If they cannot be read, or their number differs from the number of steps.
    pub(crate) fn actions(&self, episode_idx: usize) -> anyhow::Result<Vec<f32>> {
        let episode = &self.episodes[episode_idx];
        let StoredEpisode { policy, subject, index, .. } = episode;
        let key = params![policy, subject.task.name(), subject.perturbation.name(), index];
        let connection = self.connection.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let sealed: Vec<u8> = connection
            .query_row(&schema::actions(), key, |row| row.get(0))
            .with_context(|| format!("failed to read {} in {}", episode.name(), self.path.display()))?;
        let bytes = integrity::opened_actions(&sealed, episode.seed).with_context(|| {
            format!(
                "{}: the checksum of the stored actions of {} does not fit them, so that they have been changed",
                self.path.display(),
                episode.name()
            )
        })?;
        let (numbers, rest) = bytes.as_chunks::<4>();
        let (found, expected) = (numbers.len(), episode.n_action_values());
        ensure!(
            found == expected && rest.is_empty(),
            "{}: {} has {found} values in `actions`, expected {expected}",
            self.path.display(),
            episode.name()
        );
        Ok(numbers.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
    }
}

fn read_episodes(connection: &Connection) -> anyhow::Result<Vec<StoredEpisode>> {
    let profile: Profile = entry(connection, "profile")?;
    let strength: Strength = entry(connection, "strength")?;
    let single_arm_mode: String = entry(connection, "control_mode")?;
    let single_arm_mode = pick("control mode", &single_arm_mode, &ControlMode::ALL, ControlMode::name)?;
    let images = manifest::get(connection, "image_size")?;
    let images = images.map_or(Ok(ImageSizes::BENCHMARK), |text| serde_json::from_str(&text));
    let images = images.context("its manifest has no valid image_size")?;
    let mut statement = connection.prepare(&schema::recorded())?;
    let mut rows = statement.query([])?;
    let mut episodes = Vec::new();
    let mut experts: BTreeMap<String, bool> = BTreeMap::new();
    while let Some(row) = rows.next()? {
        let text = |column: Column| row.get::<_, String>(column as usize);
        let [policy, task, perturbation] =
            [text(Column::Policy)?, text(Column::Task)?, text(Column::Perturbation)?];
        let task = parse_task(&task)?;
        let perturbation: Composition = parse_perturbation(&perturbation)?;
        if !experts.contains_key(&policy) {
            let Identity { spec, .. } = entry(connection, &manifest::policy_key(&policy))?;
            experts.insert(policy.clone(), matches!(spec.parse(), Ok(PolicySpec::Expert)));
        }
        let mode = if experts[&policy] {
            expert::CONTROL_MODE
        } else {
            task.task().morphology.control_mode(single_arm_mode)
        };
        episodes.push(StoredEpisode {
            policy,
            subject: EpisodeSpec { task, perturbation, strength, profile },
            index: row.get(Column::Episode as usize)?,
            seed: row.get::<_, i64>(Column::Seed as usize)?.cast_unsigned(),
            mode,
            images,
            n_steps: row.get(Column::Steps as usize)?,
            fingerprint: text(Column::Fingerprint)?,
        });
    }
    Ok(episodes)
}

/// Reads an entry of the manifest.
fn entry<T: DeserializeOwned>(connection: &Connection, key: &str) -> anyhow::Result<T> {
    let Some(text) = manifest::get(connection, key)? else { bail!("its manifest has no {key}") };
    serde_json::from_str(&text).with_context(|| format!("its manifest has no valid {key}"))
}
