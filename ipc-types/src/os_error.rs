//! Errors of the operating system that a user can fix, and the advice for each.

use std::error::Error;
use std::io;

use rustix::io::Errno;

/// Advice by error number (errno(3)).
const REMEDIES: [(Errno, &str); 12] = [
    (Errno::MFILE, "raise the limit of open files: `ulimit -n 1024`"),
    (Errno::NFILE, "close other programs: the whole system has too many files open"),
    (Errno::AGAIN, "raise the limit of processes and threads (`ulimit -u`), or use fewer --threads"),
    (Errno::NOMEM, "free memory, or lift the limit of address space: `ulimit -v unlimited`"),
    (Errno::NOSPC, "free space or inodes of that file system (`df -h`, `df -i`), or enlarge it"),
    (Errno::DQUOT, "free some of your disk quota"),
    (Errno::ROFS, "choose another folder, or mount the file system for writing"),
    (Errno::ACCESS, "change its permissions, or choose another place"),
    (Errno::PERM, "change its permissions, or choose another place"),
    (Errno::FBIG, "lift the limit of file sizes: `ulimit -f unlimited`"),
    (Errno::NOLCK, "choose a folder on a local disk: this file system grants no locks, as some network ones"),
    (Errno::TOOBIG, "raise the limit of the stack, which bounds arguments: `ulimit -s 8192`"),
];
/// Errors that a program's own mistake causes, not the machine or a user.
const MISTAKES: [Errno; 9] = [
    Errno::BADF,
    Errno::FAULT,
    Errno::INVAL,
    Errno::PIPE,
    Errno::CHILD,
    Errno::SRCH,
    Errno::NOTTY,
    Errno::DEADLK,
    Errno::NOTSOCK,
];

/// Returns `true` if the operating system has refused something for a reason that lies outside the program.
#[must_use]
pub fn is_refusal(error: &(dyn Error + 'static)) -> bool {
    os_error(error).is_some_and(|number| MISTAKES.iter().all(|errno| errno.raw_os_error() != number))
}

/// Returns what the user can do about the operating system's error among `error` and its causes. Returns
/// `None` if there is none, or none that a user can fix.
#[must_use]
pub fn remedy(error: &(dyn Error + 'static)) -> Option<&'static str> {
    let number = os_error(error)?;
    REMEDIES.iter().find(|(errno, _)| errno.raw_os_error() == number).map(|(_, remedy)| *remedy)
}

/// Returns the number of the operating system's error among `error` and its causes.
fn os_error(error: &(dyn Error + 'static)) -> Option<i32> {
    let mut errors = std::iter::successors(Some(error), |error| (*error).source());
    errors.find_map(|error| error.downcast_ref::<io::Error>()?.raw_os_error())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::LinkError;

    #[test]
    fn remedy_is_found_below_other_errors() {
        let link = |errno: Errno| LinkError::Io {
            action: "create",
            path: "/dev/shm/x".into(),
            source: errno.into(),
        };
        assert!(remedy(&link(Errno::NOSPC)).unwrap().contains("inodes"));
        assert!(remedy(&link(Errno::MFILE)).unwrap().contains("ulimit -n"));
        assert_eq!(remedy(&link(Errno::PIPE)), None);
        assert!(is_refusal(&link(Errno::NOENT)) && !is_refusal(&link(Errno::PIPE)));
        assert_eq!(remedy(&io::Error::other("on fire")), None);
    }
}
