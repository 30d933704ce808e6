//! The content of a checkpoint folder: its hash, and whether its files are still those that were hashed.
//!
//! The hash identifies a policy in results files. It covers every file that a loader may read, and no other.

use std::ffi::OsStr;
use std::fs::Metadata;
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use run_config::input;
use thiserror::Error;
use xxhash_rust::xxh3::Xxh3Default;

use crate::weights;

/// Extensions of the files that a loader may read: weights, configurations and tokenizers.
const EXTENSIONS: [&str; 3] = [weights::EXTENSION, "json", "model"];
/// Maximum depth of folders below a checkpoint that are hashed.
const MAX_DEPTH: usize = 4;
/// Bytes per read.
const CHUNK: usize = 1 << 20;

/// The files of a checkpoint folder at the time they were hashed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckpointContent {
    folder: PathBuf,
    /// Sorted by path.
    files: Vec<(PathBuf, FileState)>,
    hash: u64,
}

/// The properties of a file that change when it is written to or replaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FileState {
    device: u64,
    inode: u64,
    size: u64,
    /// Time of the last modification in s and ns.
    modified: (i64, i64),
}

/// An error that occurred while hashing a checkpoint.
#[derive(Debug, Error)]
#[error("failed to read the checkpoint file {}", path.display())]
pub struct ReadContentError {
    path: PathBuf,
    source: io::Error,
}

impl CheckpointContent {
    /// Hashes all files that a loader may read below `folder`: xxh3-64 over them in the order of their paths,
    /// each as its relative path, its length and its bytes.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn read(folder: &Path) -> Result<Self, ReadContentError> {
        Self::read_files(folder, paths(folder)?)
    }

    /// Hashes one file, whatever its name and folder, as [`Self::read`] does.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read_file(path: &Path) -> Result<Self, ReadContentError> {
        Self::read_files(path, vec![path.to_owned()])
    }

    fn read_files(folder: &Path, paths: Vec<PathBuf>) -> Result<Self, ReadContentError> {
        let (mut files, mut hash, mut buffer) = (Vec::new(), Xxh3Default::new(), vec![0; CHUNK]);
        for path in paths {
            let failed = |source| ReadContentError { path: path.clone(), source };
            let mut file = input::open(&path).map_err(failed)?;
            let state = FileState::new(&file.metadata().map_err(failed)?);
            let name = path.strip_prefix(folder).unwrap_or(&path).as_os_str().as_encoded_bytes();
            hash.update(&(name.len() as u64).to_le_bytes());
            hash.update(name);
            hash.update(&state.size.to_le_bytes());
            loop {
                match file.read(&mut buffer).map_err(failed)? {
                    0 => break,
                    n => hash.update(&buffer[..n]),
                }
            }
            files.push((path, state));
        }
        Ok(Self { folder: folder.to_owned(), files, hash: hash.digest() })
    }

    /// Returns the folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the paths of the files, sorted.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|(path, _)| path.as_path())
    }

    /// Returns the hash as 16 hexadecimal digits.
    #[must_use]
    pub fn hash(&self) -> String {
        format!("{:016x}", self.hash)
    }

    /// Returns the first file that was added, removed, replaced or written to since it was hashed.
    #[must_use]
    pub fn changed_file(&self) -> Option<PathBuf> {
        let found = paths(&self.folder).unwrap_or_default();
        let is_known = |path: &PathBuf| self.files.binary_search_by(|(known, _)| known.cmp(path)).is_ok();
        let changed = self.files.iter().find(|(path, state)| state.differs_at(path));
        changed.map(|(path, _)| path).or_else(|| found.iter().find(|path| !is_known(path))).cloned()
    }

    /// Like [`changed_file`](Self::changed_file), for the files that may be mapped into memory. Takes a
    /// system call for each.
    #[must_use]
    pub fn changed_weights(&self) -> Option<&Path> {
        let are_weights = |path: &Path| path.extension() == Some(OsStr::new(weights::EXTENSION));
        let mut files = self.files.iter();
        files.find(|(path, state)| are_weights(path) && state.differs_at(path)).map(|(path, _)| &**path)
    }
}

impl FileState {
    fn new(metadata: &Metadata) -> Self {
        Self {
            device: metadata.dev(),
            inode: metadata.ino(),
            size: metadata.size(),
            modified: (metadata.mtime(), metadata.mtime_nsec()),
        }
    }

    /// Returns `true` if the file at `path` has another state, or there is none.
    fn differs_at(&self, path: &Path) -> bool {
        std::fs::metadata(path).map_or(true, |metadata| Self::new(&metadata) != *self)
    }
}

/// Returns the paths of all files that a loader may read below `folder`, sorted.
fn paths(folder: &Path) -> Result<Vec<PathBuf>, ReadContentError> {
    let mut paths = Vec::new();
    collect(folder, MAX_DEPTH, &mut paths)?;
    paths.sort();
    Ok(paths)
}

fn collect(folder: &Path, depth: usize, paths: &mut Vec<PathBuf>) -> Result<(), ReadContentError> {
    let failed = |source| ReadContentError { path: folder.into(), source };
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.is_dir() {
            if depth > 0 {
                collect(&path, depth - 1, paths)?;
            }
        } else if EXTENSIONS.iter().any(|kind| path.extension() == Some(OsStr::new(kind))) {
            paths.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn folder() -> (tempfile::TempDir, PathBuf, CheckpointContent) {
        let folder = tempfile::tempdir().unwrap();
        let weights = folder.path().join("single").join("model.safetensors");
        fs::create_dir(folder.path().join("single")).unwrap();
        fs::write(&weights, "12345678").unwrap();
        fs::write(folder.path().join("tokenizer.json"), "{}").unwrap();
        fs::write(folder.path().join("README.md"), "about").unwrap();
        let content = CheckpointContent::read(folder.path()).unwrap();
        (folder, weights, content)
    }

    #[test]
    fn other_files_do_not_matter() {
        let (folder, _, content) = folder();
        fs::write(folder.path().join("README.md"), "more about").unwrap();
        fs::write(folder.path().join("optimizer.pt"), "1").unwrap();
        assert_eq!(content.changed_file(), None);
        assert_eq!(CheckpointContent::read(folder.path()).unwrap().hash(), content.hash());
    }

    #[test]
    fn overwritten_weights_are_noticed() {
        let (_folder, weights, content) = folder();
        assert_eq!((content.changed_file(), content.changed_weights()), (None, None));
        let modified = fs::metadata(&weights).unwrap().modified().unwrap();
        let later = modified + std::time::Duration::from_nanos(1);
        // As long as before.
        fs::write(&weights, "87654321").unwrap();
        fs::File::options().write(true).open(&weights).unwrap().set_modified(later).unwrap();
        assert_eq!(content.changed_file().as_deref(), Some(&*weights));
        assert_eq!(content.changed_weights(), Some(&*weights));
        assert_ne!(CheckpointContent::read(content.folder()).unwrap().hash(), content.hash());
    }

    #[test]
    fn replaced_weights_of_same_age_are_noticed() {
        let (folder, weights, content) = folder();
        let modified = fs::metadata(&weights).unwrap().modified().unwrap();
        let new = folder.path().join("new");
        fs::write(&new, "87654321").unwrap();
        fs::File::options().write(true).open(&new).unwrap().set_modified(modified).unwrap();
        fs::rename(&new, &weights).unwrap();
        assert_eq!(content.changed_weights(), Some(&*weights));
    }

    #[test]
    fn added_and_removed_files_are_noticed() {
        let (folder, _, content) = folder();
        let added = folder.path().join("hypogeum.json");
        fs::write(&added, "{}").unwrap();
        assert_eq!(content.changed_file(), Some(added.clone()));
        assert_eq!(content.changed_weights(), None);
        fs::remove_file(added).unwrap();
        assert_eq!(content.changed_file(), None);
        fs::remove_file(folder.path().join("tokenizer.json")).unwrap();
        assert_eq!(content.changed_file(), Some(folder.path().join("tokenizer.json")));
    }
}
