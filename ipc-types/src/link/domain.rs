//! A run's namespace in shared memory, and its removal.
//!
//! A domain consists of a name prefix in `/dev/shm` and a folder for sockets and service files. iceoryx2's
//! own configuration files are never read. A killed process leaves its segments behind: its parent reaps
//! them, the end of the run removes the whole domain, and the start of the next run removes domains whose
//! processes have all exited.

use std::fs::DirEntry;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant, SystemTime};

use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeState, NodeView};
use iceoryx2::prelude::{CallbackProgression, FileName, Path as IoxPath, SemanticString};
use serde::{Deserialize, Serialize};

use super::error::LinkError;
use super::lane_spec::LaneSpec;
use super::lease::DomainLease;
use super::management;
use super::type_names::Ipc;
use crate::link::memory::budget;
use crate::link::memory::shm::SHM;

/// Folder of iceoryx2's descriptions of services, below the root.
const SERVICES: &str = "services";
/// Hexadecimal digits of the run number in names: the low 48 bits, because a socket's path is limited to 107
/// bytes.
const TAG_DIGITS: usize = 12;
/// Maximum length of a Unix socket's path, without the terminating NUL (`sun_path` in unix(7)).
const MAX_SOCKET_PATH_BYTES: usize = 107;
/// Bytes that iceoryx2 appends to root and prefix for a listener's socket: a slash, a number of up to 34
/// digits, and `.event`. The upper 32 bits of the number count the objects the process has created; 34 digits
/// last for 100 000.
const SOCKET_NAME_BYTES: usize = 1 + 34 + 6;
/// Maximum wait for another process that is already cleaning up the same exited node.
const CLEANUP_TIMEOUT: Duration = Duration::from_secs(2);
/// Maximum time to free the resources of exited processes.
const LISTING_TIMEOUT: Duration = Duration::from_secs(5);
/// Age from which a half-made file counts as left by a process that was killed while creating it. A live
/// process completes it within microseconds.
const EMPTY_AGE: Duration = Duration::from_millis(100);

/// Namespace of one run in shared memory. Every process of the run receives it from its parent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Domain {
    /// Prefix of the name of every segment in `/dev/shm`: `hyp_<uid>_<run>_`.
    pub prefix: String,
    /// Folder of the run: `<base>/<run>`.
    pub root: PathBuf,
}

impl Domain {
    /// Returns the domain of run `run` (a random number) under `base`, a folder owned by this user. Creates
    /// no files.
    #[must_use]
    pub fn new(base: &Path, run: u64) -> Self {
        let tag = run & ((1 << (4 * TAG_DIGITS)) - 1);
        Self::tagged(base, &format!("{tag:0TAG_DIGITS$x}"))
    }

    /// Protects the domain from [`Self::remove_stale`] until the lease is dropped. Every [`super::LinkNode`]
    /// holds its own lease; the parent of a run acquires one before it starts its first child.
    ///
    /// # Errors
    /// If the root cannot be created or locked.
    pub fn lease(&self) -> Result<DomainLease, LinkError> {
        DomainLease::acquire(&self.root)
    }

    /// Prepares the domain for its first process, on behalf of a parent whose run has `lanes`, and leases it:
    /// checks names, rights and the free memory of `shm`, the tmpfs that backs shared memory, so that a child
    /// fails only for what happens afterwards.
    ///
    /// # Errors
    /// If the names are too long, there is too little room, or the files cannot be created.
    pub fn create(&self, lanes: &[LaneSpec], shm: &Path) -> Result<DomainLease, LinkError> {
        self.config()?;
        let lease = self.lease()?;
        budget::check_places(lanes, shm, &self.root)?;
        // Other users learn the prefix with the first child's arguments. From then on the only segment with a
        // predictable name must be there.
        management::create(&self.prefix)?;
        Ok(lease)
    }

    /// Frees the resources of processes that have exited without cleaning up: service connections, borrowed
    /// messages and segments. Wakes their peers. Returns the number of such processes, or `None` if it took
    /// too long (five seconds); what is left is removed with the domain.
    ///
    /// A parent has another process do this after it has waited for a child: what is read there was shared
    /// with the one that crashed and may be damaged. Otherwise the next process that joins does it.
    pub fn reap(&self) -> Option<usize> {
        if !self.half_made_files().is_empty() {
            std::thread::sleep(EMPTY_AGE);
            self.remove_half_made_files();
        }
        let domain = self.clone();
        self.within(LISTING_TIMEOUT, move || domain.reap_now())
    }

    /// Returns a user who has put files with this domain's prefix into shared memory. iceoryx2 takes them for
    /// the domain's own when it cleans up, where they can stall it.
    #[must_use]
    pub fn intruder(&self) -> Option<u32> {
        let mut foreign = std::fs::read_dir(SHM).ok()?.flatten().filter(|entry| self.has_prefix(entry));
        foreign.find_map(|entry| if is_mine(&entry) { None } else { Some(entry.metadata().ok()?.uid()) })
    }

    fn reap_now(&self) -> usize {
        let Ok(config) = self.config() else { return 0 };
        let mut n_cleaned = 0;
        // A folder that cannot be listed contains nothing to free.
        let _ = Node::<Ipc>::list(&config, |state| {
            // A process that was killed while joining has no details yet and holds nothing but its name.
            if let NodeState::Dead(node) = state
                && node.details().is_some()
                && node.blocking_remove_stale_resources(CLEANUP_TIMEOUT).is_ok()
            {
                n_cleaned += 1;
            }
            CallbackProgression::Continue
        });
        n_cleaned
    }

    /// Removes the domain: deletes its segments in `/dev/shm`, whatever they contain, and the root folder.
    /// Processes that are still attached keep their mappings but can no longer reach each other.
    ///
    /// # Errors
    /// If a file cannot be removed. The other files are removed nevertheless.
    pub fn remove(&self) -> Result<(), LinkError> {
        let segments = self.segments().and_then(|paths| {
            let removed = paths.into_iter().map(|path| allow_missing(&path, std::fs::remove_file(&path)));
            removed.fold(Ok(()), Result::and)
        });
        // Only a folder that contains our lock file is removed together with its contents. The lock goes
        // last, so that the next process can go on if this one is killed.
        let contents = if DomainLease::exists(&self.root) { self.remove_contents() } else { Ok(()) };
        let root = match std::fs::remove_dir(&self.root) {
            Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty => contents,
            result => contents.and(allow_missing(&self.root, result)),
        };
        segments.and(root)
    }

    /// Removes everything in the root, the lock last.
    fn remove_contents(&self) -> Result<(), LinkError> {
        let entries = std::fs::read_dir(&self.root).into_iter().flatten().flatten();
        let removed = entries.filter(|entry| !DomainLease::is_lock(&entry.file_name())).map(|entry| {
            let path = entry.path();
            let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
            let remove = if is_folder { std::fs::remove_dir_all } else { std::fs::remove_file };
            allow_missing(&path, remove(&path))
        });
        removed.fold(Ok(()), Result::and).and_then(|()| DomainLease::remove(&self.root))
    }

    /// Removes the domains under `base` whose own processes have all exited and returns their number. A run
    /// in progress is never touched: its processes hold a lease. A foreign host notices the end of its run.
    pub fn remove_stale(base: &Path) -> usize {
        let Ok(entries) = std::fs::read_dir(base) else { return 0 };
        let names =
            entries.flatten().filter(is_mine).filter_map(|entry| entry.file_name().into_string().ok());
        names.filter(|name| is_tag(name)).filter(|name| Self::tagged(base, name).remove_if_unused()).count()
    }

    /// Returns the iceoryx2 configuration of this domain.
    pub(crate) fn config(&self) -> Result<Config, LinkError> {
        let invalid = |reason: String| LinkError::Domain {
            root: self.root.clone(),
            prefix: self.prefix.clone(),
            reason,
        };
        let root = self.root.as_os_str().as_encoded_bytes();
        let max_length = MAX_SOCKET_PATH_BYTES.saturating_sub(SOCKET_NAME_BYTES + self.prefix.len());
        if root.len() > max_length {
            let length = root.len();
            return Err(invalid(format!(
                "its socket paths would be too long: the root has {length} bytes, expected at most {max_length}; set \
                 XDG_RUNTIME_DIR to a folder with a shorter path"
            )));
        }
        let mut config = Config::default();
        config.global.prefix =
            FileName::new(self.prefix.as_bytes()).map_err(|error| invalid(format!("{error:?}")))?;
        config.global.set_root_path(&IoxPath::new(root).map_err(|error| invalid(format!("{error:?}")))?);
        Ok(config)
    }

    fn tagged(base: &Path, tag: &str) -> Self {
        let uid = rustix::process::getuid().as_raw();
        Self { prefix: format!("hyp_{uid}_{tag}_"), root: base.join(tag) }
    }

    /// Returns `true` if a process holds the lease of this run.
    #[must_use]
    pub fn is_in_use(&self) -> bool {
        self.root.is_dir() && DomainLease::try_acquire_exclusive(&self.root).is_none()
    }

    /// Removes the domain if none of the run's own processes is alive. Returns `true` if it did.
    pub fn remove_if_unused(&self) -> bool {
        if !DomainLease::exists(&self.root) {
            // An empty folder was left by a process that was killed just after creating it, or just before
            // removing it. A process that is creating it now will create it again.
            return std::fs::remove_dir(&self.root).is_ok();
        }
        let Some(_lease) = DomainLease::try_acquire_exclusive(&self.root) else { return false };
        self.remove().is_ok()
    }

    /// Does `work` on another thread, because iceoryx2 waits without a limit for the size of a segment whose
    /// creator was killed before it gave it one. Such segments are removed meanwhile, which ends the wait.
    /// Returns `None` if the work takes longer than `timeout` nevertheless; its thread is left behind.
    fn within<T: Send + 'static>(
        &self,
        timeout: Duration,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Option<T> {
        let (done, result) = channel();
        let started = Instant::now();
        let thread = std::thread::Builder::new().name("reap".to_owned());
        // Nobody receives the result of work that took too long.
        thread.spawn(move || drop(done.send(work()))).ok()?;
        loop {
            match result.recv_timeout(EMPTY_AGE / 2) {
                Ok(value) => return Some(value),
                Err(RecvTimeoutError::Timeout) if started.elapsed() < timeout => {
                    self.remove_half_made_files();
                }
                Err(_) => return None,
            }
        }
    }

    /// Removes the files that a killed process has left half made.
    fn remove_half_made_files(&self) {
        let is_left = |created: &SystemTime| created.elapsed().is_ok_and(|age| age >= EMPTY_AGE);
        for (path, _) in self.half_made_files().into_iter().filter(|(_, created)| is_left(created)) {
            // Another process may have removed it.
            let _ = std::fs::remove_file(path);
        }
    }

    /// Lists the domain's segments without a size and its descriptions of services that are still writable,
    /// with the times at which they were created. iceoryx2 takes the write permission away once a description
    /// is complete, and waits for that without a limit.
    fn half_made_files(&self) -> Vec<(PathBuf, SystemTime)> {
        let segments = self.segments().unwrap_or_default().into_iter().filter_map(|path| {
            let data = std::fs::symlink_metadata(&path).ok().filter(|data| data.len() == 0)?;
            Some((path, data.modified().ok()?))
        });
        let services = std::fs::read_dir(self.root.join(SERVICES)).into_iter().flatten().flatten();
        let descriptions = services.filter_map(|entry| {
            let data = entry.metadata().ok().filter(|data| data.is_file() && data.mode() & 0o200 != 0)?;
            Some((entry.path(), data.modified().ok()?))
        });
        segments.chain(descriptions).collect()
    }

    /// Lists the files that exist from the moment at which the sim is ready until it has exited, whatever its
    /// hosts do: the lock, the segment in which nodes are counted, and last those in which the services list
    /// their ports. `sim` is its process id. Services of an earlier sim, which a host may still have open,
    /// are not among them: the sim has not mapped those.
    #[must_use]
    pub fn lasting_files(&self, sim: u32) -> Vec<PathBuf> {
        let maps = std::fs::read_to_string(format!("/proc/{sim}/maps")).unwrap_or_default();
        let is_mapped = |path: &PathBuf| path.to_str().is_some_and(|path| maps.contains(path));
        let segments = self.segments().unwrap_or_default();
        let (services, others): (Vec<_>, _) = segments.into_iter().partition(|path| Self::is_service(path));
        let services = services.into_iter().filter(is_mapped);
        let is_counter = |path: &PathBuf| path.extension().is_some_and(|name| name == "global_mgmt");
        let counter = others.into_iter().filter(is_counter);
        [DomainLease::path(&self.root)].into_iter().chain(counter).chain(services).collect()
    }

    /// Returns `true` for a segment in which a service lists its ports. Once the sim has exited, whoever
    /// frees the memory of exited processes may remove it.
    #[must_use]
    pub fn is_service(segment: &Path) -> bool {
        segment.extension().is_some_and(|extension| extension == "dynamic")
    }

    fn has_prefix(&self, entry: &DirEntry) -> bool {
        entry.file_name().as_encoded_bytes().starts_with(self.prefix.as_bytes())
    }

    /// Lists the domain's files in shared memory. Those of other users, who can create files with any name,
    /// are none of ours.
    pub(crate) fn segments(&self) -> Result<Vec<PathBuf>, LinkError> {
        let failed = |source| LinkError::Io { action: "list", path: SHM.into(), source };
        let ours = |entry: &DirEntry| self.has_prefix(entry) && is_mine(entry);
        let entries = std::fs::read_dir(SHM).map_err(failed)?;
        Ok(entries.flatten().filter(ours).map(|entry| entry.path()).collect())
    }
}

/// Returns `true` if this user owns the file. A symbolic link counts itself.
fn is_mine(entry: &DirEntry) -> bool {
    entry.metadata().is_ok_and(|metadata| metadata.uid() == rustix::process::getuid().as_raw())
}

fn is_tag(name: &str) -> bool {
    name.len() == TAG_DIGITS && name.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

/// Treats the removal of a missing file as success: another process has removed it.
fn allow_missing(path: &Path, removed: io::Result<()>) -> Result<(), LinkError> {
    match removed {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(LinkError::Io { action: "remove", path: path.into(), source: error })
        }
        _ => Ok(()),
    }
}
