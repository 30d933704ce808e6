//! `meta/hypogeum.json`, how a dataset is made, and `meta/hypogeum.jsonl`, a line for each finished data file.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use ipc_types::{ControlMode, Morphology};
use serde::{Deserialize, Serialize};
use sim::Profile;
use sim::perturb::{Composition, Strength};

use super::stats::Stats;
use crate::demos::image::ImageFormat;

pub(super) const SETTINGS: &str = "meta/hypogeum.json";
const JOURNAL: &str = "meta/hypogeum.jsonl";

/// What all episodes of a dataset share.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::demos) struct Settings {
    pub(in crate::demos) morphology: Morphology,
    pub(in crate::demos) control_mode: ControlMode,
    pub(in crate::demos) perturbation: Composition,
    pub(in crate::demos) strength: Strength,
    pub(in crate::demos) profile: Profile,
    /// Suite seed.
    pub(in crate::demos) seed: u64,
    pub(in crate::demos) images: ImageFormat,
}

/// What is remembered of an episode.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::demos) struct EpisodeRecord {
    pub(in crate::demos) task: String,
    pub(in crate::demos) instruction: String,
    /// Index of the episode under the suite seed.
    pub(in crate::demos) index: u32,
    pub(in crate::demos) n_frames: u64,
    /// Hexadecimal.
    pub(in crate::demos) fingerprint: String,
    /// By feature.
    pub(super) stats: BTreeMap<String, Stats>,
}

/// The finished files.
pub(super) struct Journal {
    settings: Settings,
    /// The episodes of each file.
    files: Vec<Vec<EpisodeRecord>>,
    path: PathBuf,
    lines: File,
}

impl Journal {
    /// Reads the journal in `folder`, or begins one.
    ///
    /// # Errors
    /// If it was begun with other settings, or cannot be read.
    pub(super) fn open(folder: &Path, settings: Settings) -> anyhow::Result<Self> {
        let said = folder.join(SETTINGS);
        match read_settings(folder)? {
            Some(found) => agree(&said, &found, &settings)?,
            None => {
                if folder.exists() && folder.read_dir()?.next().is_some() {
                    bail!("{} is not empty, and holds no dataset that `demos` made", folder.display());
                }
                std::fs::create_dir_all(folder.join("meta"))
                    .with_context(|| format!("failed to make {}", folder.display()))?;
                std::fs::write(&said, format!("{:#}\n", serde_json::to_value(settings)?))
                    .with_context(|| format!("failed to write {}", said.display()))?;
            }
        }
        let path = folder.join(JOURNAL);
        let lines = OpenOptions::new().append(true).create(true).open(&path);
        let lines = lines.with_context(|| format!("failed to open {}", path.display()))?;
        lines.try_lock().with_context(|| format!("another process is adding to {}", folder.display()))?;
        mend(&path)?;
        let files = read_journal(folder)?;
        Ok(Self { settings, files, path, lines })
    }

    pub(super) fn settings(&self) -> &Settings {
        &self.settings
    }

    pub(super) fn n_files(&self) -> usize {
        self.files.len()
    }

    /// The episodes of each file.
    pub(super) fn files(&self) -> &[Vec<EpisodeRecord>] {
        &self.files
    }

    pub(super) fn episodes(&self) -> impl Iterator<Item = &EpisodeRecord> + Clone {
        self.files.iter().flatten()
    }

    /// Notes the episodes of the next file, which is finished.
    pub(super) fn push(&mut self, episodes: Vec<EpisodeRecord>) -> anyhow::Result<()> {
        let mut line = serde_json::to_vec(&episodes)?;
        line.push(b'\n');
        let written = self.lines.write_all(&line).and_then(|()| self.lines.sync_data());
        written.with_context(|| format!("failed to write {}", self.path.display()))?;
        self.files.push(episodes);
        Ok(())
    }
}

/// How the dataset in `folder` is made; nothing if there is none.
pub(super) fn read_settings(folder: &Path) -> anyhow::Result<Option<Settings>> {
    let path = folder.join(SETTINGS);
    match std::fs::read(&path) {
        Ok(text) => serde_json::from_slice(&text)
            .map(Some)
            .with_context(|| format!("{} is not what `demos` writes", path.display())),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| format!("failed to read {}", path.display())),
    }
}

/// The episodes of each file; a last line that was cut short does not count.
pub(super) fn read_journal(folder: &Path) -> anyhow::Result<Vec<Vec<EpisodeRecord>>> {
    let path = folder.join(JOURNAL);
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error).with_context(|| format!("failed to read {}", path.display())),
    };
    let line = |(idx, line): (usize, &str)| {
        serde_json::from_str(line).with_context(|| format!("{} line {} is damaged", path.display(), idx + 1))
    };
    text[..whole(text.as_bytes())].lines().enumerate().map(line).collect()
}

/// Takes away a last line that was cut short: its file is made again.
fn mend(path: &Path) -> anyhow::Result<()> {
    match std::fs::read(path) {
        Ok(text) if whole(&text) < text.len() => {
            let file = OpenOptions::new().write(true).open(path)?;
            file.set_len(whole(&text) as u64).with_context(|| format!("failed to mend {}", path.display()))
        }
        _ => Ok(()),
    }
}

/// Length of the lines that end.
fn whole(text: &[u8]) -> usize {
    text.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1)
}

/// # Errors
/// The first setting that differs.
fn agree(path: &Path, found: &Settings, wanted: &Settings) -> anyhow::Result<()> {
    let fields = |settings: &Settings| -> anyhow::Result<serde_json::Map<String, serde_json::Value>> {
        Ok(serde_json::to_value(settings)?.as_object().cloned().unwrap_or_default())
    };
    let (found, wanted) = (fields(found)?, fields(wanted)?);
    for (name, value) in wanted {
        let there = &found[&name];
        if *there != value {
            bail!(
                "{} has demonstrations with {name} {there}, asked for are some with {value}",
                path.display()
            );
        }
    }
    Ok(())
}
