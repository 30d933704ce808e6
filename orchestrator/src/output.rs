//! Writing to the terminal: results on stdout, messages on stderr.

use std::io::{self, Write};

use thiserror::Error;

/// An error that occurred while writing results to stdout, such as a full disk.
#[derive(Debug, Error)]
#[error("failed to write to standard output")]
pub(crate) struct OutputError(#[from] io::Error);

/// Writes `text` to stdout. A closed pipe (`| head`) is not an error: its reader has seen enough.
///
/// # Errors
/// If stdout cannot be written for another reason.
pub(crate) fn print_out(text: &str) -> Result<(), OutputError> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        result => result.map_err(OutputError::from),
    }
}

/// Writes one line to stderr.
pub(crate) fn print_message(line: &str) {
    // If stderr is closed, nobody reads the line, which is no reason to stop.
    let _ = writeln!(io::stderr().lock(), "{line}");
}
