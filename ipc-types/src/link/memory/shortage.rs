//! Diagnosis of failures that iceoryx2 reports without a cause: resources of the machine that have run out.

use std::fs::File;
use std::path::Path;

use rustix::process::Resource;
use thiserror::Error;

use crate::link::memory::budget::free_bytes;
use crate::link::memory::shm::SHM;

/// Spare descriptors below which a lack of them is the likely cause: iceoryx2 holds a few while it creates a
/// port, and has closed them again when it fails.
const DESCRIPTORS: usize = 6;
/// Free inodes below which a lack of them is the likely cause.
const INODES: u64 = 4;
/// Free bytes below which a lack of them is the likely cause.
const BYTES: u64 = 64 << 10;

/// A resource that has run out.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum Shortage {
    #[error("the process may open no more than {limit} files; raise that limit: `ulimit -n 1024`")]
    Descriptors { limit: u64 },
    #[error(
        "the file system {SHM} has no inodes left (`df -i`); remove files, or mount it with more of them"
    )]
    Inodes,
    #[error("the file system {SHM} is full, {available} bytes are free; free some of it, or enlarge it")]
    Bytes { available: u64 },
}

impl Shortage {
    /// Returns the resource that this process lacks now, if any.
    #[must_use]
    pub fn find() -> Option<Self> {
        let spare: Vec<File> = (0..DESCRIPTORS).map_while(|_| File::open("/dev/null").ok()).collect();
        let limit = rustix::process::getrlimit(Resource::Nofile).current;
        if let (true, Some(limit)) = (spare.len() < DESCRIPTORS && Path::new("/dev/null").exists(), limit) {
            return Some(Self::Descriptors { limit });
        }
        let stat = rustix::fs::statvfs(SHM).ok()?;
        let available = free_bytes(&stat);
        if stat.f_files > 0 && stat.f_favail < INODES {
            Some(Self::Inodes)
        } else {
            (available < BYTES).then_some(Self::Bytes { available })
        }
    }
}
