//! Files that commands write. They replace no file of anybody else, unless `--force` says so.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use sim::show::MARK;

/// Name of the list of the files that this program has written to a folder.
const LIST: &str = ".hypogeum-files";
/// Bytes of a file in which its mark is; that of a video follows a table of its frames.
const HEAD: u64 = 65_536;

/// Permission to replace files that this program has not written.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Overwriting {
    /// Replace files that this program has not written
    #[arg(long)]
    pub(crate) force: bool,
}

/// A folder for files of many formats, with a list of those that this program has written.
#[derive(Debug)]
pub(crate) struct OutputFolder {
    folder: PathBuf,
    overwriting: Overwriting,
    list: File,
    own: BTreeSet<String>,
}

impl Overwriting {
    /// Checks that a file may be written to `path`: there is none, or an empty one, or one with our mark.
    ///
    /// # Errors
    /// If it would replace another file, or is a folder.
    pub(crate) fn check(self, path: &Path) -> anyhow::Result<()> {
        let shown = path.display();
        let metadata = match std::fs::metadata(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            result => result.with_context(|| format!("failed to look at {shown}"))?,
        };
        if metadata.is_dir() {
            bail!("{shown} is a folder; name a file in it");
        }
        if self.force || !metadata.is_file() || metadata.len() == 0 {
            return Ok(());
        }
        let mut head = Vec::new();
        let read = File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
        read.with_context(|| format!("failed to read {shown}"))?;
        if head.windows(MARK.len()).any(|bytes| bytes == MARK.as_bytes()) {
            return Ok(());
        }
        bail!("{shown} exists, and this program has not written it: choose another name, or remove it first")
    }
}

impl OutputFolder {
    /// Opens or creates the folder.
    ///
    /// # Errors
    /// If it cannot be created or written.
    pub(crate) fn open(folder: &Path, overwriting: Overwriting) -> anyhow::Result<Self> {
        let shown = folder.display();
        std::fs::create_dir_all(folder).with_context(|| format!("failed to create the folder {shown}"))?;
        let path = folder.join(LIST);
        let mut list = OpenOptions::new()
            .read(true)
            .append(true)
            .create(true)
            .open(&path)
            .with_context(|| format!("failed to open {}", path.display()))?;
        let mut names = Vec::new();
        list.read_to_end(&mut names).with_context(|| format!("failed to read {}", path.display()))?;
        let own = String::from_utf8_lossy(&names).lines().map(str::to_owned).collect();
        Ok(Self { folder: folder.to_owned(), overwriting, list, own })
    }

    /// Prepares a folder whose files another part of this program writes: it is created, empty, or one that
    /// this function has prepared before.
    ///
    /// # Errors
    /// If it has other files, or cannot be created or written.
    pub(crate) fn claim(folder: &Path, overwriting: Overwriting) -> anyhow::Result<()> {
        let mut entries = std::fs::read_dir(folder).into_iter().flatten();
        if !overwriting.force && entries.next().is_some() && !folder.join(LIST).exists() {
            let folder = folder.display();
            bail!("{folder} has files that this program has not written: choose another folder, or --force");
        }
        Self::open(folder, overwriting).map(drop)
    }

    /// Returns the path of a file that is about to be written.
    ///
    /// # Errors
    /// If it would replace a file that is not on the list, or the list cannot be written.
    pub(crate) fn path(&mut self, name: &str) -> anyhow::Result<PathBuf> {
        let path = self.folder.join(name);
        if !self.own.contains(name) {
            self.overwriting.check(&path)?;
            writeln!(self.list, "{name}")
                .with_context(|| format!("failed to write to {}", self.folder.join(LIST).display()))?;
            self.own.insert(name.to_owned());
        }
        Ok(path)
    }

    /// Writes a file.
    ///
    /// # Errors
    /// Those of [`Self::path`], and if the file cannot be written.
    pub(crate) fn write(&mut self, name: &str, bytes: &[u8]) -> anyhow::Result<PathBuf> {
        self.write_with(name, |partial| Ok(std::fs::write(partial, bytes)?))
    }

    /// Writes a file by a function that is given a temporary path.
    ///
    /// # Errors
    /// Those of [`Self::path`] and of the function.
    pub(crate) fn write_with(
        &mut self,
        name: &str,
        write: impl FnOnce(&Path) -> anyhow::Result<()>,
    ) -> anyhow::Result<PathBuf> {
        let path = self.path(name)?;
        // No half-written file has the final name, and the next command replaces what a killed one leaves.
        let partial = self.path(&format!("{name}.part"))?;
        let written = write(&partial).and_then(|()| Ok(std::fs::rename(&partial, &path)?));
        written.with_context(|| format!("failed to write {}", path.display()))?;
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_own_files_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notes.txt");
        let check = |force| Overwriting { force }.check(&path).map_err(|error| error.to_string());
        assert_eq!(check(false), Ok(()));
        std::fs::write(&path, "").unwrap();
        assert_eq!(check(false), Ok(()));
        std::fs::write(&path, "import hypogeum").unwrap();
        assert!(check(false).unwrap_err().contains("notes.txt exists, and this program has not written it"));
        assert_eq!(check(true), Ok(()));
        std::fs::write(&path, format!("[\n{MARK}")).unwrap();
        assert_eq!(check(false), Ok(()));
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        assert!(check(true).unwrap_err().contains("is a folder"));
    }

    #[test]
    fn folder_knows_what_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out");
        let open = |force| OutputFolder::open(&path, Overwriting { force }).unwrap();
        open(false).write("data.json", b"1").unwrap();
        open(false).write("data.json", b"2").unwrap();
        std::fs::write(path.join("cells.json"), "mine").unwrap();
        let error = open(false).write("cells.json", b"3").unwrap_err().to_string();
        assert!(error.contains("cells.json exists"), "{error}");
        assert_eq!(std::fs::read_to_string(path.join("cells.json")).unwrap(), "mine");
        open(true).write("cells.json", b"3").unwrap();
        let claim = |name, force| OutputFolder::claim(&folder.path().join(name), Overwriting { force });
        claim("new", false).unwrap();
        claim("new", false).unwrap();
        std::fs::create_dir(folder.path().join("other")).unwrap();
        std::fs::write(folder.path().join("other/model.safetensors"), "mine").unwrap();
        assert!(claim("other", false).unwrap_err().to_string().contains("has not written"));
        claim("other", true).unwrap();
        assert_eq!(std::fs::read_to_string(path.join("data.json")).unwrap(), "2");
        assert_eq!(std::fs::read_dir(&path).unwrap().count(), 3, "the list, and no partial file");
    }
}
