//! The end of a child process whose parent is gone.

use std::io::{self, Read};
use std::time::Duration;

/// Time between the end of the input and the end of the process, for work that is in progress.
const GRACE: Duration = Duration::from_secs(4);
/// Exit code of a process that did not end by itself in that time.
const EXIT_CODE: i32 = 3;

/// The standard input of a child process, whose end asks it to exit. The process is terminated four seconds
/// later if it is still there: whatever it waits for, nobody waits for it.
#[derive(Debug)]
pub struct Lifeline<R>(pub R);

impl<R: Read> Read for Lifeline<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.0.read(buffer);
        // An error ends the input, too.
        if !buffer.is_empty() && !matches!(read, Ok(1..)) && !is_interrupted(&read) {
            let ended = std::thread::Builder::new().name("lifeline".to_owned()).spawn(|| {
                std::thread::sleep(GRACE);
                std::process::exit(EXIT_CODE);
            });
            // Without another thread, this one has to wait.
            if ended.is_err() {
                std::thread::sleep(GRACE);
                std::process::exit(EXIT_CODE);
            }
        }
        read
    }
}

fn is_interrupted(read: &io::Result<usize>) -> bool {
    read.as_ref().is_err_and(|error| error.kind() == io::ErrorKind::Interrupted)
}
