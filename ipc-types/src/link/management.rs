//! The segment in which iceoryx2 counts the nodes of a domain.
//!
//! iceoryx2 creates it in several steps, any of which a kill can interrupt, and gives every user write
//! access, with which anybody could stall all processes of the domain. Therefore it is created beforehand,
//! with its final content and for this user only.

use std::fs::OpenOptions;
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

use super::domain::{Domain, SHM};
use super::error::LinkError;

/// End of the segment's name in iceoryx2 0.10.0: the SHA-1 of the type name
/// `iceoryx2::node::global_management_segment::State`, and the version.
const NAME: &str = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt";
/// Content: the version 0.10.0, 16 bits per part, and the counter with its padding.
const CONTENT: [u64; 2] = [10 << 16, 0];

/// Creates the segment of a domain, unless it exists.
pub(super) fn create(domain: &Domain) -> Result<(), LinkError> {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let path = Path::new(SHM).join(format!("{}{NAME}", domain.prefix));
    if path.exists() {
        return Ok(());
    }
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let part = Path::new(SHM).join(format!("{}{}_{number}.part", domain.prefix, std::process::id()));
    let created = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&part)
        .and_then(|mut file| file.write_all(bytemuck::bytes_of(&CONTENT)))
        // The segment appears under its name complete or not at all.
        .and_then(|()| std::fs::hard_link(&part, &path));
    // What is left under the other name is removed with the domain.
    let _ = std::fs::remove_file(&part);
    match created {
        // Another process may have created it meanwhile.
        Err(source) if !path.exists() => Err(LinkError::Io { action: "create", path, source }),
        _ => Ok(()),
    }
}
