//! One of the files that are merged: its manifest, and its rows in the order of their keys.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use rusqlite::fallible_streaming_iterator::FallibleStreamingIterator;
use rusqlite::{Connection, Row, Rows};
use serde_json::{Map, Value};

use crate::plan::partition::StoredShard;
use crate::selection::policy::Identity;
use crate::store::results::{
    Column, ENVIRONMENT, ResultsFileError, SHARD, not_used, open_for_replacement, open_unchecked,
    read_manifest, row_finding,
};

/// A file that is merged.
#[derive(Debug)]
pub(crate) struct MergeSource {
    pub(crate) path: PathBuf,
    pub(crate) connection: Connection,
    /// Everything in the manifest except the policies, by key.
    pub(crate) manifest: Map<String, Value>,
    pub(crate) policies: BTreeMap<String, Identity>,
    /// Machines that made the rows.
    pub(crate) machines: Vec<String>,
    /// `true` for the file that the others are added to.
    pub(crate) is_target: bool,
    // Keeps writers away, where the file system has locks.
    _lock: File,
}

/// Policy, task and perturbation of a row.
pub(crate) type CellNames = [String; 3];

/// The rows of a source, one at a time.
pub(crate) struct SourceRows<'a> {
    path: &'a Path,
    rows: Rows<'a>,
    /// Key of the present row.
    names: Rc<CellNames>,
    episode: u32,
    /// Names that are known to be valid.
    checked: CellNames,
}

impl MergeSource {
    /// Opens a file whose rows are added. They are checked when they are read.
    ///
    /// # Errors
    /// If it is no results file of this version.
    pub(crate) fn open(path: &Path) -> anyhow::Result<Self> {
        let (connection, lock) = open_unchecked(path)?;
        Self::new(path, connection, lock, false)
    }

    /// Opens the file to which the others are added.
    ///
    /// # Errors
    /// As [`Self::open`], and if somebody is using it.
    pub(crate) fn open_target(path: &Path) -> anyhow::Result<Self> {
        let (connection, lock) = open_for_replacement(path)?;
        Self::new(path, connection, lock, true)
    }

    fn new(path: &Path, connection: Connection, lock: File, is_target: bool) -> anyhow::Result<Self> {
        let (manifest, policies) = read_manifest(&connection)
            .map_err(|error| error.context(format!("failed to read the results file {}", path.display())))?;
        let machines = machines(&manifest);
        Ok(Self { path: path.into(), connection, manifest, policies, machines, is_target, _lock: lock })
    }

    /// Returns what the file says about the shard that it is, if it is one.
    pub(crate) fn shard(&self) -> Option<StoredShard> {
        serde_json::from_value(self.manifest.get(SHARD)?.clone()).ok()
    }
}

/// Returns the machines that made the rows of a file.
fn machines(manifest: &Map<String, Value>) -> Vec<String> {
    let shard =
        manifest.get(SHARD).cloned().and_then(|shard| serde_json::from_value::<StoredShard>(shard).ok());
    let of_run = |run: &Value| Some(run["machine"]["host"].as_str()?.to_owned());
    match (shard, manifest.get(ENVIRONMENT)) {
        (Some(shard), _) => shard.machines,
        (None, Some(environment)) => match environment["merged"].as_array() {
            Some(runs) => runs.iter().filter_map(of_run).collect(),
            None => of_run(environment).into_iter().collect(),
        },
        (None, None) => Vec::new(),
    }
}

impl<'a> SourceRows<'a> {
    /// Starts before the first row.
    pub(crate) fn new(path: &'a Path, rows: Rows<'a>) -> Self {
        Self { path, rows, names: Rc::default(), episode: 0, checked: CellNames::default() }
    }

    /// Goes on to the next row and checks it. Returns its key; `None` after the last one.
    ///
    /// # Errors
    /// If the file is damaged or somebody has changed the row.
    pub(crate) fn advance(&mut self) -> Result<Option<(Rc<CellNames>, u32)>, ResultsFileError> {
        let sqlite = |error| not_used(self.path, error);
        self.rows.advance().map_err(sqlite)?;
        let Some(row) = self.rows.get() else { return Ok(None) };
        if let Some(finding) = row_finding(row, &mut self.checked).map_err(sqlite)? {
            return Err(ResultsFileError::Changed { path: self.path.into(), finding });
        }
        let episode: u32 = row.get(Column::Episode as usize).map_err(sqlite)?;
        let is_first = self.names[0].is_empty();
        if !is_first && (&self.checked, episode) <= (&*self.names, self.episode) {
            let finding = "its rows are not in order".to_owned();
            return Err(ResultsFileError::Damaged { path: self.path.into(), finding });
        }
        if self.checked != *self.names {
            self.names = Rc::new(self.checked.clone());
        }
        self.episode = episode;
        Ok(Some((Rc::clone(&self.names), episode)))
    }

    /// Returns the present row.
    pub(crate) fn row(&self) -> Option<&Row<'a>> {
        self.rows.get()
    }
}
