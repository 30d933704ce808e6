//! The rows of one or several results files that belong to one evaluation.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ipc_types::RunConfig;
use serde_json::{Map, Value};
use thiserror::Error;

use crate::plan::Condition;
use crate::policy::Identity;
use crate::results::{EpisodeRow, ResultsFile, STOPPING};

/// Manifest entries that describe the circumstances of a run. Results do not depend on them.
const CIRCUMSTANCES: [&str; 2] = ["environment", STOPPING];

/// A merged evaluation.
#[derive(Debug)]
pub(crate) struct Evaluation {
    pub(crate) files: Vec<ResultsFile>,
    /// Policies in the order of the files, and by name within a file.
    pub(crate) policies: Vec<EvaluatedPolicy>,
}

/// A policy of an evaluation.
#[derive(Clone, Debug)]
pub(crate) struct EvaluatedPolicy {
    pub(crate) name: String,
    pub(crate) identity: Identity,
    /// Positions of the policy's rows in the files, sorted by condition and episode.
    rows: Vec<RowIdx>,
}

/// Position of a row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RowIdx {
    pub(crate) file_idx: u32,
    row_idx: u32,
}

/// Reasons why results files cannot be analysed together.
#[derive(Debug, Error)]
pub(crate) enum EvaluationError {
    #[error(
        "{} and {} cannot be compared: {key} is {} in the first and {} in the second{}",
        files[0].display(), files[1].display(), show(values[0].as_ref()), show(values[1].as_ref()), hint(key)
    )]
    Manifest { files: Box<[PathBuf; 2]>, key: String, values: Box<[Option<Value>; 2]> },
    #[error(
        "policy `{name}` is {} in {} but {} in {}; evaluate one of them under another name",
        identities[0], files[0].display(), identities[1], files[1].display()
    )]
    Policy { name: String, files: Box<[PathBuf; 2]>, identities: Box<[Identity; 2]> },
    #[error("{}: policy `{name}` has episodes, but the manifest does not describe it", path.display())]
    UnknownPolicy { name: String, path: PathBuf },
    #[error(
        "{policy}'s {} {} episode {episode} differs between {} and {}; one of the files is not what it claims to be",
        condition.task.name(), condition.perturbation.name(), files[0].display(), files[1].display()
    )]
    Episode { policy: String, condition: Condition, episode: u32, files: Box<[PathBuf; 2]> },
    #[error("there is no policy `{name}`; the results have {}", known.join(", "))]
    NoPolicy { name: String, known: Vec<String> },
    #[error("`--across {key}` names no option that results depend on; expected one of {}", known.join(", "))]
    Across { key: String, known: Vec<String> },
}

fn show(value: Option<&Value>) -> String {
    value.map_or_else(|| "not given".to_owned(), Value::to_string)
}

fn hint(key: &str) -> String {
    match key {
        "version" | "seed" => String::new(),
        key => format!("; if this difference is what you want to compare, add --across {key}"),
    }
}

impl Evaluation {
    /// Merges results files. Options named in `across` may differ between the files.
    ///
    /// # Errors
    /// If anything else that results depend on differs, or the files contradict each other.
    pub(crate) fn new(files: Vec<ResultsFile>, across: &[String]) -> Result<Self, EvaluationError> {
        check_across(across)?;
        for file in &files[1..] {
            check_manifests(&files[0], file, across)?;
        }
        let mut policies: Vec<EvaluatedPolicy> = Vec::new();
        let mut origins: BTreeMap<String, usize> = BTreeMap::new();
        for (file_idx, file) in files.iter().enumerate() {
            for (row_idx, row) in file.rows.iter().enumerate() {
                let name = file.policy(row);
                let idx = match origins.get(name) {
                    Some(&idx) => idx,
                    None => {
                        let identity = identity(file, name)?;
                        policies.push(EvaluatedPolicy { name: name.to_owned(), identity, rows: Vec::new() });
                        origins.insert(name.to_owned(), policies.len() - 1);
                        policies.len() - 1
                    }
                };
                policies[idx].rows.push(RowIdx { file_idx: file_idx as u32, row_idx: row_idx as u32 });
            }
        }
        let mut evaluation = Self { files, policies };
        for idx in 0..evaluation.policies.len() {
            evaluation.check_identities(idx)?;
            evaluation.merge_rows(idx)?;
        }
        Ok(evaluation)
    }

    /// Returns a row.
    pub(crate) fn row(&self, idx: RowIdx) -> &EpisodeRow {
        &self.files[idx.file_idx as usize].rows[idx.row_idx as usize]
    }

    /// Returns the policy with this name.
    ///
    /// # Errors
    /// If there is none.
    pub(crate) fn policy(&self, name: &str) -> Result<&EvaluatedPolicy, EvaluationError> {
        self.policies.iter().find(|policy| policy.name == name).ok_or_else(|| EvaluationError::NoPolicy {
            name: name.to_owned(),
            known: self.policies.iter().map(|policy| policy.name.clone()).collect(),
        })
    }

    /// Returns the rows of a policy by condition, in the order of the suite and of episode indices.
    pub(crate) fn conditions<'a>(&'a self, policy: &'a EvaluatedPolicy) -> Vec<(Condition, &'a [RowIdx])> {
        let condition = |idx: &RowIdx| self.row(*idx).condition;
        let cells = policy.rows.chunk_by(|a, b| condition(a) == condition(b));
        cells.map(|rows| (condition(&rows[0]), rows)).collect()
    }

    /// Returns the value of a manifest entry of the first file.
    pub(crate) fn entry(&self, key: &str) -> Option<&Value> {
        self.files[0].manifest.get(key)
    }

    fn check_identities(&self, policy_idx: usize) -> Result<(), EvaluationError> {
        let policy = &self.policies[policy_idx];
        let mut owners = policy.rows.iter().map(|row| row.file_idx as usize).collect::<Vec<_>>();
        owners.dedup();
        for &owner in &owners[1..] {
            let (first, second) = (&self.files[owners[0]], &self.files[owner]);
            let found = identity(second, &policy.name)?;
            if !found.matches(&policy.identity) {
                return Err(EvaluationError::Policy {
                    name: policy.name.clone(),
                    files: Box::new([first.path.clone(), second.path.clone()]),
                    identities: Box::new([policy.identity.clone(), found]),
                });
            }
        }
        Ok(())
    }

    /// Sorts the rows of a policy in the order of the suite and drops repetitions of the same episode.
    fn merge_rows(&mut self, policy_idx: usize) -> Result<(), EvaluationError> {
        let mut rows = std::mem::take(&mut self.policies[policy_idx].rows);
        let key = |idx: &RowIdx| {
            let row = self.row(*idx);
            (row.condition.task, row.condition.perturbation, row.episode)
        };
        // Of two rows of the same episode, one without an error comes first and is kept.
        rows.sort_by_key(|idx| (key(idx), self.row(*idx).error.is_some()));
        for pair in rows.windows(2).filter(|pair| key(&pair[0]) == key(&pair[1])) {
            let [first, second] = [self.row(pair[0]), self.row(pair[1])];
            let differs =
                first.error.is_none() && second.error.is_none() && first.fingerprint != second.fingerprint;
            if differs {
                let path = |idx: &RowIdx| self.files[idx.file_idx as usize].path.clone();
                return Err(EvaluationError::Episode {
                    policy: self.policies[policy_idx].name.clone(),
                    condition: first.condition,
                    episode: first.episode,
                    files: Box::new([path(&pair[0]), path(&pair[1])]),
                });
            }
        }
        rows.dedup_by_key(|idx| key(idx));
        self.policies[policy_idx].rows = rows;
        Ok(())
    }
}

fn identity(file: &ResultsFile, name: &str) -> Result<Identity, EvaluationError> {
    file.policies
        .get(name)
        .cloned()
        .ok_or_else(|| EvaluationError::UnknownPolicy { name: name.to_owned(), path: file.path.clone() })
}

/// Returns the options that results depend on, with their defaults.
fn defaults() -> Map<String, Value> {
    match serde_json::json!(RunConfig::default().results) {
        Value::Object(options) => options,
        _ => unreachable!("a struct becomes an object"),
    }
}

fn check_across(across: &[String]) -> Result<(), EvaluationError> {
    // Twins share their starts only under one seed, and two versions are two simulators.
    let known: Vec<String> = defaults().keys().filter(|key| *key != "seed").cloned().collect();
    match across.iter().find(|key| !known.contains(key)) {
        Some(key) => Err(EvaluationError::Across { key: key.clone(), known }),
        None => Ok(()),
    }
}

fn check_manifests(
    first: &ResultsFile,
    second: &ResultsFile,
    across: &[String],
) -> Result<(), EvaluationError> {
    let defaults = defaults();
    // A file that was written before an option existed has the results of its default.
    let value = |file: &ResultsFile, key: &str| file.manifest.get(key).or_else(|| defaults.get(key)).cloned();
    let mut keys: Vec<&String> = first.manifest.keys().chain(second.manifest.keys()).collect();
    keys.sort();
    keys.dedup();
    for key in keys.into_iter().filter(|key| !CIRCUMSTANCES.contains(&key.as_str()) && !across.contains(key))
    {
        let values = Box::new([value(first, key), value(second, key)]);
        // A file without policies that read images has no renderer.
        let is_free = key == "renderer" && values.contains(&None);
        if values[0] != values[1] && !is_free {
            let files = Box::new([first.path.clone(), second.path.clone()]);
            return Err(EvaluationError::Manifest { files, key: key.clone(), values });
        }
    }
    Ok(())
}

/// Reads the files of an analysis.
///
/// # Errors
/// If one cannot be read.
pub(crate) fn read_files(paths: &[PathBuf]) -> anyhow::Result<Vec<ResultsFile>> {
    paths.iter().map(|path| ResultsFile::read(Path::new(path))).collect()
}
