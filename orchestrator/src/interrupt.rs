//! Signals by which a user or a machine ends a run: Ctrl-C and SIGTERM. A terminal that closes is left to the system, so
//! that `nohup` means what it says.

use std::io;
use std::thread;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::{Handle, Signals};

/// While this lives the signals do not end the process. Dropping it ends the watch; the signals are then ignored.
#[derive(Debug)]
pub(crate) struct Watch(Handle);

/// Calls `stop` for every signal, from a thread.
///
/// # Errors
/// If the system refuses the handlers.
pub(crate) fn watch(stop: impl Fn() + Send + 'static) -> io::Result<Watch> {
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    let watch = Watch(signals.handle());
    thread::spawn(move || signals.forever().for_each(|_| stop()));
    Ok(watch)
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.0.close();
    }
}
