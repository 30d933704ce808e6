//! What the rows of a results file depend on, kept in the file and compared before rows are added.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rusqlite::{Connection, OptionalExtension, params};
use serde::Serialize;
use thiserror::Error;

use super::open::OpenError;
use crate::plan::{Plan, mode_name};
use crate::policy::Identity;

/// Prefix of the keys that hold a policy's identity.
const POLICY: &str = "policy/";

/// Key of a policy's identity.
pub(super) fn policy_key(name: &str) -> String {
    format!("{POLICY}{name}")
}

/// Key of the renderer's identity: it is known only once a sim is ready.
pub(super) const RENDERER: &str = "renderer";

/// What results depend on, apart from the episode.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Manifest {
    /// Version of the program.
    pub(crate) version: String,
    /// Suite seed.
    pub(crate) seed: u64,
    /// Reading of the benchmark.
    pub(crate) profile: &'static str,
    /// How strong perturbations are.
    pub(crate) strength: f64,
    /// Query mode.
    pub(crate) mode: &'static str,
    /// Rows of a chunk executed before the next query.
    pub(crate) execute: u32,
    /// How single-arm policies drive.
    pub(crate) control_mode: &'static str,
    /// By name.
    pub(crate) policies: BTreeMap<String, Identity>,
}

/// A results file that was made with something else than the command says.
#[derive(Debug, Error, PartialEq, Eq)]
#[error(
    "failed to continue the results file {}: {field} is {found} in it, but {asked} in this command; say the same again, or \
     name another file with --db",
    path.display()
)]
pub(crate) struct Mismatch {
    path: PathBuf,
    field: String,
    found: String,
    asked: String,
}

impl Manifest {
    /// Of a plan whose policies have these identities, in the plan's order.
    pub(crate) fn new(plan: &Plan, identities: Vec<Identity>) -> Self {
        let names = plan.policies.iter().map(|policy| policy.name.clone());
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: plan.seed,
            profile: plan.profile.name(),
            strength: plan.strength.get(),
            mode: mode_name(plan.mode),
            execute: plan.execute,
            control_mode: plan.control_mode.name(),
            policies: names.zip(identities).collect(),
        }
    }

    /// What all rows depend on, as key and JSON text.
    fn common(&self) -> [(&'static str, String); 7] {
        let text = |value: serde_json::Value| value.to_string();
        [
            ("version", text(self.version.as_str().into())),
            ("seed", text(self.seed.into())),
            ("profile", text(self.profile.into())),
            ("strength", text(self.strength.into())),
            ("mode", text(self.mode.into())),
            ("execute", text(self.execute.into())),
            ("control_mode", text(self.control_mode.into())),
        ]
    }
}

/// Compares the file's manifest with this one where rows depend on it, and writes the rest.
pub(super) fn reconcile(connection: &Connection, path: &Path, manifest: &Manifest) -> Result<(), OpenError> {
    let sqlite = |source| OpenError::Sqlite { path: path.into(), source };
    let invalid = |key: &str| OpenError::Manifest { path: path.into(), key: key.to_owned() };
    let mismatch =
        |field: String, found: String, asked: String| Mismatch { path: path.into(), field, found, asked };
    let transaction = connection.unchecked_transaction().map_err(sqlite)?;
    let has_rows = has_rows(&transaction).map_err(sqlite)?;
    for (key, asked) in manifest.common() {
        if has_rows {
            let found = get(&transaction, key).map_err(sqlite)?.ok_or_else(|| invalid(key))?;
            if found != asked {
                return Err(mismatch(key.to_owned(), found, asked).into());
            }
        }
        put_text(&transaction, key, &asked).map_err(sqlite)?;
    }
    for (name, asked) in &manifest.policies {
        let key = policy_key(name);
        let in_use: bool = transaction
            .query_row("SELECT EXISTS (SELECT 1 FROM episodes WHERE policy = ?1)", [name], |row| row.get(0))
            .map_err(sqlite)?;
        if in_use {
            let found = get(&transaction, &key).map_err(sqlite)?.ok_or_else(|| invalid(&key))?;
            let found: Identity = serde_json::from_str(&found).map_err(|_| invalid(&key))?;
            if !found.matches(asked) {
                let field = format!("policy `{name}`");
                return Err(mismatch(field, found.to_string(), asked.to_string()).into());
            }
        }
        let value = serde_json::json!(asked);
        put(&transaction, &key, &value).map_err(sqlite)?;
    }
    transaction.commit().map_err(sqlite)
}

/// Identity of the renderer of the images that the file's rows depend on, if there are any.
pub(super) fn drawn_with(connection: &Connection) -> Result<Option<String>, rusqlite::Error> {
    if !has_rows(connection)? {
        return Ok(None);
    }
    Ok(get(connection, RENDERER)?.and_then(|text| serde_json::from_str(&text).ok()))
}

fn has_rows(connection: &Connection) -> Result<bool, rusqlite::Error> {
    connection.query_row("SELECT EXISTS (SELECT 1 FROM episodes)", [], |row| row.get(0))
}

/// Writes an entry.
pub(super) fn put(
    connection: &Connection,
    key: &str,
    value: &serde_json::Value,
) -> Result<(), rusqlite::Error> {
    put_text(connection, key, &value.to_string())
}

fn put_text(connection: &Connection, key: &str, value: &str) -> Result<(), rusqlite::Error> {
    let sql = "INSERT INTO manifest VALUES (?1, ?2) ON CONFLICT DO UPDATE SET value = excluded.value";
    connection.execute(sql, params![key, value]).map(|_| ())
}

/// Reads an entry as JSON text.
pub(super) fn get(connection: &Connection, key: &str) -> Result<Option<String>, rusqlite::Error> {
    connection.query_row("SELECT value FROM manifest WHERE key = ?1", [key], |row| row.get(0)).optional()
}
