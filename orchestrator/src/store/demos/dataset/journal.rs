//! `meta/hypogeum.json`, the settings of a dataset, and `meta/hypogeum.jsonl`, one line per finished data
//! file.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde::{Deserialize, Serialize};

use crate::store::demos::dataset::settings::DatasetSettings;
use crate::store::demos::dataset::stats::{FeatureStats, Histogram};

pub(crate) const SETTINGS: &str = "meta/hypogeum.json";
const JOURNAL: &str = "meta/hypogeum.jsonl";

/// The journal record of an episode.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct EpisodeRecord {
    pub(crate) task: String,
    pub(crate) instruction: String,
    /// Index of the episode under the suite seed.
    pub(crate) index: u32,
    pub(crate) n_frames: u64,
    /// Fingerprint of the trajectory, 16 hexadecimal digits.
    pub(crate) fingerprint: String,
    /// Statistics by feature.
    pub(crate) stats: BTreeMap<String, FeatureStats>,
    /// Histograms of image channels by feature. Journals of earlier versions have none.
    #[serde(default)]
    pub(crate) histograms: BTreeMap<String, [Histogram; 3]>,
}

/// The journal of finished data files.
pub(crate) struct Journal {
    settings: DatasetSettings,
    /// The episodes of each file.
    files: Vec<Vec<EpisodeRecord>>,
    path: PathBuf,
    lines: File,
}

impl Journal {
    /// Opens the journal in `folder`, or creates one.
    ///
    /// # Errors
    /// If it has other settings, cannot be read, or is in use.
    pub(crate) fn open(folder: &Path, settings: DatasetSettings) -> anyhow::Result<Self> {
        let settings_path = folder.join(SETTINGS);
        match read_settings(folder)? {
            Some(found) => check_same_settings(&settings_path, &found, &settings)?,
            None => {
                if folder.exists() && folder.read_dir()?.next().is_some() {
                    bail!("{} is not empty and contains no dataset of `demos`", folder.display());
                }
                std::fs::create_dir_all(folder.join("meta"))
                    .with_context(|| format!("failed to create {}", folder.display()))?;
                std::fs::write(&settings_path, format!("{:#}\n", serde_json::to_value(&settings)?))
                    .with_context(|| format!("failed to write {}", settings_path.display()))?;
            }
        }
        let path = folder.join(JOURNAL);
        let lines = OpenOptions::new().append(true).create(true).open(&path);
        let lines = lines.with_context(|| format!("failed to open {}", path.display()))?;
        lines.try_lock().with_context(|| format!("another process is writing to {}", folder.display()))?;
        truncate_partial_line(&path)?;
        let files = read_journal(folder)?;
        Ok(Self { settings, files, path, lines })
    }

    pub(crate) fn settings(&self) -> &DatasetSettings {
        &self.settings
    }

    pub(crate) fn n_files(&self) -> usize {
        self.files.len()
    }

    /// The episodes of each file.
    pub(crate) fn files(&self) -> &[Vec<EpisodeRecord>] {
        &self.files
    }

    pub(crate) fn episodes(&self) -> impl Iterator<Item = &EpisodeRecord> + Clone {
        self.files.iter().flatten()
    }

    /// Adds the episodes of the next finished file.
    pub(crate) fn push(&mut self, episodes: Vec<EpisodeRecord>) -> anyhow::Result<()> {
        let mut line = serde_json::to_vec(&episodes)?;
        line.push(b'\n');
        let written = self.lines.write_all(&line).and_then(|()| self.lines.sync_data());
        written.with_context(|| format!("failed to write {}", self.path.display()))?;
        self.files.push(episodes);
        Ok(())
    }
}

/// Reads the settings of the dataset in `folder`. Returns `None` if there is no dataset.
pub(crate) fn read_settings(folder: &Path) -> anyhow::Result<Option<DatasetSettings>> {
    let path = folder.join(SETTINGS);
    match std::fs::read(&path) {
        Ok(text) => serde_json::from_slice(&text)
            .map(Some)
            .with_context(|| format!("{} was not written by `demos`", path.display())),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| format!("failed to read {}", path.display())),
    }
}

/// Reads the episodes of each file. An incomplete last line is ignored.
pub(crate) fn read_journal(folder: &Path) -> anyhow::Result<Vec<Vec<EpisodeRecord>>> {
    let path = folder.join(JOURNAL);
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error).with_context(|| format!("failed to read {}", path.display())),
    };
    let line = |(idx, line): (usize, &str)| {
        serde_json::from_str(line).with_context(|| format!("{} line {} is damaged", path.display(), idx + 1))
    };
    text[..complete_len(text.as_bytes())].lines().enumerate().map(line).collect()
}

/// Truncates an incomplete last line. Its data file will be written again.
fn truncate_partial_line(path: &Path) -> anyhow::Result<()> {
    match std::fs::read(path) {
        Ok(text) if complete_len(&text) < text.len() => {
            let file = OpenOptions::new().write(true).open(path)?;
            file.set_len(complete_len(&text) as u64)
                .with_context(|| format!("failed to truncate {}", path.display()))
        }
        _ => Ok(()),
    }
}

/// Returns the length of the complete lines.
fn complete_len(text: &[u8]) -> usize {
    text.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1)
}

/// Checks that both settings are equal.
///
/// # Errors
/// If a setting differs; the message names it.
fn check_same_settings(path: &Path, found: &DatasetSettings, wanted: &DatasetSettings) -> anyhow::Result<()> {
    let fields = |settings: &DatasetSettings| -> anyhow::Result<serde_json::Map<String, serde_json::Value>> {
        Ok(serde_json::to_value(settings)?.as_object().cloned().unwrap_or_default())
    };
    let (found, wanted) = (fields(found)?, fields(wanted)?);
    for (name, value) in wanted {
        let found = &found[&name];
        if *found != value {
            let name = if name == "code" { "the hash of the program's code" } else { &name };
            bail!(
                "{}: {name} is {found} in the dataset, but {value} in this command; use the same value or another folder",
                path.display()
            );
        }
    }
    Ok(())
}

/// Returns the distinct instructions in the order of their first episodes.
pub(crate) fn instructions<'a>(episodes: impl Iterator<Item = &'a EpisodeRecord>) -> Vec<&'a str> {
    let mut distinct: Vec<&str> = Vec::new();
    for episode in episodes {
        if !distinct.contains(&episode.instruction.as_str()) {
            distinct.push(&episode.instruction);
        }
    }
    distinct
}
