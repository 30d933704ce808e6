//! Writing movies frame by frame, with a progress bar and a response to interrupts.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use sim::show::contact_sheet::RgbImage;
use sim::show::movie::{MovieFormat, MovieWriter};

use crate::console::exit::ExitStatus;
use crate::console::interrupt;
use crate::console::output::print_message;
use crate::console::progress::Progress;

/// Writes `frame(0)` to `frame(n_frames - 1)`, each shown for the duration of `steps_per_frame` control
/// steps. An interrupt leaves no file.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn write(
    path: &Path,
    format: MovieFormat,
    n_frames: usize,
    steps_per_frame: u16,
    mut frame: impl FnMut(usize) -> RgbImage,
) -> anyhow::Result<ExitStatus> {
    let stopped = Arc::new(AtomicBool::new(false));
    let stop = Arc::clone(&stopped);
    let _watch = interrupt::watch(move || stop.store(true, Ordering::Relaxed))
        .context("failed to install signal handlers")?;
    let mut progress = Progress::of_frames(n_frames as u64);
    let mut movie = MovieWriter::begin(path, format, n_frames, steps_per_frame, frame(0))?;
    progress.tick();
    for frame_idx in 1..n_frames {
        if stopped.load(Ordering::Relaxed) {
            progress.finish();
            print_message(&format!("interrupted; {} is not written", path.display()));
            return Ok(ExitStatus::Interrupted);
        }
        movie.push(frame(frame_idx))?;
        progress.tick();
    }
    movie.finish()?;
    progress.finish();
    Ok(ExitStatus::Success)
}
