//! The end of a child process whose parent is gone.

use std::io::{self, Read};
use std::time::Duration;

/// Time between the end of the input and the end of the process, for work that is in progress.
const GRACE: Duration = Duration::from_secs(4);
/// Exit code of a process that did not end by itself in that time.
const EXIT_CODE: i32 = 3;

/// The standard input of a child process, whose end asks it to exit. If the process is still running four
/// seconds later, it is terminated, because nobody needs its work any more.
#[derive(Debug)]
pub struct Lifeline<R>(pub R);

impl<R: Read> Read for Lifeline<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.0.read(buffer);
        // An error ends the input, too.
        if !buffer.is_empty() && !matches!(read, Ok(1..)) && !is_interrupted(&read) {
            let thread = std::thread::Builder::new().name("lifeline".to_owned());
            // Without another thread, this one has to wait.
            if thread.spawn(terminate).is_err() {
                terminate();
            }
        }
        read
    }
}

fn terminate() {
    std::thread::sleep(GRACE);
    std::process::exit(EXIT_CODE);
}

fn is_interrupted(read: &io::Result<usize>) -> bool {
    read.as_ref().is_err_and(|error| error.kind() == io::ErrorKind::Interrupted)
}
