//! The rows of one or several results files that belong to one evaluation.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::Value;
use thiserror::Error;

use crate::selection::condition::Condition;
use crate::selection::policy::Identity;
use crate::store::package::read_results;
use crate::store::results::{self, Column, DifferingEntry, EpisodeRow, ResultsFile, defaults};

/// Key of `--across` for policies that differ although their names and checkpoints agree, as foreign hosts
/// may.
const POLICY: &str = "policy";

/// A merged evaluation.
#[derive(Debug)]
pub(crate) struct Evaluation {
    pub(crate) files: Vec<ResultsFile>,
    /// Policies in the order of the files, and by name within a file.
    pub(crate) policies: Vec<EvaluatedPolicy>,
    /// Suite seed of each file, and the seconds of all its episodes.
    seeds: Vec<u64>,
    seconds: Vec<f64>,
}

/// A policy of an evaluation.
#[derive(Clone, Debug)]
pub(crate) struct EvaluatedPolicy {
    /// Its name in the files, or `FILE:NAME` where another file has another policy under this name, or the
    /// same one under other settings.
    pub(crate) name: String,
    pub(crate) identity: Identity,
    /// `true` if its cells ended when a comparison was decided: they may differ in size.
    pub(crate) ended_early: bool,
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
        "{} and {} cannot be compared: {}{}",
        files[0].display(), files[1].display(), list(differences), hint(differences)
    )]
    Manifest { files: Box<[PathBuf; 2]>, differences: Vec<DifferingEntry> },
    #[error("{}: policy `{name}` has episodes, but the manifest does not describe it", path.display())]
    UnknownPolicy { name: String, path: PathBuf },
    #[error(
        "{policy}'s {} {} episode {episode} differs between {} and {} in {column}; one of the files is not what it \
         claims to be",
        condition.task.name(), condition.perturbation.name(), files[0].display(), files[1].display()
    )]
    Episode {
        policy: String,
        condition: Condition,
        episode: u32,
        column: &'static str,
        files: Box<[PathBuf; 2]>,
    },
    #[error(
        "{} ended cells early (--until-decided), so it cannot be pooled with episodes of another seed; analyse it alone",
        path.display()
    )]
    PooledStopping { path: PathBuf },
    #[error("there is no policy `{name}`; the results have {}", known.join(", "))]
    NoPolicy { name: String, known: Vec<String> },
    #[error("`--across {key}` names no option that results depend on; expected one of {}", known.join(", "))]
    Across { key: String, known: Vec<String> },
}

fn show(value: Option<&Value>) -> String {
    value.map_or_else(|| "not given".to_owned(), Value::to_string)
}

/// Returns the options that differ, each with its values in both files.
pub(crate) fn list(differences: &[DifferingEntry]) -> String {
    let difference = |(key, [first, second]): &DifferingEntry| {
        format!("{key} is {} in the first and {} in the second", show(first.as_ref()), show(second.as_ref()))
    };
    differences.iter().map(difference).collect::<Vec<_>>().join(", ")
}

fn hint(differences: &[DifferingEntry]) -> String {
    let keys: Vec<&str> = differences.iter().map(|(key, _)| key.as_str()).collect();
    match keys.as_slice() {
        keys if keys.contains(&"version") => String::new(),
        ["seed"] => "; to pool the episodes of several seeds, add --across seed".to_owned(),
        keys => format!("; if this is what you want to compare, add --across {}", keys.join(",")),
    }
}

impl EvaluatedPolicy {
    /// Returns the name of the policy as part of a file name: it may contain that of a results file.
    pub(crate) fn file_name(&self) -> String {
        self.name.replace(['/', ':'], "_")
    }
}

impl Evaluation {
    /// Merges results files. Options named in `across` may differ between the files; with [`POLICY`] among
    /// them, policies of different files are different policies.
    ///
    /// # Errors
    /// If anything else that results depend on differs, or the files contradict each other.
    pub(crate) fn new(files: Vec<ResultsFile>, across: &[String]) -> Result<Self, EvaluationError> {
        check_across(across)?;
        for file in &files[1..] {
            check_manifests(&files[0], file, across)?;
        }
        let seeds: Vec<u64> = files.iter().map(suite_seed).collect();
        let stopped = files.iter().find(|file| file.stopping.is_some());
        if let Some(file) = stopped.filter(|_| seeds.iter().any(|seed| *seed != seeds[0])) {
            return Err(EvaluationError::PooledStopping { path: file.path.clone() });
        }
        let policies = policies(&files, across.iter().any(|key| key == POLICY))?;
        let seconds = files.iter().map(|file| file.rows.iter().map(EpisodeRow::seconds).sum()).collect();
        let mut evaluation = Self { files, policies, seeds, seconds };
        for idx in 0..evaluation.policies.len() {
            evaluation.merge_rows(idx)?;
        }
        Ok(evaluation)
    }

    /// Returns the wall time that went into rows: their share of the wall time of the runs, by the time
    /// that they took beside the others. `None` if a file does not say how long its runs took.
    pub(crate) fn wall_s(&self, rows: impl Iterator<Item = RowIdx>) -> Option<f64> {
        let mut own = vec![None; self.files.len()];
        rows.for_each(|idx| *own[idx.file_idx as usize].get_or_insert(0.0) += self.row(idx).seconds());
        let files = self.files.iter().zip(&self.seconds).zip(own);
        let used = files.filter_map(|((file, all), own)| Some((file, all, own?)));
        used.map(|(file, all, own)| Some(file.wall_s()? * own / all.max(f64::MIN_POSITIVE))).sum()
    }

    /// Returns what an episode's start depends on, besides its task: the suite seed and its index.
    pub(crate) fn start(&self, idx: RowIdx) -> (u64, u32) {
        (self.seeds[idx.file_idx as usize], self.row(idx).episode)
    }

    /// Returns the options that differ between the files, with the value of each file.
    pub(crate) fn differing_options(&self) -> Vec<(String, Vec<Value>)> {
        let values = |key: String| {
            let of_file = |file| option(file, &key).unwrap_or(Value::Null);
            let values: Vec<Value> = self.files.iter().map(of_file).collect();
            values.iter().any(|value| *value != values[0]).then_some((key, values))
        };
        option_names().into_iter().filter_map(values).collect()
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

    /// Sorts the rows of a policy in the order of the suite and drops repetitions of the same episode.
    fn merge_rows(&mut self, policy_idx: usize) -> Result<(), EvaluationError> {
        let mut rows = std::mem::take(&mut self.policies[policy_idx].rows);
        let key = |idx: &RowIdx| {
            let row = self.row(*idx);
            (row.condition.task, row.condition.perturbation, self.start(*idx))
        };
        // Of two rows of the same episode, one without an error comes first and is kept.
        rows.sort_by_key(|idx| (key(idx), self.row(*idx).error.is_some()));
        for pair in rows.windows(2).filter(|pair| key(&pair[0]) == key(&pair[1])) {
            let [first, second] = [self.row(pair[0]), self.row(pair[1])];
            if first.error.is_some() || second.error.is_some() {
                continue;
            }
            let file = |idx: &RowIdx| &self.files[idx.file_idx as usize];
            let value = |idx: &RowIdx, column| file(idx).value(self.row(*idx), column);
            let differs = |column: &Column| value(&pair[0], *column) != value(&pair[1], *column);
            if let Some(column) = Column::reproducible().find(differs) {
                return Err(EvaluationError::Episode {
                    policy: self.policies[policy_idx].name.clone(),
                    condition: first.condition,
                    episode: first.episode,
                    column: column.name(),
                    files: Box::new([file(&pair[0]).path.clone(), file(&pair[1]).path.clone()]),
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

/// Returns the policies of all files. Rows of one name are one policy if its identity and all options agree,
/// except the seed; otherwise, or if `is_per_file`, the policies are told apart by their files.
fn policies(files: &[ResultsFile], is_per_file: bool) -> Result<Vec<EvaluatedPolicy>, EvaluationError> {
    let mut policies: Vec<EvaluatedPolicy> = Vec::new();
    for (file_idx, file) in files.iter().enumerate() {
        let mut positions: BTreeMap<&str, usize> = BTreeMap::new();
        for (row_idx, row) in file.rows.iter().enumerate() {
            let name = file.policy(row);
            let idx = match positions.get(name) {
                Some(&idx) => idx,
                None => {
                    let identity = identity(file, name)?;
                    let is_same = |policy: &EvaluatedPolicy| {
                        let first = &files[policy.rows[0].file_idx as usize];
                        !is_per_file
                            && policy.name == name
                            && policy.identity.matches(&identity)
                            && has_same_options(first, file)
                    };
                    let idx = policies.iter().position(is_same).unwrap_or(policies.len());
                    if idx == policies.len() {
                        policies.push(EvaluatedPolicy {
                            name: name.to_owned(),
                            identity,
                            ended_early: false,
                            rows: Vec::new(),
                        });
                    }
                    policies[idx].ended_early |= file.may_end_early(name);
                    positions.insert(name, idx);
                    idx
                }
            };
            policies[idx].rows.push(RowIdx { file_idx: file_idx as u32, row_idx: row_idx as u32 });
        }
    }
    let names: Vec<String> = policies.iter().map(|policy| policy.name.clone()).collect();
    for policy in &mut policies {
        if names.iter().filter(|name| **name == policy.name).count() > 1 {
            let path = files[policy.rows[0].file_idx as usize].path.display();
            policy.name = format!("{path}:{}", policy.name);
        }
    }
    Ok(policies)
}

fn has_same_options(first: &ResultsFile, second: &ResultsFile) -> bool {
    let mut keys = option_names().into_iter().filter(|key| key != "seed");
    keys.all(|key| option(first, &key) == option(second, &key))
}

/// Returns the names of the options and of the code that results depend on.
fn option_names() -> Vec<String> {
    defaults().into_iter().map(|(key, _)| key).chain(["code".to_owned()]).collect()
}

/// Returns an entry of the manifest of a file.
fn option(file: &ResultsFile, key: &str) -> Option<Value> {
    results::option(&file.manifest, key)
}

/// Returns the suite seed of a file.
fn suite_seed(file: &ResultsFile) -> u64 {
    option(file, "seed").and_then(|seed| seed.as_u64()).unwrap_or(0)
}

fn check_across(across: &[String]) -> Result<(), EvaluationError> {
    let known: Vec<String> = option_names().into_iter().chain([POLICY.to_owned()]).collect();
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
    let mut differences = results::differences(&first.manifest, &second.manifest);
    differences.retain(|(key, _)| !across.contains(key));
    if differences.is_empty() {
        return Ok(());
    }
    let files = Box::new([first.path.clone(), second.path.clone()]);
    Err(EvaluationError::Manifest { files, differences })
}

/// Reads the results files and packages of an analysis.
///
/// # Errors
/// If one cannot be read.
pub(crate) fn read_files(paths: &[PathBuf]) -> anyhow::Result<Vec<ResultsFile>> {
    paths.iter().map(|path| read_results(path)).collect()
}
