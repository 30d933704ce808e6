//! Writing to the terminal: results on stdout, messages on stderr.

use std::io::{self, Write};

/// Writes `text` to stdout. A closed pipe (`| head`) is not an error: its reader has seen enough.
///
/// # Errors
/// If stdout cannot be written for another reason.
pub(crate) fn print_out(text: &str) -> io::Result<()> {
    match io::stdout().lock().write_all(text.as_bytes()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        result => result,
    }
}

/// Writes one line to stderr.
pub(crate) fn print_message(line: &str) {
    // If stderr is closed, nobody reads the line, which is no reason to stop.
    let _ = writeln!(io::stderr().lock(), "{line}");
}
