//! The segment in which iceoryx2 counts the nodes of a domain.
//!
//! iceoryx2 creates it in several steps, any of which a kill can interrupt, and gives every user write
//! access, with which anybody could stall all processes of the domain. Therefore it is created beforehand,
//! with its final content and for this user only.

use std::fs::File;
use std::io::{self, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use rustix::fs::{AtFlags, CWD, Mode, OFlags};

use super::error::LinkError;
use crate::link::memory::shm::SHM;

/// End of the segment's name in iceoryx2 0.10.0: the SHA-1 of the type name
/// `iceoryx2::node::global_management_segment::State`, and the version.
const NAME: &str = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt";
/// Content: the version 0.10.0, 16 bits per part, and the counter with its padding.
const CONTENT: [u64; 2] = [10 << 16, 0];

/// Creates the segment of the domain whose names start with `prefix`, unless it exists.
pub(crate) fn create(prefix: &str) -> Result<(), LinkError> {
    let path = Path::new(SHM).join(format!("{prefix}{NAME}"));
    let failed = |source| LinkError::SharedMemory { path: path.clone(), source };
    if !path.exists() {
        match create_at(&path) {
            // Another process has created it meanwhile.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            created => created.map_err(failed)?,
        }
    }
    // Anybody can create a file of this name who has learned the prefix.
    let owner = std::fs::symlink_metadata(&path).map_err(failed)?.uid();
    if owner == rustix::process::getuid().as_raw() { Ok(()) } else { Err(LinkError::Foreign { path, owner }) }
}

/// Creates the segment without a name and links it to `path`, so that it appears complete or not at all, and
/// nobody can learn the prefix before.
fn create_at(path: &Path) -> io::Result<()> {
    let (access, mode) = (OFlags::TMPFILE | OFlags::WRONLY | OFlags::CLOEXEC, Mode::RUSR | Mode::WUSR);
    let mut file = File::from(rustix::fs::open(SHM, access, mode)?);
    file.write_all(bytemuck::bytes_of(&CONTENT))?;
    let unnamed = format!("/proc/self/fd/{}", file.as_raw_fd());
    Ok(rustix::fs::linkat(CWD, unnamed, CWD, path, AtFlags::SYMLINK_FOLLOW)?)
}
