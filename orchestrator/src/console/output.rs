//! Writing to the terminal: results on stdout, messages on stderr.

use std::io::{self, Write};

use run_config::{one_line, printable};
use thiserror::Error;

/// An error that occurred while writing results to stdout, such as a full disk.
#[derive(Debug, Error)]
#[error("failed to write to standard output")]
pub(crate) struct OutputError(#[from] io::Error);

/// Writes `text` to stdout, without what would command a terminal. A closed pipe (`| head`) is not an error:
/// its reader has seen enough.
///
/// # Errors
/// If stdout cannot be written for another reason.
pub(crate) fn print_out(text: &str) -> Result<(), OutputError> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(printable(text).as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        result => result.map_err(OutputError::from),
    }
}

/// Writes one line to stderr. What it quotes from outside can neither command a terminal nor fill it.
pub(crate) fn print_message(line: &str) {
    // If stderr is closed, nobody reads the line, which is no reason to stop.
    let _ = writeln!(io::stderr().lock(), "{}", one_line(line));
}
