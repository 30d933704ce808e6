//! A task that runs a shard: its claim on it, its results file on a disk of the node, and its end.

use std::hash::{BuildHasher, RandomState};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, bail};
use rustix::io::Errno;
use rustix::process::{Pid, test_kill_process};
use xxhash_rust::xxh3::xxh3_64;

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::print_message;
use crate::fleet::FleetEvent;
use crate::plan::partition::{ShardPart, SweepShard};
use crate::store::results::n_finished_in;
use crate::store::shards::folder::{ShardsFolder, file_stem};
use crate::store::shards::saver::{BEAT, Saver, ShardPaths, remove_results, save};
use crate::store::shards::state::{ShardPhase, ShardState};
use crate::study::machine::host_name;

/// Time without a heartbeat after which a task counts as killed: three beats, and some time for the caches
/// of network file systems.
const SILENCE: Duration = Duration::from_secs(3 * BEAT.as_secs() + 5);
/// Time after which a task checks that nobody else has claimed its shard at the same moment.
const CLAIM_TIME: Duration = Duration::from_secs(1);
/// Time between two looks at the state of another task.
const LOOK_INTERVAL: Duration = Duration::from_millis(500);

/// A shard that this process runs.
#[derive(Debug)]
pub(crate) struct ShardTask {
    folder: ShardsFolder,
    shard: SweepShard,
    paths: ShardPaths,
    saver: Saver,
    host: String,
}

impl ShardTask {
    /// Claims a shard, and restores the results that earlier tasks have saved, on a disk of this node.
    ///
    /// # Errors
    /// If another task runs the shard, or a file cannot be read and written.
    pub(crate) fn enter(
        folder: ShardsFolder,
        part: &ShardPart,
        scratch: Option<&Path>,
    ) -> anyhow::Result<Self> {
        let (shard, host) = (part.shard, host_name());
        let paths = ShardPaths {
            scratch: scratch_folder(scratch)?.join(scratch_name(&folder, shard)?),
            saved: folder.results(shard),
            state: folder.state(shard),
        };
        wait_for_claim(&paths.state, shard, &host)?;
        let mut state = ShardState {
            shard: shard.index,
            shards: shard.count,
            phase: ShardPhase::Running,
            host: host.clone(),
            pid: std::process::id(),
            // The keys of a `RandomState` are random numbers from the operating system.
            token: format!("{:016x}", RandomState::new().hash_one(std::process::id())),
            beat: 0,
            planned: part.len(),
            done: 0,
            done_before: 0,
            errors: 0,
            wall_s: 0.0,
            message: None,
        };
        state.write(&paths.state).map_err(|error| folder.not_written(error))?;
        // If several tasks claim a shard at the same time, the last one to write it wins.
        thread::sleep(CLAIM_TIME);
        if let Some(other) = read_state(&paths.state)?.filter(|other| other.token != state.token) {
            bail!(taken(shard, &other));
        }
        folder.remove_leftovers(shard);
        let n_done = restore(&paths).inspect_err(|error| {
            (state.phase, state.message) = (ShardPhase::Failed, Some(format!("{error:#}")));
            // The error itself is reported, whether or not it can be noted.
            let _ = state.write(&paths.state);
        })?;
        (state.done, state.done_before) = (n_done, n_done);
        let saver = Saver::start(paths.clone(), state).context("failed to start a thread")?;
        Ok(Self { folder, shard, paths, saver, host })
    }

    /// Returns the path of the results file on this node.
    pub(crate) fn scratch(&self) -> &Path {
        &self.paths.scratch
    }

    /// Follows the events of the run.
    ///
    /// # Errors
    /// If this node has another renderer than the other shards, whose images results depend on.
    pub(crate) fn on_event(&self, event: &FleetEvent<'_>, needs_images: bool) -> anyhow::Result<()> {
        match event {
            FleetEvent::EpisodeFinished(_, outcome) => self.saver.on_finished(outcome.error.is_some()),
            FleetEvent::RendererReady(identity) if needs_images => {
                self.folder.agree_on_renderer(identity, &self.host)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Saves the results and the final state, when the results file is closed.
    ///
    /// # Errors
    /// If the run failed, the shard cannot be saved, or another task has taken it over.
    pub(crate) fn finish(self, ended: Result<ExitStatus, Failure>) -> Result<ExitStatus, Failure> {
        let Self { folder, shard, paths, saver, .. } = self;
        let (mut state, is_ours) = saver.end();
        if !is_ours {
            return Err(anyhow!("another task has taken shard {shard} over, so this one has ended"))
                .or_user();
        }
        let has_rows = state.done + state.errors > 0 && paths.scratch.exists();
        let saved = if has_rows { save(&paths, &state.token) } else { Ok(()) };
        if saved.is_ok() {
            let (done, planned) = (state.done, state.planned);
            print_message(&format!(
                "shard {shard}: {done} of {planned} episodes in {}",
                paths.saved.display()
            ));
        }
        let in_scratch = || format!("the episodes of shard {shard} are only in {}", paths.scratch.display());
        let ended = match (ended, saved) {
            (Err(failure), Ok(())) => Err(failure),
            (_, Err(error)) => Err(error.context(in_scratch())).or_user(),
            (Ok(status), Ok(())) => Ok(status),
        };
        state.phase = match &ended {
            Err(_) => ShardPhase::Failed,
            Ok(ExitStatus::Interrupted) => ShardPhase::Interrupted,
            Ok(ExitStatus::Success | ExitStatus::EpisodeErrors) => ShardPhase::Finished,
        };
        state.message = ended.as_ref().err().map(Failure::to_string);
        state.beat += 1;
        state.write(&paths.state).map_err(|error| folder.not_written(error)).or_user()?;
        if ended.is_ok() {
            remove_results(&paths.scratch).or_user()?;
        }
        ended
    }
}

/// Waits until no other task can be running the shard.
fn wait_for_claim(path: &Path, shard: SweepShard, host: &str) -> anyhow::Result<()> {
    let is_gone = |state: &ShardState| {
        let pid = Pid::from_raw(state.pid.cast_signed());
        // A container has its host name and its process id again when it is restarted.
        let is_alive = |pid| state.pid != std::process::id() && test_kill_process(pid) != Err(Errno::SRCH);
        state.phase != ShardPhase::Running || state.host == host && !pid.is_some_and(is_alive)
    };
    let Some(first) = read_state(path)?.filter(|state| !is_gone(state)) else { return Ok(()) };
    print_message(&format!(
        "shard {shard} was being run by process {} on {}; waiting {} s for a sign of life before it is taken over",
        first.pid,
        first.host,
        SILENCE.as_secs()
    ));
    let begun = Instant::now();
    while begun.elapsed() < SILENCE {
        thread::sleep(LOOK_INTERVAL);
        let Some(now) = read_state(path)?.filter(|state| !is_gone(state)) else { return Ok(()) };
        if (now.beat, &now.token) != (first.beat, &first.token) {
            bail!(taken(shard, &now));
        }
    }
    Ok(())
}

fn read_state(path: &Path) -> anyhow::Result<Option<ShardState>> {
    ShardState::read(path).with_context(|| format!("failed to read {}; remove it", path.display()))
}

/// Says that another task runs the shard.
fn taken(shard: SweepShard, state: &ShardState) -> String {
    format!(
        "shard {shard} is being run by process {} on {}: give every task its own shard, or end the other one",
        state.pid, state.host
    )
}

/// Returns the folder for the results file of a running shard.
fn scratch_folder(given: Option<&Path>) -> anyhow::Result<PathBuf> {
    let of_variable = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_dir());
    let default = || ["SLURM_TMPDIR", "TMPDIR"].into_iter().find_map(of_variable);
    let folder = given.map(Path::to_owned).or_else(default).unwrap_or_else(std::env::temp_dir);
    // It must be possible to write there, which is better known now than after the first episode.
    tempfile::tempfile_in(&folder).with_context(|| {
        format!(
            "failed to write to {}; name a folder on a disk of this node with --scratch",
            folder.display()
        )
    })?;
    Ok(folder)
}

/// Returns a file name that belongs to one shard of one sweep.
fn scratch_name(folder: &ShardsFolder, shard: SweepShard) -> anyhow::Result<String> {
    let path = std::fs::canonicalize(folder.path())?;
    let sweep = [path.as_os_str().as_encoded_bytes(), &std::fs::read(folder.sweep())?].concat();
    Ok(format!("hypogeum-{:016x}-{}.db", xxh3_64(&sweep), file_stem(shard)))
}

/// Puts what earlier tasks have finished into the scratch file. Returns the number of episodes.
fn restore(paths: &ShardPaths) -> anyhow::Result<u64> {
    let count = || {
        let hint = || format!("remove {} to run the shard from its start", paths.saved.display());
        n_finished_in(&paths.saved).with_context(hint)
    };
    let saved = if paths.saved.exists() { Some(count()?) } else { None };
    // A task that was killed on this node may have left more there than it had saved.
    let left = if paths.scratch.exists() { n_finished_in(&paths.scratch).ok() } else { None };
    match (saved, left) {
        (saved, Some(left)) if left >= saved.unwrap_or(0) => return Ok(left),
        _ => remove_results(&paths.scratch)?,
    }
    if saved.is_some() {
        let copied = std::fs::copy(&paths.saved, &paths.scratch);
        copied.with_context(|| {
            format!(
                "failed to copy {} to {}; name another folder with --scratch",
                paths.saved.display(),
                paths.scratch.display()
            )
        })?;
    }
    Ok(saved.unwrap_or(0))
}
