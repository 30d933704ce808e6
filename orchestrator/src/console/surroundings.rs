//! Settings inherited from the parent process that could end this one.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use rustix::fs::Mode;
use rustix::process::umask;
use signal_hook::consts::SIGXFSZ;
use signal_hook::flag;

/// Prepares the process: its own files stay usable for it whatever the umask, and a write beyond the limit of
/// file sizes fails instead of ending the process.
pub(crate) fn adapt() {
    let mask = umask(Mode::empty());
    umask(mask.difference(Mode::RWXU));
    // Without a handler, the signal ends the process; that is no reason not to start.
    let _ = flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
}
