//! Where a run's shared memory lives, and who cleans it up.
//!
//! A domain is a prefix of the names in `/dev/shm` and a folder for sockets and descriptions. iceoryx2's own configuration
//! files are never read. A process that is killed leaves its segments behind; its parent reaps them, the end of the run
//! removes the domain, and the start of the next run sweeps what runs that died as a whole have left.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeState, NodeView};
use iceoryx2::prelude::{CallbackProgression, FileName, Path as IoxPath, SemanticString};
use serde::{Deserialize, Serialize};

use super::error::LinkError;
use super::lease::DomainLease;
use super::type_names::Ipc;

/// Where POSIX shared memory lives on Linux.
pub(super) const SHM: &str = "/dev/shm";
/// Hexadecimal digits of a run in names. A socket's path has to fit into 107 bytes, so 48 bits of the run must do.
const TAG_DIGITS: usize = 12;
/// Longest path of a Unix socket, without its final NUL.
const SOCKET_PATH_BYTES: usize = 107;
/// What iceoryx2 adds to root and prefix for a listener's socket: a slash, a number of 34 digits (its upper 32 bits count
/// what the process has created, so that this suffices 100 000 times), `.event`.
const SOCKET_NAME_BYTES: usize = 1 + 34 + 6;
/// How long a dead node may be in another cleaner's hands before it is left to that one.
const CLEANER_PATIENCE: Duration = Duration::from_secs(2);

/// Where a run's shared memory lives. One per run; every process of the run is told it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Domain {
    /// First part of the name of every segment in `/dev/shm`: `hyp_<uid>_<run>_`.
    pub prefix: String,
    /// The run's folder: `<base>/<run>`.
    pub root: PathBuf,
}

impl Domain {
    /// The domain of run `run` (a random number) under `base`, a folder of this user. Touches nothing.
    #[must_use]
    pub fn new(base: &Path, run: u64) -> Self {
        let tag = run & ((1 << (4 * TAG_DIGITS)) - 1);
        Self::tagged(base, &format!("{tag:0TAG_DIGITS$x}"))
    }

    /// Keeps the domain from being swept until the claim is dropped. Every [`super::LinkNode`] has one of its own; the
    /// parent of a run takes one before its first child starts.
    ///
    /// # Errors
    /// If the root cannot be created or locked.
    pub fn lease(&self) -> Result<DomainLease, LinkError> {
        DomainLease::hold(&self.root)
    }

    /// Frees what processes of this domain that have died held: their places in services, messages they had borrowed,
    /// segments. Their peers wake up. Returns the number of processes cleaned up after.
    ///
    /// A parent calls it once it has waited for a child; without it the next process that joins the domain does it.
    pub fn reap(&self) -> usize {
        let Ok(config) = self.config() else { return 0 };
        let mut n_cleaned = 0;
        // A folder that cannot be listed holds nothing that could be freed.
        let _ = Node::<Ipc>::list(&config, |state| {
            // A process killed while it joined has no details yet, and nothing but a name to free.
            if let NodeState::Dead(node) = state
                && node.details().is_some()
                && node.blocking_remove_stale_resources(CLEANER_PATIENCE).is_ok()
            {
                n_cleaned += 1;
            }
            CallbackProgression::Continue
        });
        n_cleaned
    }

    /// Ends the domain: reaps, then removes whatever of it is left in `/dev/shm` and its root. Processes still in it keep
    /// what they have mapped and find nobody any more.
    ///
    /// # Errors
    /// If a file of it cannot be removed; the others are removed all the same.
    pub fn remove(&self) -> Result<(), LinkError> {
        self.reap();
        let segments = self.segments().and_then(|paths| {
            paths.into_iter().map(|path| gone(&path, std::fs::remove_file(&path))).fold(Ok(()), Result::and)
        });
        // Only a folder that carries our mark is removed with what is in it.
        let root = if DomainLease::marks(&self.root) {
            gone(&self.root, std::fs::remove_dir_all(&self.root))
        } else {
            match std::fs::remove_dir(&self.root) {
                Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty => Ok(()),
                result => gone(&self.root, result),
            }
        };
        segments.and(root)
    }

    /// Removes the domains under `base` whose processes are all dead; returns how many. A living run's is never touched:
    /// its processes hold a claim, foreign ones are seen as nodes.
    pub fn remove_stale(base: &Path) -> usize {
        let Ok(entries) = std::fs::read_dir(base) else { return 0 };
        let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
        names.filter(|name| is_tag(name)).filter(|name| Self::tagged(base, name).remove_if_unused()).count()
    }

    /// What iceoryx2 is told.
    pub(super) fn config(&self) -> Result<Config, LinkError> {
        let bad = |reason: String| LinkError::Domain {
            root: self.root.clone(),
            prefix: self.prefix.clone(),
            reason,
        };
        let root = self.root.as_os_str().as_encoded_bytes();
        let room = SOCKET_PATH_BYTES.saturating_sub(SOCKET_NAME_BYTES + self.prefix.len());
        if root.len() > room {
            let length = root.len();
            return Err(bad(format!(
                "a socket's path would be too long: the root has {length} bytes, at most {room} fit"
            )));
        }
        let mut config = Config::default();
        config.global.prefix =
            FileName::new(self.prefix.as_bytes()).map_err(|error| bad(format!("{error:?}")))?;
        config.global.set_root_path(&IoxPath::new(root).map_err(|error| bad(format!("{error:?}")))?);
        Ok(config)
    }

    fn tagged(base: &Path, tag: &str) -> Self {
        let uid = rustix::process::getuid().as_raw();
        Self { prefix: format!("hyp_{uid}_{tag}_"), root: base.join(tag) }
    }

    fn remove_if_unused(&self) -> bool {
        let Some(_lease) = DomainLease::take_unused(&self.root) else { return false };
        !self.has_living_node() && self.remove().is_ok()
    }

    fn has_living_node(&self) -> bool {
        let Ok(config) = self.config() else { return false };
        let mut found = false;
        let listed = Node::<Ipc>::list(&config, |state| {
            found |= matches!(state, NodeState::Alive(_) | NodeState::Inaccessible(_));
            if found { CallbackProgression::Stop } else { CallbackProgression::Continue }
        });
        found || listed.is_err()
    }

    /// Files of the domain in shared memory.
    pub(super) fn segments(&self) -> Result<Vec<PathBuf>, LinkError> {
        let failed = |source| LinkError::Io { action: "list", path: SHM.into(), source };
        let ours = |name: &std::ffi::OsStr| name.as_encoded_bytes().starts_with(self.prefix.as_bytes());
        let entries = std::fs::read_dir(SHM).map_err(failed)?;
        Ok(entries.flatten().filter(|entry| ours(&entry.file_name())).map(|entry| entry.path()).collect())
    }
}

fn is_tag(name: &str) -> bool {
    name.len() == TAG_DIGITS && name.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

/// A removal that succeeded, or that somebody else has done.
fn gone(path: &Path, removed: io::Result<()>) -> Result<(), LinkError> {
    match removed {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(LinkError::Io { action: "remove", path: path.into(), source: error })
        }
        _ => Ok(()),
    }
}
