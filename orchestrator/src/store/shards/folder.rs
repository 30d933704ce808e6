//! The folder of the shards of a sweep, beside the results file into which they are merged.

use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::plan::partition::SweepShard;

/// Name of the file that says what all shards must agree on.
const SWEEP: &str = "sweep.json";

/// A folder with the shards of one sweep.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ShardsFolder {
    path: PathBuf,
}

impl ShardsFolder {
    /// Returns the folder of a sweep with this results file: `results.shards` for `results.db`.
    pub(crate) fn beside(db: &Path) -> Self {
        Self { path: db.with_extension("shards") }
    }

    /// Returns a folder that a user has named.
    pub(crate) fn at(path: &Path) -> Self {
        Self { path: path.into() }
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the path of the file that says what all shards must agree on.
    pub(crate) fn sweep(&self) -> PathBuf {
        self.path.join(SWEEP)
    }

    /// Returns the path of a shard's results file.
    pub(crate) fn results(&self, shard: SweepShard) -> PathBuf {
        self.path.join(format!("{}.db", file_stem(shard)))
    }

    /// Returns the path of a shard's state.
    pub(crate) fn state(&self, shard: SweepShard) -> PathBuf {
        self.path.join(format!("{}.json", file_stem(shard)))
    }

    /// Returns the results files of the shards that have one, sorted by name.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub(crate) fn all_results(&self) -> io::Result<Vec<PathBuf>> {
        let mut files = Vec::new();
        for entry in std::fs::read_dir(&self.path)? {
            let path = entry?.path();
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            if name.starts_with("shard-") && name.ends_with(".db") {
                files.push(path);
            }
        }
        files.sort();
        Ok(files)
    }
}

/// Returns the results files that a user means by these paths: a folder stands for the shards in it.
///
/// # Errors
/// If a folder cannot be read or has no results of shards.
pub(crate) fn results_files(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let shown = path.display();
        let shards = ShardsFolder::at(path)
            .all_results()
            .with_context(|| format!("failed to read the folder {shown}"))?;
        if shards.is_empty() {
            bail!(
                "{shown} has no results of shards (shard-I-of-N.db); `hypogeum status {shown}` says how far they are"
            );
        }
        files.extend(shards);
    }
    Ok(files)
}

/// Returns the name of a shard's files without their extension, so that names sort like shards.
pub(crate) fn file_stem(shard: SweepShard) -> String {
    let digits = (shard.count - 1).to_string().len();
    format!("shard-{:0digits$}-of-{}", shard.index, shard.count)
}
