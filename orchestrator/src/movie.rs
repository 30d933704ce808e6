//! Movies frame by frame, with progress, until they are done or the user has enough.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use sim::show::contact_sheet::RgbImage;
use sim::show::movie::{MovieFormat, MovieWriter};

use crate::failure::Ending;
use crate::interrupt;
use crate::progress::{Progress, print};

/// Writes `picture(0)` to `picture(n_frames - 1)`.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn write(
    path: &Path,
    format: MovieFormat,
    n_frames: usize,
    mut picture: impl FnMut(usize) -> RgbImage,
) -> anyhow::Result<Ending> {
    let stopped = Arc::new(AtomicBool::new(false));
    let stop = Arc::clone(&stopped);
    let _watch = interrupt::watch(move || stop.store(true, Ordering::Relaxed))
        .context("failed to watch for signals")?;
    let mut progress = Progress::of_frames(n_frames as u64);
    let mut movie = MovieWriter::begin(path, format, n_frames, picture(0))?;
    progress.tick();
    for frame in 1..n_frames {
        if stopped.load(Ordering::Relaxed) {
            progress.finish();
            print(&format!("interrupted; {} is not written", path.display()));
            return Ok(Ending::Interrupted);
        }
        movie.push(picture(frame))?;
        progress.tick();
    }
    movie.finish()?;
    progress.finish();
    Ok(Ending::Done)
}
