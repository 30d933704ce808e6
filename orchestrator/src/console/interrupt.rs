//! Handling of SIGINT (Ctrl-C), SIGTERM, and SIGXCPU, with which the kernel announces that the process has
//! used the core-seconds of its limit. SIGHUP keeps its default action, so that `nohup` works as usual.

use std::io;
use std::thread;
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM, SIGXCPU};
use signal_hook::iterator::{Handle, Signals};

use crate::console::output::print_message;

/// Time between two signals of a process whose input has ended. The second one kills children that are left.
const RAISE_INTERVAL: Duration = Duration::from_secs(5);

/// A guard during whose lifetime the signals do not terminate the process. After it is dropped they are
/// ignored.
#[derive(Debug)]
pub(crate) struct SignalWatch(Handle);

/// Calls `stop` for every signal, on a separate thread.
///
/// # Errors
/// If the handlers cannot be installed.
pub(crate) fn watch(stop: impl Fn() + Send + 'static) -> io::Result<SignalWatch> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGXCPU])?;
    let watch = SignalWatch(signals.handle());
    thread::Builder::new().name("signals".to_owned()).spawn(move || {
        for signal in signals.forever() {
            if signal == SIGXCPU {
                print_message("the limit of core-seconds is reached; lift it: `ulimit -t unlimited`");
            }
            stop();
        }
    })?;
    Ok(watch)
}

/// Sends SIGTERM to this process when its standard input ends, which shows that its parent is gone. It does
/// so again and again, because a signal that comes between two watches is lost.
///
/// # Errors
/// If no thread can be started.
pub(crate) fn terminate_at_end_of_input() -> io::Result<()> {
    thread::Builder::new().name("lifeline".to_owned()).spawn(|| {
        // An error ends the input, too.
        let _ = io::copy(&mut io::stdin(), &mut io::sink());
        while signal_hook::low_level::raise(SIGTERM).is_ok() {
            thread::sleep(RAISE_INTERVAL);
        }
    })?;
    Ok(())
}

impl Drop for SignalWatch {
    fn drop(&mut self) {
        self.0.close();
    }
}
