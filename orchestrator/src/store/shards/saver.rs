//! Saving of a shard while it runs: a thread that writes its state every few seconds and its results every
//! few minutes into the folder of the shards, where a next task finds them.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use signal_hook::consts::SIGTERM;

use crate::console::output::print_message;
use crate::store::results::copy_snapshot;
use crate::store::shards::state::ShardState;

/// Time between two signs of life.
pub(crate) const BEAT: Duration = Duration::from_secs(10);
/// Time between two savings of the results.
const SAVE_INTERVAL: Duration = Duration::from_secs(120);

/// The paths of a shard in progress.
#[derive(Clone, Debug)]
pub(crate) struct ShardPaths {
    /// Results file on a disk of this node.
    pub(crate) scratch: PathBuf,
    /// Results file in the folder of the shards.
    pub(crate) saved: PathBuf,
    /// State in that folder.
    pub(crate) state: PathBuf,
}

/// The thread that saves, and what it shares with the run.
#[derive(Debug)]
pub(crate) struct Saver {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    paths: ShardPaths,
    progress: Mutex<SaverProgress>,
    /// Wakes the thread when the run ends.
    ended: Condvar,
    started: Instant,
}

#[derive(Debug)]
struct SaverProgress {
    state: ShardState,
    has_ended: bool,
}

impl Saver {
    /// Starts with a state that has been written.
    ///
    /// # Errors
    /// If no thread can be started.
    pub(crate) fn start(paths: ShardPaths, state: ShardState) -> io::Result<Self> {
        let progress = SaverProgress { state, has_ended: false };
        let shared =
            Shared { paths, progress: Mutex::new(progress), ended: Condvar::new(), started: Instant::now() };
        let shared = Arc::new(shared);
        let own = Arc::clone(&shared);
        let thread = thread::Builder::new().name("saver".to_owned()).spawn(move || own.run())?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Counts a finished episode.
    pub(crate) fn on_finished(&self, is_error: bool) {
        let mut progress = self.shared.lock();
        progress.state.done += u64::from(!is_error);
        progress.state.errors += u64::from(is_error);
    }

    /// Ends the thread. Returns the state, and `false` if another task has taken the shard over.
    pub(crate) fn end(mut self) -> (ShardState, bool) {
        self.stop();
        let mut state = self.shared.lock().state.clone();
        state.wall_s = self.shared.started.elapsed().as_secs_f64();
        let is_ours = self.shared.is_ours(&state);
        (state, is_ours)
    }

    fn stop(&mut self) {
        self.shared.lock().has_ended = true;
        self.shared.ended.notify_all();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for Saver {
    fn drop(&mut self) {
        self.stop();
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, SaverProgress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn run(&self) {
        let (mut saved, mut n_saved) = (Instant::now(), self.lock().state.done);
        loop {
            let progress = self.lock();
            let waited = self.ended.wait_timeout_while(progress, BEAT, |progress| !progress.has_ended);
            let mut progress = waited.unwrap_or_else(PoisonError::into_inner).0;
            if progress.has_ended {
                return;
            }
            progress.state.beat += 1;
            progress.state.wall_s = self.started.elapsed().as_secs_f64();
            let state = progress.state.clone();
            drop(progress);
            if !self.is_ours(&state) {
                let _ = signal_hook::low_level::raise(SIGTERM);
                return;
            }
            if let Err(error) = state.write(&self.paths.state) {
                print_message(&format!("failed to write {}: {error}", self.paths.state.display()));
            }
            if saved.elapsed() >= SAVE_INTERVAL && state.done > n_saved {
                if let Err(error) = save(&self.paths, &state.token) {
                    print_message(&format!("{error:#}; trying again in {} s", SAVE_INTERVAL.as_secs()));
                }
                (saved, n_saved) = (Instant::now(), state.done);
            }
        }
    }

    /// Returns `false` if another task has written the state.
    fn is_ours(&self, state: &ShardState) -> bool {
        match ShardState::read(&self.paths.state) {
            Ok(Some(found)) => found.token == state.token,
            // A file system that fails for a moment is no other task.
            Ok(None) | Err(_) => true,
        }
    }
}

/// Copies the results of a shard into the folder of the shards. Readers see the old file or the new one.
///
/// # Errors
/// If they cannot be read, or the folder cannot be written.
pub(crate) fn save(paths: &ShardPaths, token: &str) -> anyhow::Result<()> {
    let next = paths.saved.with_extension(format!("{token}.tmp"));
    let copy = || -> anyhow::Result<()> {
        remove_results(&next)?;
        copy_snapshot(&paths.scratch, &next)?;
        std::fs::File::open(&next)?.sync_all()?;
        Ok(std::fs::rename(&next, &paths.saved)?)
    };
    let copied = copy();
    if copied.is_err() {
        let _ = remove_results(&next);
    }
    copied.map_err(|error| error.context(format!("failed to save the shard as {}", paths.saved.display())))
}

/// Removes a results file with its log and journal, as far as they are there.
pub(crate) fn remove_results(path: &Path) -> io::Result<()> {
    for suffix in ["", "-wal", "-shm", "-journal"] {
        let mut name = path.as_os_str().to_owned();
        name.push(suffix);
        match std::fs::remove_file(Path::new(&name)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            removed => removed?,
        }
    }
    Ok(())
}
