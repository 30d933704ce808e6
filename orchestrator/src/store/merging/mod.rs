//! Merging of results files of one evaluation: a set union of their rows, which compares rows that occur
//! twice. It streams, so that memory does not depend on the number of rows.

mod manifest;
mod source;
mod tally;

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};
use std::fs::{File, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use anyhow::Context;
use rusqlite::types::{ToSqlOutput, ValueRef};
use rusqlite::{Connection, Statement};

use self::source::{CellNames, MergeSource, SourceRows};
use self::tally::CellTally;
use crate::store::results::{
    COUNT, Column, Gap, create_for_bulk, insert, not_used, not_written, shown, whole_rows,
};

/// Contradictions that are described; the others are counted.
const MAX_DESCRIBED: usize = 20;
/// Rows between two looks at whether to stop.
const STOP_INTERVAL: u64 = 4096;
/// Memory of SQLite for the pages of one source, and of the merged file, in KiB.
const SOURCE_CACHE: i64 = 512;
const TARGET_CACHE: i64 = 32 << 10;

/// The outcome of a merge.
#[derive(Debug, Default)]
pub(crate) struct MergeOutcome {
    /// Rows of the merged file.
    pub(crate) n_rows: u64,
    /// Rows that the merged file did not have before.
    pub(crate) n_new: u64,
    /// Episodes that could not be run.
    pub(crate) n_errors: u64,
    /// Episodes of which several of the files that were added have a row without an error.
    pub(crate) n_compared: u64,
    /// Episodes that shards were to run although others have them.
    pub(crate) n_audited: u64,
    /// Machines whose rows were compared with each other.
    pub(crate) machines: BTreeSet<String>,
    /// Rows of the same episode that differ: some of them, and their number.
    pub(crate) contradictions: Vec<Contradiction>,
    pub(crate) n_contradictions: u64,
    /// Planned episodes that no file has; `None` if no file says which were planned.
    pub(crate) gaps: Option<Vec<Gap>>,
    /// The command that runs them, if a file says how it was made.
    pub(crate) command: Option<Vec<String>>,
    /// `true` if the user stopped the merging.
    pub(crate) is_stopped: bool,
}

/// Two rows of one episode that differ.
#[derive(Debug)]
pub(crate) struct Contradiction {
    pub(crate) names: Rc<CellNames>,
    pub(crate) episode: u32,
    /// Name of the first column that differs, and both values.
    pub(crate) column: &'static str,
    pub(crate) values: [String; 2],
    /// The files, each with its machines.
    pub(crate) files: [(PathBuf, Vec<String>); 2],
}

/// An observer of a merge, which may stop it.
pub(crate) trait MergeObserver {
    /// Begins with the number of rows of all files.
    fn begin(&mut self, n_rows: u64);

    /// Counts rows that have been read.
    fn on_rows(&mut self, n: u64);

    /// Returns `true` if merging is to end.
    fn is_stopped(&self) -> bool;
}

/// An observer that shows no progress and never stops a merge.
pub(crate) struct Unwatched;

impl MergeObserver for Unwatched {
    fn begin(&mut self, _: u64) {}

    fn on_rows(&mut self, _: u64) {}

    fn is_stopped(&self) -> bool {
        false
    }
}

/// Merges files into the one at `out`, which may have rows already: none of them is lost or changed, unless
/// it has an error. Nothing is written if rows contradict each other, or nothing is new.
///
/// # Errors
/// If a file is no results file, damaged or changed, if they do not belong together, or if `out` cannot be
/// written.
pub(crate) fn merge(
    out: &Path,
    inputs: &[PathBuf],
    observer: &mut dyn MergeObserver,
) -> anyhow::Result<MergeOutcome> {
    let target = out.exists().then(|| MergeSource::open_target(out)).transpose()?;
    // A file that is named twice, or is the merged one, contributes once.
    let mut paths = BTreeSet::from_iter(std::fs::canonicalize(out).ok());
    let is_other = |path: &&PathBuf| std::fs::canonicalize(path).map_or(true, |path| paths.insert(path));
    let added =
        inputs.iter().filter(is_other).map(|path| MergeSource::open(path)).collect::<Result<Vec<_>, _>>()?;
    let had_target = target.is_some();
    let sources: Vec<MergeSource> = target.into_iter().chain(added).collect();
    let manifest = manifest::join(&sources)?;
    let written = || format!("failed to write {}", out.display());
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let partial = tempfile::Builder::new()
        .prefix(".merge-")
        .suffix(".db")
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)
        .with_context(written)?;
    let partial = partial.into_temp_path();
    let connection = create_for_bulk(&partial).with_context(written)?;
    let JoinedRows { found: mut outcome, compared, tally } = join_rows(&sources, &connection, out, observer)?;
    outcome.machines = compared.iter().flat_map(|idx| sources[*idx].machines.clone()).collect();
    if outcome.is_stopped || outcome.n_contradictions > 0 {
        return Ok(outcome);
    }
    outcome.gaps = tally.gaps(&manifest)?;
    outcome.n_audited = manifest::n_audited(&sources);
    outcome.command =
        sources.iter().find_map(|source| Some(source.shard()?.command).filter(|it| !it.is_empty()));
    if outcome.n_new == 0 && had_target {
        return Ok(outcome);
    }
    manifest::write(&manifest, &connection).map_err(|error| not_written(out, error))?;
    connection.close().map_err(|(_, error)| not_written(out, error))?;
    File::open(&partial).and_then(|file| file.sync_all()).with_context(written)?;
    partial.persist(out).with_context(written)?;
    Ok(outcome)
}

/// The rows that were joined.
#[derive(Default)]
struct JoinedRows {
    found: MergeOutcome,
    /// Indices of the sources whose rows were compared with those of another one.
    compared: BTreeSet<usize>,
    tally: CellTally,
}

/// Writes the rows of all sources in the order of their keys, each once.
fn join_rows(
    sources: &[MergeSource],
    target: &Connection,
    out: &Path,
    observer: &mut dyn MergeObserver,
) -> anyhow::Result<JoinedRows> {
    let sqlite = |error| not_written(out, error);
    target.pragma_update(None, "cache_size", -TARGET_CACHE).map_err(sqlite)?;
    target.execute_batch("BEGIN").map_err(sqlite)?;
    let mut insertion = target.prepare(&insert()).map_err(sqlite)?;
    let (mut statements, mut n_rows) = (Vec::new(), 0);
    for MergeSource { path, connection, .. } in sources {
        let mut prepare = || {
            connection.pragma_update(None, "cache_size", -SOURCE_CACHE)?;
            n_rows += connection.query_row(COUNT, [], |row| row.get::<_, i64>(0))?.unsigned_abs();
            connection.prepare(&whole_rows())
        };
        statements.push(prepare().map_err(|error| not_used(path, error))?);
    }
    observer.begin(n_rows);
    let mut rows = Vec::new();
    for (statement, source) in statements.iter_mut().zip(sources) {
        rows.push(SourceRows::new(&source.path, statement.raw_query()));
    }
    let mut heap = BinaryHeap::new();
    for (idx, rows) in rows.iter_mut().enumerate() {
        heap.extend(rows.advance()?.map(|(names, episode)| Reverse((names, episode, idx))));
    }
    let (mut joined, mut n_read) = (JoinedRows::default(), 0);
    let mut group = Vec::new();
    while let Some(Reverse((names, episode, first))) = heap.pop() {
        group.clear();
        group.push(first);
        while let Some(Reverse((other, _, idx))) =
            heap.peek().filter(|next| (&next.0.0, next.0.1) == (&names, episode))
        {
            debug_assert_eq!(other, &names);
            group.push(*idx);
            heap.pop();
        }
        joined.add(sources, &rows, &group, (&names, episode), &mut insertion).map_err(sqlite)?;
        for &idx in &group {
            heap.extend(rows[idx].advance()?.map(|(names, episode)| Reverse((names, episode, idx))));
        }
        n_read += group.len() as u64;
        if n_read >= STOP_INTERVAL {
            observer.on_rows(std::mem::take(&mut n_read));
            if observer.is_stopped() {
                joined.found.is_stopped = true;
                return Ok(joined);
            }
        }
    }
    target.execute_batch("COMMIT").map_err(sqlite)?;
    Ok(joined)
}

impl JoinedRows {
    /// Joins the rows of one episode. Keeps the first row without an error, and compares the others with it.
    fn add(
        &mut self,
        sources: &[MergeSource],
        rows: &[SourceRows<'_>],
        group: &[usize],
        (names, episode): (&Rc<CellNames>, u32),
        insertion: &mut Statement<'_>,
    ) -> Result<(), rusqlite::Error> {
        let value = |idx: usize, column: Column| -> Result<ValueRef<'_>, rusqlite::Error> {
            rows[idx].row().map_or(Ok(ValueRef::Null), |row| row.get_ref(column as usize))
        };
        let has_error = |idx: usize| value(idx, Column::Error).is_ok_and(|error| error != ValueRef::Null);
        let finished = || group.iter().copied().filter(|idx| !has_error(*idx));
        let kept = finished().next().unwrap_or(group[0]);
        for (number, &column) in Column::ALL.iter().enumerate() {
            insertion.raw_bind_parameter(number + 1, ToSqlOutput::Borrowed(value(kept, column)?))?;
        }
        insertion.raw_execute()?;
        let found = &mut self.found;
        found.n_rows += 1;
        found.n_errors += u64::from(has_error(kept));
        found.n_new += u64::from(!sources[group[0]].is_target || kept != group[0]);
        self.tally.add(names, episode, !has_error(kept));
        let added = || finished().filter(|idx| !sources[*idx].is_target);
        if added().nth(1).is_some() {
            found.n_compared += 1;
            self.compared.extend(added());
        }
        for other in finished().skip(1) {
            // Stored actions may be left out, but not differ.
            let is_kept = |column: &Column| {
                *column != Column::Actions
                    || [kept, other]
                        .iter()
                        .all(|idx| value(*idx, Column::Actions).is_ok_and(|it| it != ValueRef::Null))
            };
            let mut compared = Column::reproducible().chain([Column::Actions]).filter(is_kept);
            let differs = |column: &Column| value(kept, *column).ok() != value(other, *column).ok();
            let Some(column) = compared.find(differs) else { continue };
            found.n_contradictions += 1;
            if found.contradictions.len() < MAX_DESCRIBED {
                let shown = |idx| value(idx, column).map(shown);
                let file = |idx: usize| (sources[idx].path.clone(), sources[idx].machines.clone());
                found.contradictions.push(Contradiction {
                    names: Rc::clone(names),
                    episode,
                    column: column.name(),
                    values: [shown(kept)?, shown(other)?],
                    files: [file(kept), file(other)],
                });
            }
        }
        Ok(())
    }
}
