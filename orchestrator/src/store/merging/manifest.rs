//! The manifest of a merged file: what all files agree on, and the circumstances of each.

use std::collections::BTreeMap;

use anyhow::{Context, bail};
use rusqlite::Connection;
use serde_json::{Map, Value, json};

use crate::run::stopping::StoppingRule;
use crate::selection::policy::Identity;
use crate::store::merging::source::MergeSource;
use crate::store::results::{
    ENVIRONMENT, PLANS, SHARD, STOPPING, StoredPlan, differences, planned_cells, policy_key, put,
};

/// Key of the circumstances of the files that were merged, within [`ENVIRONMENT`].
const MERGED: &str = "merged";

/// The manifest of a merged file.
#[derive(Debug)]
pub(crate) struct MergedManifest {
    /// Everything that results depend on, except the policies, by key.
    options: Map<String, Value>,
    policies: BTreeMap<String, Identity>,
    environment: Value,
    pub(crate) plans: Vec<StoredPlan>,
    pub(crate) stopping: Option<StoppingRule>,
}

/// Joins the manifests of files, which must agree on everything that results depend on.
///
/// # Errors
/// If they do not, or one is invalid.
pub(crate) fn join(sources: &[MergeSource]) -> anyhow::Result<MergedManifest> {
    let Some(first) = sources.first() else { bail!("there is no file to merge") };
    let mut merged = MergedManifest {
        options: Map::new(),
        policies: BTreeMap::new(),
        environment: environment(sources),
        plans: Vec::new(),
        stopping: None,
    };
    for source in sources {
        let refuse = |what: &str| {
            let paths = [first, source].map(|source| source.path.display());
            format!("{} and {} cannot be merged: {what}", paths[0], paths[1])
        };
        let shown =
            |value: &Option<Value>| value.as_ref().map_or_else(|| "not given".to_owned(), Value::to_string);
        if let Some((key, [a, b])) = differences(&first.manifest, &source.manifest).first() {
            bail!(refuse(&format!("{key} is {} in the first and {} in the second", shown(a), shown(b))));
        }
        for (name, identity) in &source.policies {
            match merged.policies.get(name) {
                Some(known) if !known.matches(identity) => {
                    bail!(refuse(&format!(
                        "policy `{name}` is {known} in the first and {identity} in the second"
                    )));
                }
                Some(_) => {}
                None => drop(merged.policies.insert(name.clone(), identity.clone())),
            }
        }
        let entry = |key: &str| source.manifest.get(key).cloned();
        let invalid = |key: &str| format!("{}: its manifest has no valid {key}", source.path.display());
        let plans = entry(PLANS).map_or_else(|| Ok(Vec::new()), serde_json::from_value::<Vec<StoredPlan>>);
        let plans = plans.with_context(|| invalid(PLANS))?;
        planned_cells(&plans).with_context(|| invalid(PLANS))?;
        for plan in plans {
            if !merged.plans.contains(&plan) {
                merged.plans.push(plan);
            }
        }
        let stopping = entry(STOPPING).map(serde_json::from_value::<StoppingRule>).transpose();
        let stopping = stopping.with_context(|| invalid(STOPPING))?;
        if merged.stopping.is_some() && stopping.is_some() && merged.stopping != stopping {
            bail!(refuse("they ended cells early by different rules (--until-decided, --margin, --alpha)"));
        }
        merged.stopping = merged.stopping.or(stopping);
        let lasting = source
            .manifest
            .iter()
            .filter(|(key, _)| ![ENVIRONMENT, PLANS, SHARD, STOPPING].contains(&key.as_str()));
        merged.options.extend(lasting.map(|(key, value)| (key.clone(), value.clone())));
    }
    Ok(merged)
}

/// Writes the manifest into a new file.
///
/// # Errors
/// If it cannot be written.
pub(crate) fn write(manifest: &MergedManifest, connection: &Connection) -> Result<(), rusqlite::Error> {
    for (key, value) in &manifest.options {
        put(connection, key, value)?;
    }
    for (name, identity) in &manifest.policies {
        put(connection, &policy_key(name), &json!(identity))?;
    }
    if let Some(rule) = &manifest.stopping {
        put(connection, STOPPING, &json!(rule))?;
    }
    put(connection, PLANS, &json!(manifest.plans))?;
    put(connection, ENVIRONMENT, &manifest.environment)
}

/// Returns the number of episodes that the shards among the files were to run although others have them.
pub(crate) fn n_audited(sources: &[MergeSource]) -> u64 {
    let shards = sources.iter().filter_map(MergeSource::shard).map(|shard| (shard.shard, shard.n_second));
    shards.collect::<BTreeMap<u32, u64>>().values().fold(0, |sum, n| sum.saturating_add(*n))
}

/// Returns the circumstances of the first file, with the time of all runs and the circumstances of each.
fn environment(sources: &[MergeSource]) -> Value {
    // A shard that is merged again, with more episodes, replaces itself.
    let mut runs: Vec<Value> = Vec::new();
    for source in sources {
        let environment = source.manifest.get(ENVIRONMENT).cloned().unwrap_or_default();
        let own = match &environment[MERGED] {
            Value::Array(merged) => merged.iter().filter(|run| run.is_object()).cloned().collect(),
            _ if environment.is_object() => {
                let mut environment = environment;
                if let Some(shard) = source.shard() {
                    environment[SHARD] = json!([shard.shard, shard.cuts.first.len()]);
                }
                vec![environment]
            }
            _ => Vec::new(),
        };
        for run in own {
            let shard = run.get(SHARD).cloned();
            let is_same =
                |other: &Value| *other == run || shard.is_some() && other.get(SHARD) == shard.as_ref();
            match runs.iter().position(is_same) {
                Some(idx) => runs[idx] = run,
                None => runs.push(run),
            }
        }
    }
    let Some(mut environment) = runs.first().cloned() else { return Value::Null };
    let shard = environment.as_object_mut().and_then(|environment| environment.remove(SHARD));
    environment["wall_s"] = json!(runs.iter().filter_map(|run| run["wall_s"].as_f64()).sum::<f64>());
    if runs.len() > 1 || shard.is_some() {
        environment[MERGED] = Value::Array(runs);
    }
    environment
}
