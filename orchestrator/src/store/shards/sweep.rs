//! The description of a sweep on which all its shards agree, in a file that the first of them writes: every
//! other compares itself with it before it starts to work.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::Permissions;
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use run_config::input;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use thiserror::Error;

use crate::plan::RunPlan;
use crate::plan::partition::{Cuts, SweepShard};
use crate::run::stopping::StoppingRule;
use crate::selection::policy::Identity;
use crate::store::results::{Manifest, StoredPlan};
use crate::store::shards::folder::ShardsFolder;

/// The content of the file.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct SharedSweep {
    /// Name of the machine that wrote it.
    host: String,
    /// Program and options, by the names of the manifest.
    options: Map<String, Value>,
    policies: BTreeMap<String, Identity>,
    plan: StoredPlan,
    stopping: Option<StoppingRule>,
    pub(crate) cuts: Cuts,
}

/// Reasons why a shard cannot belong to a folder.
#[derive(Debug, Error)]
pub(crate) enum ShardsFolderError {
    #[error(
        "failed to write to the folder of the shards, {}: every node must be able to write there; give --db a path on a \
         shared file system",
        path.display()
    )]
    Folder { path: PathBuf, source: io::Error },
    #[error("failed to read {}; remove it if it is damaged", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error(
        "this is a shard of another sweep than {}, which {host} wrote: {}; use the same command, program and checkpoints \
         on every node, or another --db",
        path.display(), differences.join(", and ")
    )]
    Other { path: PathBuf, host: String, differences: Vec<String> },
    #[error(
        "this node renders with {found}, but {host} with {expected}, and images of different renderers differ in single \
         bits: choose one for all nodes, for example --renderer cpu"
    )]
    Renderer { found: String, expected: String, host: String },
}

impl SharedSweep {
    /// Describes a sweep with this manifest that is cut like this.
    pub(crate) fn new(plan: &RunPlan, manifest: &Manifest, cuts: Cuts, host: &str) -> Self {
        let mut options = match json!(manifest) {
            Value::Object(options) => options,
            _ => Map::new(),
        };
        options.remove("policies");
        // A file counts by its content, not by its path.
        for value in options.values_mut() {
            if let Some(fingerprint) = value.get_mut("fingerprint") {
                *value = fingerprint.take();
            }
        }
        Self {
            host: host.to_owned(),
            options,
            policies: manifest.policies.clone(),
            plan: StoredPlan::new(plan),
            stopping: plan.stopping.clone(),
            cuts,
        }
    }

    /// Returns one clause for each difference between this sweep and one in a file.
    fn differences(&self, file: &Self) -> Vec<String> {
        let mut differences = Vec::new();
        let mut compare = |name: &str, found: String, expected: String| {
            if found != expected {
                differences.push(format!("{name} is {found} here, but {expected} there"));
            }
        };
        let counts = [self, file].map(|sweep| sweep.cuts.first.len());
        compare("the number of shards", counts[0].to_string(), counts[1].to_string());
        let value =
            |sweep: &Self, key: &str| sweep.options.get(key).map_or("not given".to_owned(), Value::to_string);
        let keys: BTreeSet<&String> = self.options.keys().chain(file.options.keys()).collect();
        for key in keys {
            let name = if key == "code" { "the hash of the program's code" } else { key };
            compare(name, value(self, key), value(file, key));
        }
        let names: BTreeSet<&String> = self.policies.keys().chain(file.policies.keys()).collect();
        for name in names {
            let [found, expected] = [self, file].map(|sweep| sweep.policies.get(name));
            if !found.zip(expected).is_some_and(|(found, expected)| found.matches(expected)) {
                let shown = |identity: Option<&Identity>| {
                    identity.map_or("not given".to_owned(), Identity::to_string)
                };
                compare(&format!("policy `{name}`"), shown(found), shown(expected));
            }
        }
        let n_conditions = [self, file].map(|sweep| sweep.plan.conditions.len().to_string());
        let [found, expected] = n_conditions;
        if self.plan.conditions != file.plan.conditions && found == expected {
            compare("the list of conditions", "one".to_owned(), "another".to_owned());
        }
        compare("the number of conditions", found, expected);
        compare("--episodes", self.plan.episodes.to_string(), file.plan.episodes.to_string());
        compare("--until-decided", json!(self.stopping).to_string(), json!(file.stopping).to_string());
        compare("--audit", self.cuts.audit.to_string(), file.cuts.audit.to_string());
        if differences.is_empty() && self.cuts != file.cuts {
            differences.push("the shards were cut by other costs (--costs)".to_owned());
        }
        differences
    }
}

impl ShardsFolder {
    /// Creates the folder, and makes sure that it belongs to this sweep.
    ///
    /// # Errors
    /// If it cannot be written, or belongs to another sweep.
    pub(crate) fn agree(&self, sweep: &SharedSweep) -> Result<(), ShardsFolderError> {
        let refused = |source| ShardsFolderError::Folder { path: self.path().into(), source };
        std::fs::create_dir_all(self.path()).map_err(refused)?;
        let path = self.sweep();
        let text = serde_json::to_vec_pretty(sweep).map_err(|error| refused(error.into()))?;
        if create_once(self.path(), &path, &text).map_err(refused)? {
            return Ok(());
        }
        let file: SharedSweep = read_json(&path)?;
        let differences = sweep.differences(&file);
        if differences.is_empty() {
            return Ok(());
        }
        Err(ShardsFolderError::Other { path, host: file.host, differences })
    }

    /// Makes sure that all shards have the same renderer.
    ///
    /// # Errors
    /// If another shard has another one, or the folder cannot be read and written.
    pub(crate) fn agree_on_renderer(&self, identity: &str, host: &str) -> Result<(), ShardsFolderError> {
        let path = self.path().join("renderer.json");
        let text = json!([identity, host]).to_string();
        let refused = |source| ShardsFolderError::Folder { path: self.path().into(), source };
        if create_once(self.path(), &path, text.as_bytes()).map_err(refused)? {
            return Ok(());
        }
        let [expected, host]: [String; 2] = read_json(&path)?;
        if expected == identity {
            return Ok(());
        }
        Err(ShardsFolderError::Renderer { found: identity.to_owned(), expected, host })
    }

    /// Returns the message of a folder that cannot be written.
    pub(crate) fn not_written(&self, source: io::Error) -> ShardsFolderError {
        ShardsFolderError::Folder { path: self.path().into(), source }
    }

    /// Removes what a killed task has left of files that it was writing.
    pub(crate) fn remove_leftovers(&self, shard: SweepShard) {
        let stem = self.results(shard).with_extension("");
        let stem = stem.file_name().map(|name| format!("{}.", name.to_string_lossy())).unwrap_or_default();
        for entry in std::fs::read_dir(self.path()).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.starts_with(&stem) && name.contains(".tmp") {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

/// Writes a file in one piece unless there is one. Returns `true` if this process wrote it.
fn create_once(folder: &Path, path: &Path, content: &[u8]) -> io::Result<bool> {
    if path.exists() {
        return Ok(false);
    }
    let mut file = tempfile::Builder::new()
        .prefix(".sweep")
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)?;
    file.write_all(content)?;
    match file.persist_noclobber(path) {
        Ok(_) => Ok(true),
        Err(error) if error.error.kind() == io::ErrorKind::AlreadyExists => Ok(false),
        Err(error) => Err(error.error),
    }
}

fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, ShardsFolderError> {
    let read = || Ok(serde_json::from_slice(&input::read(path)?)?);
    read().map_err(|source| ShardsFolderError::Read { path: path.into(), source })
}
