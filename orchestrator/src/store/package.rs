//! Packages: a results file and the checkpoints of its policies in one ZIP file.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use policy_host::formats::content::CheckpointContent;
use tempfile::TempDir;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use crate::store::results::ResultsFile;

/// Name of the results file in a package.
pub(crate) const RESULTS: &str = "results.db";
/// Folder of the checkpoints in a package, which has one folder per policy.
const CHECKPOINTS: &str = "checkpoints";
/// Largest size of the content relative to that of the package. Databases shrink to about a tenth.
const MAX_RATIO: u64 = 100;
/// First bytes of a ZIP file.
const MAGIC: [u8; 4] = *b"PK\x03\x04";

/// A package in the making.
pub(crate) struct PackageWriter {
    zip: ZipWriter<File>,
}

impl PackageWriter {
    pub(crate) fn new(file: File) -> Self {
        Self { zip: ZipWriter::new(file) }
    }

    /// Adds a file.
    pub(crate) fn file(&mut self, name: &str, path: &Path) -> anyhow::Result<()> {
        // Weights do not become smaller. Files may have any size and no date, so that equal content gives
        // equal bytes.
        let method = if name == RESULTS { CompressionMethod::Deflated } else { CompressionMethod::Stored };
        self.zip
            .start_file(name, SimpleFileOptions::default().compression_method(method).large_file(true))?;
        io::copy(&mut File::open(path)?, &mut self.zip)?;
        Ok(())
    }

    /// Adds the files of a policy's checkpoint.
    pub(crate) fn checkpoint(&mut self, policy: &str, content: &CheckpointContent) -> anyhow::Result<()> {
        for path in content.files() {
            let name = path.strip_prefix(content.folder())?.to_str().context("its name is not UTF-8")?;
            self.file(&format!("{CHECKPOINTS}/{policy}/{name}"), path)
                .with_context(|| format!("failed to add {}", path.display()))?;
        }
        Ok(())
    }

    pub(crate) fn finish(self) -> anyhow::Result<()> {
        self.zip.finish()?.sync_all()?;
        Ok(())
    }
}

/// An unpacked package. Its files exist as long as this value.
pub(crate) struct Package {
    /// Path of the package itself.
    package: PathBuf,
    folder: TempDir,
}

impl Package {
    /// Unpacks the file if it is a package; `None` if it is something else.
    ///
    /// # Errors
    /// If it cannot be unpacked, or contains no results.
    pub(crate) fn unpack(path: &Path) -> anyhow::Result<Option<Self>> {
        Self::unpack_files(path, |_| true)
    }

    /// Unpacks the files whose name in the package is wanted.
    fn unpack_files(path: &Path, is_wanted: impl Fn(&Path) -> bool) -> anyhow::Result<Option<Self>> {
        let mut start = [0; MAGIC.len()];
        let is_zip = File::open(path).and_then(|mut file| file.read_exact(&mut start));
        if is_zip.is_err() || start != MAGIC {
            return Ok(None);
        }
        let failed = || format!("failed to unpack {}", path.display());
        let folder = tempfile::tempdir().with_context(failed)?;
        let file = File::open(path).with_context(failed)?;
        let mut left = MAX_RATIO * file.metadata().with_context(failed)?.len();
        let mut archive = ZipArchive::new(file).with_context(failed)?;
        for idx in 0..archive.len() {
            let mut entry = archive.by_index(idx).with_context(failed)?;
            let name = entry.enclosed_name().filter(|_| entry.is_file());
            let name = name.with_context(|| format!("{}: entry {idx} is not a file inside it", failed()))?;
            if !is_wanted(&name) {
                continue;
            }
            let target = folder.path().join(&name);
            std::fs::create_dir_all(target.parent().unwrap_or(folder.path())).with_context(failed)?;
            let mut file = File::create_new(&target).with_context(failed)?;
            let n = io::copy(&mut entry.by_ref().take(left), &mut file).with_context(failed)?;
            left -= n;
            ensure!(left > 0, "{}: it is more than {MAX_RATIO} times as large as the package", failed());
        }
        let package = Self { package: path.to_owned(), folder };
        ensure!(
            package.results().is_file(),
            "{} contains no {RESULTS}: it was not made by `hypogeum pack`",
            path.display()
        );
        Ok(Some(package))
    }

    /// Reads the results file. Its path is that of the package, which is what messages and relative paths of
    /// checkpoints refer to.
    ///
    /// # Errors
    /// If it is not one of this version or a row is invalid.
    pub(crate) fn read_results(&self) -> anyhow::Result<ResultsFile> {
        let file = ResultsFile::read(&self.results());
        let file = file.with_context(|| format!("failed to read {RESULTS} in {}", self.package.display()))?;
        Ok(ResultsFile { path: self.package.clone(), ..file })
    }

    fn results(&self) -> PathBuf {
        self.folder.path().join(RESULTS)
    }

    /// Returns the folder of a policy's checkpoint, if the package has it.
    pub(crate) fn checkpoint(&self, policy: &str) -> Option<PathBuf> {
        let folder = self.folder.path().join(CHECKPOINTS).join(policy);
        folder.is_dir().then_some(folder)
    }
}

/// Reads a results file, or the one in a package.
///
/// # Errors
/// If it is neither.
pub(crate) fn read_results(path: &Path) -> anyhow::Result<ResultsFile> {
    match Package::unpack_files(path, |name| name == Path::new(RESULTS))? {
        Some(package) => package.read_results(),
        None => ResultsFile::read(path),
    }
}
