//! The pipes to the orchestrator: commands on stdin, events on stdout, and lines of the log on stderr.

use std::io::{self, BufRead, BufReader, Write};
use std::sync::mpsc::{Receiver, sync_channel};

use run_config::Lifeline;

use super::protocol::{SimCommand, SimEvent};

/// Capacity of the queue between the stdin reader and the loop. A full queue blocks the reader.
const COMMAND_QUEUE: usize = 1024;

/// Writes one line to stderr, which the orchestrator forwards. If nobody reads it, the line is lost.
pub(crate) fn log(message: core::fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "{message}");
}

/// Spawns a thread that parses stdin line by line. The channel closes with stdin.
pub(crate) fn read_commands() -> io::Result<Receiver<SimCommand>> {
    let (sender, receiver) = sync_channel(COMMAND_QUEUE);
    let thread = std::thread::Builder::new().name("stdin".to_owned());
    thread.spawn(move || {
        for line in BufReader::new(Lifeline(io::stdin())).lines() {
            let Ok(line) = line else { return };
            match serde_json::from_str(&line) {
                Ok(command) => {
                    if sender.send(command).is_err() {
                        return;
                    }
                }
                Err(error) => log(format_args!("ignored a malformed command: {error}")),
            }
        }
    })?;
    Ok(receiver)
}

/// Writes an event to stdout as one JSON line.
pub(crate) fn emit(event: &SimEvent) -> Result<(), io::Error> {
    let mut out = io::stdout().lock();
    serde_json::to_writer(&mut out, event)?;
    out.write_all(b"\n")?;
    out.flush()
}
