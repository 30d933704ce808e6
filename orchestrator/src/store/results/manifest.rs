//! The manifest of a results file: the configuration that its rows depend on. It is compared before rows are
//! added.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::path::Path;

use policy_host::PolicySpec;
use run_config::{Execution, ResultOptions, RunConfig};
use rusqlite::{Connection, OptionalExtension, params};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::plan::RunPlan;
use crate::selection::condition::Condition;
use crate::selection::policy::Identity;
use crate::store::build_identity;
use crate::store::results::error::{ManifestMismatch, ResultsFileError, not_used};
use crate::store::results::schema;

/// Prefix of the keys under which identities of policies are stored.
pub(crate) const POLICY: &str = "policy/";

/// Returns the key of a policy's identity.
pub(crate) fn policy_key(name: &str) -> String {
    format!("{POLICY}{name}")
}

/// Keys under which older files store one execution for all policies.
pub(crate) const SHARED_EXECUTION: [&str; 2] = ["mode", "execute"];

/// Key of the renderer's identity, which is known only once a sim is ready.
pub(crate) const RENDERER: &str = "renderer";

/// Key of the plans of all runs with the file.
pub(crate) const PLANS: &str = "plans";

/// Key of the circumstances of the latest run.
pub(crate) const ENVIRONMENT: &str = "environment";

/// Key of the shard of which the file has the episodes, if it is one of a sweep.
pub(crate) const SHARD: &str = "shard";

/// Key of the rule that ended cells early, if any run with the file had one.
pub(crate) const STOPPING: &str = "stopping";

/// The configuration that all results of a run depend on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Manifest {
    /// Version of the program.
    pub(crate) version: String,
    /// Hash of the code that results depend on.
    pub(crate) code: String,
    /// Options that change results.
    #[serde(flatten)]
    pub(crate) options: ResultOptions,
    /// Identities of the policies by name.
    pub(crate) policies: BTreeMap<String, Identity>,
}

impl Manifest {
    /// Makes the manifest of a plan. `identities` belong to its policies, in the same order.
    pub(crate) fn new(plan: &RunPlan, identities: Vec<Identity>) -> Self {
        let names = plan.policies.iter().map(|policy| policy.name.clone());
        Self {
            version: build_identity::VERSION.to_owned(),
            code: build_identity::CODE.to_owned(),
            options: plan.config.results.clone(),
            policies: names.zip(identities).collect(),
        }
    }
}

/// Entries that describe the circumstances of a run. Results do not depend on them.
const CIRCUMSTANCES: [&str; 4] = [ENVIRONMENT, PLANS, SHARD, STOPPING];

/// A key whose values differ, with both.
pub(crate) type DifferingEntry = (String, [Option<Value>; 2]);

/// Returns the entries in which two manifests differ although results depend on them.
pub(crate) fn differences(first: &Map<String, Value>, second: &Map<String, Value>) -> Vec<DifferingEntry> {
    let keys: BTreeSet<&String> = first.keys().chain(second.keys()).collect();
    let compared = keys.into_iter().filter(|key| !CIRCUMSTANCES.contains(&key.as_str()));
    let differing = compared.filter_map(|key| {
        let values = [first, second].map(|manifest| option(manifest, key));
        // A file without policies that read images has no renderer.
        let is_free = key == RENDERER && values.contains(&None);
        (values[0] != values[1] && !is_free).then(|| (key.clone(), values))
    });
    differing.collect()
}

/// Returns an entry. A file that was written before an option existed has the results of its default.
pub(crate) fn option(manifest: &Map<String, Value>, key: &str) -> Option<Value> {
    manifest.get(key).cloned().or_else(|| defaults().remove(key))
}

/// Returns the options that results depend on, with their defaults.
pub(crate) fn defaults() -> Map<String, Value> {
    entries(&RunConfig::default().results)
}

/// Returns the options as keys and values. A file is represented by the fingerprint of its content.
fn entries(options: &ResultOptions) -> Map<String, Value> {
    let Value::Object(mut entries) = serde_json::json!(options) else {
        unreachable!("a struct becomes an object")
    };
    for value in entries.values_mut() {
        if let Some(fingerprint) = value.get_mut("fingerprint") {
            *value = fingerprint.take();
        }
    }
    entries
}

/// Compares the manifest of the file with `manifest` if rows depend on it, and stores the latter.
pub(crate) fn reconcile(
    connection: &Connection,
    path: &Path,
    manifest: &Manifest,
) -> Result<(), ResultsFileError> {
    let sqlite = |error| not_used(path, error);
    let invalid = |key: &str| ResultsFileError::Manifest { path: path.into(), key: key.to_owned() };
    let difference = |field: &str, found: &dyn Display, requested: &dyn Display| {
        let [found, requested] = [found, requested].map(|value| match value.to_string() {
            value if value == "null" => "not given".to_owned(),
            value => value,
        });
        format!("{field} is {found} in the file, but {requested} in this command")
    };
    let mut differences = Vec::new();
    let transaction = connection.unchecked_transaction().map_err(sqlite)?;
    let has_rows = has_rows(&transaction).map_err(sqlite)?;
    let defaults = defaults();
    let program = [("version", &manifest.version), ("code", &manifest.code)];
    let program = program.map(|(key, value)| (key.to_owned(), Value::from(value.as_str())));
    for (key, requested) in program.into_iter().chain(entries(&manifest.options)) {
        let requested = requested.to_string();
        if has_rows {
            // A file that was written before an option existed has the results of its default.
            let default = || defaults.get(&key).map(Value::to_string);
            let found = get(&transaction, &key).map_err(sqlite)?.or_else(default);
            // Files of the first versions do not say which code made them.
            let found = found.or_else(|| (key == "code").then(|| Value::Null.to_string()));
            let found = found.ok_or_else(|| invalid(&key))?;
            if found != requested {
                let name = if key == "code" { "the hash of the program's code" } else { &key };
                differences.push(difference(name, &found, &requested));
            }
        }
        put_text(&transaction, &key, &requested).map_err(sqlite)?;
    }
    for (name, requested) in &manifest.policies {
        let key = policy_key(name);
        let in_use: bool =
            transaction.query_row(&schema::has_policy(), [name], |row| row.get(0)).map_err(sqlite)?;
        if in_use {
            let found = get(&transaction, &key).map_err(sqlite)?.ok_or_else(|| invalid(&key))?;
            let found: Identity = serde_json::from_str(&found).map_err(|_| invalid(&key))?;
            let found = with_shared_execution(found, |key| get(&transaction, key).ok().flatten());
            if !found.matches(requested) {
                differences.push(difference(&format!("policy `{name}`"), &found, requested));
            }
        }
        let value = serde_json::json!(requested);
        put(&transaction, &key, &value).map_err(sqlite)?;
    }
    if differences.is_empty() {
        transaction.commit().map_err(sqlite)
    } else {
        Err(ManifestMismatch { path: path.into(), differences }.into())
    }
}

/// Completes the identity of a policy in a file that was written before each policy had its own execution.
/// `entry` returns the JSON text of an entry.
pub(crate) fn with_shared_execution(identity: Identity, entry: impl Fn(&str) -> Option<String>) -> Identity {
    if identity.execution.is_some() || identity.spec.parse() == Ok(PolicySpec::Expert) {
        return identity;
    }
    let read = || {
        let mode = serde_json::from_str(&entry(SHARED_EXECUTION[0])?).ok()?;
        Some(Execution { mode, execute: serde_json::from_str(&entry(SHARED_EXECUTION[1])?).ok()? })
    };
    Identity { execution: read(), ..identity }
}

/// Returns the identity of the renderer whose images the rows of the file depend on, if there are rows.
pub(crate) fn renderer(connection: &Connection) -> Result<Option<String>, rusqlite::Error> {
    if !has_rows(connection)? {
        return Ok(None);
    }
    Ok(get(connection, RENDERER)?.and_then(|text| serde_json::from_str(&text).ok()))
}

fn has_rows(connection: &Connection) -> Result<bool, rusqlite::Error> {
    connection.query_row("SELECT EXISTS (SELECT 1 FROM episodes)", [], |row| row.get(0))
}

/// Writes an entry.
pub(crate) fn put(connection: &Connection, key: &str, value: &Value) -> Result<(), rusqlite::Error> {
    put_text(connection, key, &value.to_string())
}

/// Writes an entry, given as JSON text.
pub(crate) fn put_text(connection: &Connection, key: &str, value: &str) -> Result<(), rusqlite::Error> {
    let sql = "INSERT INTO manifest VALUES (?1, ?2) ON CONFLICT DO UPDATE SET value = excluded.value";
    connection.execute(sql, params![key, value]).map(|_| ())
}

/// Reads an entry as JSON text.
pub(crate) fn get(connection: &Connection, key: &str) -> Result<Option<String>, rusqlite::Error> {
    connection.query_row("SELECT value FROM manifest WHERE key = ?1", [key], |row| row.get(0)).optional()
}

/// Reads all entries as JSON texts, sorted by key.
pub(crate) fn entries_of(connection: &Connection) -> Result<Vec<(String, String)>, rusqlite::Error> {
    let mut statement = connection.prepare(schema::MANIFEST)?;
    statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
}

/// The episodes that a run was to evaluate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct StoredPlan {
    /// Names of the policies.
    pub(crate) policies: Vec<String>,
    /// Names of tasks and perturbations.
    pub(crate) conditions: Vec<(String, String)>,
    /// Episodes of each policy under each condition.
    pub(crate) episodes: u32,
}

impl StoredPlan {
    /// Stores the names of a plan.
    pub(crate) fn new(plan: &RunPlan) -> Self {
        let names = |condition: &Condition| (condition.task.name().to_owned(), condition.perturbation.name());
        Self {
            policies: plan.policies.iter().map(|policy| policy.name.clone()).collect(),
            conditions: plan.conditions.iter().map(names).collect(),
            episodes: plan.episodes,
        }
    }

    /// Returns `true` if every episode of the other plan is one of this plan.
    pub(crate) fn contains(&self, other: &Self) -> bool {
        let is_in = |condition| self.conditions.contains(condition);
        other.policies.iter().all(|policy| self.policies.contains(policy))
            && other.episodes <= self.episodes
            && (self.conditions == other.conditions || other.conditions.iter().all(is_in))
    }
}

/// Adds a plan to those of the file.
pub(crate) fn add_plan(connection: &Connection, plan: &RunPlan) -> Result<(), rusqlite::Error> {
    let stored = get(connection, PLANS)?.and_then(|text| serde_json::from_str(&text).ok());
    let mut plans: Vec<StoredPlan> = stored.unwrap_or_default();
    let plan = StoredPlan::new(plan);
    if !plans.contains(&plan) {
        plans.push(plan);
    }
    put(connection, PLANS, &serde_json::json!(plans))
}
