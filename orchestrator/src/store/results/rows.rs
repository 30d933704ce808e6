//! Reading of whole results files: the manifest and one compact row per episode.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use anyhow::{Context, bail, ensure};
use ipc_types::{ControlMode, ImageSizes};
use policy_host::PolicySpec;
use run_config::{EpisodeEnd, ProtocolName};
use rusqlite::Connection;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use sim::Profile;
use sim::perturb::Strength;

use crate::console::output::print_message;
use crate::selection::condition::{Condition, parse_condition};
use crate::selection::policy::{Identity, is_plain};
use crate::store::results::columns::Column;
use crate::store::results::file::{EpisodeRow, ResultsFile, TextIdx};
use crate::store::results::gaps::gaps;
use crate::store::results::{manifest, open, schema};

impl ResultsFile {
    /// Reads the file at `path`. Another process may be writing to it: then the rows are those of one moment.
    ///
    /// # Errors
    /// If it is not a results file of this version or a row is invalid.
    pub(crate) fn read(path: &Path) -> anyhow::Result<Self> {
        // Descriptors are closed before SQLite opens the file, because closing one drops SQLite's locks.
        let lacks_wal = open::lacks_wal(path);
        let in_use = matches!(File::open(path).map(|file| file.try_lock_shared()), Ok(Err(_)));
        let connection = open::open_read_only(path)?;
        let read = || {
            let snapshot = connection.unchecked_transaction()?;
            let (manifest, policies) = read_manifest(&snapshot)?;
            let mut texts = Texts::default();
            let rows = read_rows(&snapshot, &mut texts)?;
            let stopping = manifest.get(manifest::STOPPING).cloned().map(serde_json::from_value);
            let file = Self {
                path: path.to_owned(),
                stopping: stopping
                    .transpose()
                    .context("its manifest has no valid rule of --until-decided")?,
                manifest,
                policies,
                rows,
                texts: texts.texts,
                in_use,
            };
            if lacks_wal && gaps(&file)?.is_none_or(|gaps| !gaps.is_empty()) {
                print_message(&format!(
                    "note: {} was left by a run that was killed, and {}-wal is not beside it: if this is a copy, copy both \
                     files, otherwise the last episodes are missing",
                    path.display(),
                    path.display()
                ));
            }
            anyhow::Ok(file)
        };
        read().with_context(|| format!("failed to read the results file {}", path.display()))
    }
}

/// Distinct strings by index.
#[derive(Default)]
struct Texts {
    texts: Vec<String>,
    indices: BTreeMap<String, TextIdx>,
}

impl Texts {
    fn index(&mut self, text: &str) -> TextIdx {
        if let Some(&idx) = self.indices.get(text) {
            return idx;
        }
        let idx = self.texts.len() as TextIdx;
        self.texts.push(text.to_owned());
        self.indices.insert(text.to_owned(), idx);
        idx
    }
}

/// Reads the manifest: everything but the policies, and the policies.
///
/// # Errors
/// If an entry is invalid.
pub(crate) fn read_manifest(
    connection: &Connection,
) -> anyhow::Result<(Map<String, Value>, BTreeMap<String, Identity>)> {
    let (mut manifest, mut policies) = (Map::new(), BTreeMap::<String, Identity>::new());
    for (key, text) in manifest::entries_of(connection)? {
        let invalid = || format!("its manifest has no valid {key}");
        if let Some(name) = key.strip_prefix(manifest::POLICY) {
            ensure!(is_plain(name), "its manifest has `{name}` as the name of a policy");
            let identity: Identity = serde_json::from_str(&text).with_context(invalid)?;
            identity.spec.parse::<PolicySpec>().with_context(invalid)?;
            policies.insert(name.to_owned(), identity);
        } else {
            let value = serde_json::from_str(&text).with_context(invalid)?;
            manifest.insert(key, value);
        }
    }
    check_option::<Profile>(&manifest, "profile")?;
    check_option::<Strength>(&manifest, "strength")?;
    check_option::<u64>(&manifest, "seed")?;
    check_option::<ControlMode>(&manifest, "control_mode")?;
    check_option::<u32>(&manifest, "latency")?;
    // Files of earlier versions have the protocol that was the only one.
    if manifest.contains_key("protocol") {
        check_option::<ProtocolName>(&manifest, "protocol")?;
        check_option::<ImageSizes>(&manifest, "image_size")?;
        check_option::<EpisodeEnd>(&manifest, "end")?;
    }
    let shared = manifest::SHARED_EXECUTION.map(|key| (key, manifest.remove(key)));
    let entry = |key: &str| {
        let value = shared.iter().find(|(name, _)| *name == key).and_then(|(_, value)| value.as_ref());
        value.map(Value::to_string)
    };
    for identity in policies.values_mut() {
        *identity = manifest::with_shared_execution(identity.clone(), entry);
    }
    Ok((manifest, policies))
}

/// Checks an option of the runs, on which rows depend.
fn check_option<T: DeserializeOwned>(manifest: &Map<String, Value>, key: &str) -> anyhow::Result<T> {
    let value = manifest.get(key).with_context(|| format!("its manifest has no {key}"))?;
    serde_json::from_value(value.clone()).with_context(|| format!("its manifest has no valid {key}"))
}

fn read_rows(connection: &Connection, texts: &mut Texts) -> anyhow::Result<Vec<EpisodeRow>> {
    let n_rows: i64 = connection.query_row(schema::COUNT, [], |row| row.get(0))?;
    let mut statement = connection.prepare(&schema::rows())?;
    let mut found = statement.query([])?;
    let mut rows = Vec::with_capacity(usize::try_from(n_rows)?);
    // Rows are sorted by condition, so the names of one condition are parsed once.
    let mut names: (String, String) = Default::default();
    let mut condition: Option<Condition> = None;
    while let Some(row) = found.next()? {
        let text = |column: Column| row.get_ref(column as usize)?.as_str().map_err(anyhow::Error::from);
        let (task, perturbation) = (text(Column::Task)?, text(Column::Perturbation)?);
        let condition = match condition {
            Some(condition) if names.0 == task && names.1 == perturbation => condition,
            _ => {
                names = (task.to_owned(), perturbation.to_owned());
                *condition.insert(parse_condition(task, perturbation)?)
            }
        };
        let optional =
            |column: Column| row.get_ref(column as usize)?.as_str_or_null().map_err(anyhow::Error::from);
        let [physics_s, render_s, policy_s, wait_s] =
            Column::TIMES.map(|column| row.get::<_, f64>(column as usize));
        rows.push(EpisodeRow {
            policy: texts.index(text(Column::Policy)?),
            condition,
            episode: row.get(Column::Episode as usize)?,
            seed: row.get::<_, i64>(Column::Seed as usize)?.cast_unsigned(),
            steps: row.get(Column::Steps as usize)?,
            success_once: row.get(Column::SuccessOnce as usize)?,
            success_at_end: row.get(Column::SuccessAtEnd as usize)?,
            first_success_step: row.get(Column::FirstSuccessStep as usize)?,
            failed_predicate: optional(Column::FailedPredicate)?.map(|name| texts.index(name)),
            fingerprint: u64::from_str_radix(text(Column::Fingerprint)?, 16).ok(),
            error: optional(Column::Error)?.map(|message| texts.index(message)),
            times_s: [physics_s? as f32, render_s? as f32, policy_s? as f32, wait_s? as f32],
            has_actions: row.get(Column::Actions as usize)?,
        });
    }
    if rows.is_empty() {
        bail!("it has no episodes");
    }
    Ok(rows)
}
