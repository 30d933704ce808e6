//! Reservation and prefaulting of shared memory before its first use.
//!
//! By default the kernel allocates a segment's pages on first access. That is slow (55 ms instead of 4.5 ms
//! for 90 MB) and raises SIGBUS if memory runs out. Reserving the pages first turns a lack of memory into an
//! error; then they are mapped.

use std::fs::{File, OpenOptions};
use std::mem::MaybeUninit;
use std::os::unix::fs::FileExt;

use rustix::fs::FallocateFlags;
use rustix::io::Errno;
use rustix::mm::Advice;

use crate::layout::{PAGE_BYTES, Page};
use crate::link::domain::Domain;
use crate::link::error::LinkError;
use crate::link::memory::shm::SHM;

/// Reserves the full size of the data segment of publisher `publisher_id`.
pub(crate) fn reserve(domain: &Domain, publisher_id: u128) -> Result<(), LinkError> {
    // The file name consists of the domain's prefix, a hash of the type, and the publisher's id.
    let suffix = format!("_{publisher_id}.data");
    let path = domain
        .segments()?
        .into_iter()
        .find(|path| path.as_os_str().as_encoded_bytes().ends_with(suffix.as_bytes()))
        .ok_or_else(|| LinkError::Io {
            action: "find the publisher's segment in",
            path: SHM.into(),
            source: std::io::ErrorKind::NotFound.into(),
        })?;
    let failed = |source| LinkError::Io { action: "open", path: path.clone(), source };
    let segment = OpenOptions::new().read(true).write(true).open(&path).map_err(failed)?;
    let needed = segment.metadata().map_err(failed)?.len();
    let reserved = match rustix::fs::fallocate(&segment, FallocateFlags::empty(), 0, needed) {
        // Some sandboxes and file systems refuse the call.
        Err(Errno::OPNOTSUPP | Errno::NOSYS | Errno::PERM) => rewrite(&segment, needed),
        reserved => reserved.map_err(Into::into),
    };
    reserved.map_err(|source| LinkError::Reserve { path, needed, source })
}

/// Reserves a file by writing a byte of every page to where it has been read.
fn rewrite(file: &File, length: u64) -> std::io::Result<()> {
    let mut byte = [0];
    (0..length).step_by(PAGE_BYTES).try_for_each(|offset| {
        file.read_exact_at(&mut byte, offset)?;
        file.write_all_at(&byte, offset)
    })
}

/// Prefaults `pages`, part of a reserved segment, for writing.
pub(crate) fn populate_for_writing(pages: &mut [MaybeUninit<Page>]) -> Result<(), LinkError> {
    let needed = size_of_val(pages);
    // SAFETY: the range is exactly a live, exclusively borrowed slice of a shared mapping, and populating it
    // changes none of its bytes.
    match unsafe { rustix::mm::madvise(pages.as_mut_ptr().cast(), needed, Advice::LinuxPopulateWrite) } {
        Ok(()) => Ok(()),
        // Linux before 5.14 lacks this advice: touch every page. The pages are reserved, so no write can
        // fail.
        Err(Errno::INVAL) => {
            pages.iter_mut().for_each(touch);
            Ok(())
        }
        Err(errno) => Err(LinkError::Populate { needed: needed as u64, source: errno.into() }),
    }
}

/// Prefaults `n_pages` pages from the start of a received message for reading, as far as they are mapped.
/// Errors are ignored: prefaulting only makes the first read faster.
pub(crate) fn populate_for_reading(pages: &[Page], n_pages: usize) {
    let start = pages.as_ptr().cast_mut().cast();
    // SAFETY: populating for reading changes no byte of any mapping; the kernel refuses a range that is not
    // mapped.
    let _ = unsafe { rustix::mm::madvise(start, n_pages * PAGE_BYTES, Advice::LinuxPopulateRead) };
}

fn touch(page: &mut MaybeUninit<Page>) {
    // SAFETY: the pointer is that of an exclusive reference, and any byte may be written to uninitialised
    // memory.
    unsafe { page.as_mut_ptr().cast::<u8>().write_volatile(0) };
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::os::unix::fs::MetadataExt;

    use super::*;

    #[test]
    fn rewriting_reserves_and_changes_nothing() {
        let mut file = tempfile::tempfile_in(SHM).unwrap();
        file.write_all(b"content").unwrap();
        let length = 10 * PAGE_BYTES as u64;
        file.set_len(length).unwrap();
        let blocks = |file: &File| file.metadata().unwrap().blocks() * 512;
        assert!(blocks(&file) < length);
        rewrite(&file, length).unwrap();
        assert_eq!(blocks(&file), length);
        let mut content = [0; 9];
        file.read_exact_at(&mut content, 0).unwrap();
        assert_eq!(&content, b"content\0\0");
    }
}
