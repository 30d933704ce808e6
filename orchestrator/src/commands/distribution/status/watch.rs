//! Progress of the shards of a sweep while it changes.

use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};

use crate::commands::distribution::status::overview::{MAX_AGE, Overview};
use crate::commands::distribution::status::shard_status::ShardHealth;
use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::interrupt;
use crate::console::output::{print_message, print_out};
use crate::store::shards::ShardsFolder;

/// Time between two looks at the folder.
const INTERVAL: Duration = Duration::from_secs(3);
/// Longest time between two lines if stderr is not a terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(60);
/// Time between two looks at the signals.
const TICK: Duration = Duration::from_millis(100);

/// The display of progress on stderr: redrawn in place on a terminal; otherwise a line whenever the phase of
/// a shard has changed, and once a minute.
#[derive(Debug)]
pub(crate) struct StatusLines {
    /// The terminal.
    bar: Option<ProgressBar>,
    /// The last line's time and phases.
    last: Option<(Instant, Vec<ShardHealth>)>,
}

impl StatusLines {
    pub(crate) fn new() -> Self {
        let spinner = || {
            let style = ProgressStyle::with_template("{msg}");
            ProgressBar::new_spinner().with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
        };
        Self { bar: io::stderr().is_terminal().then(spinner), last: None }
    }

    /// Shows an overview.
    pub(crate) fn show(&mut self, overview: &Overview) {
        if let Some(bar) = &self.bar {
            bar.set_message(overview.text());
            bar.tick();
            return;
        }
        let phases: Vec<_> = overview.shards.iter().map(|shard| shard.health).collect();
        let is_news = |(time, shown): &(Instant, Vec<_>)| time.elapsed() >= LINE_INTERVAL || *shown != phases;
        if self.last.as_ref().is_none_or(is_news) {
            print_message(&overview.line());
            self.last = Some((Instant::now(), phases));
        }
    }

    /// Prints a line that remains visible.
    pub(crate) fn log(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| print_message(line)),
            None => print_message(line),
        }
    }

    /// Removes the display from the terminal.
    pub(crate) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Shows the progress until no task will change anything any more, and then the final state.
pub(crate) fn watch(folder: &ShardsFolder) -> Result<ExitStatus, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    let request = Arc::clone(&stop);
    let _watch = interrupt::watch(move || request.store(true, Ordering::Relaxed))
        .context("failed to install signal handlers")?;
    let mut lines = StatusLines::new();
    loop {
        let overview = Overview::read(folder, Some(MAX_AGE)).inspect_err(|_| lines.finish()).or_user()?;
        let looked = Instant::now();
        if overview.is_final() {
            lines.finish();
            print_out(&overview.text())?;
            return Ok(overview.exit_status());
        }
        lines.show(&overview);
        while looked.elapsed() < INTERVAL {
            if stop.load(Ordering::Relaxed) {
                lines.finish();
                return Ok(ExitStatus::Interrupted);
            }
            thread::sleep(TICK);
        }
    }
}
