//! Progress display on stderr: a bar on a terminal, occasional lines otherwise.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use sim::serve::protocol::Counters;

use crate::console::output::print_message;

/// Interval between lines if stderr is not a terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(10);

/// The progress display of a long operation.
#[derive(Debug)]
pub(crate) enum Progress {
    /// A bar on a terminal, with the status below it.
    Bar(BarState),
    /// Occasional lines on stderr.
    Lines(Lines),
    /// Only logged lines.
    Silent,
}

/// The state of a bar.
#[derive(Debug)]
pub(crate) struct BarState {
    bar: ProgressBar,
    speed: String,
    status: String,
}

/// The state behind progress lines.
#[derive(Debug)]
pub(crate) struct Lines {
    /// Name of the counted items, plural.
    unit: &'static str,
    n: u64,
    done: u64,
    /// Items that were done before the operation started.
    done_before: u64,
    started: Instant,
    printed: Instant,
    speed: String,
    status: String,
}

impl Progress {
    /// Shows the progress of a run of `n_episodes`, of which earlier runs finished `done`.
    pub(crate) fn of_run(n_episodes: u64, done: u64, quiet: bool, json: bool) -> Self {
        Self::of("episodes", n_episodes, done, quiet, json)
    }

    /// Shows the progress of a movie.
    pub(crate) fn of_frames(n_frames: u64) -> Self {
        Self::of("frames", n_frames, 0, false, false)
    }

    /// Shows the progress of a dataset of `n` demonstrations, of which earlier commands recorded `done`.
    pub(crate) fn of_demonstrations(n: u64, done: u64, quiet: bool) -> Self {
        Self::of("demonstrations", n, done, quiet, false)
    }

    /// Shows the progress of replays.
    pub(crate) fn of_replays(n: u64, quiet: bool) -> Self {
        Self::of("episodes", n, 0, quiet, false)
    }

    /// Shows the progress of a measurement with `n` points, of which earlier commands measured `done`.
    pub(crate) fn of_points(n: u64, done: u64, quiet: bool, json: bool) -> Self {
        Self::of("points", n, done, quiet, json)
    }

    /// Shows the progress of a file of this many MiB.
    pub(crate) fn of_mebibytes(n: u64) -> Self {
        Self::of("MiB", n, 0, false, false)
    }

    /// Shows the progress of merging `n` rows.
    pub(crate) fn of_rows(n: u64, quiet: bool) -> Self {
        Self::of("rows", n, 0, quiet, false)
    }

    fn of(unit: &'static str, n: u64, done: u64, quiet: bool, json: bool) -> Self {
        match (quiet, io::stderr().is_terminal(), json) {
            (true, _, _) | (_, false, true) => Self::Silent,
            (false, true, _) => {
                let bar = ProgressBar::new(n).with_position(done);
                let template = format!("{{bar:32}} {{pos}}/{{len}} {unit}, {{per_sec}}{{msg}}");
                bar.set_style(
                    ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar()),
                );
                bar.enable_steady_tick(Duration::from_millis(500));
                bar.reset_eta();
                Self::Bar(BarState { bar, speed: String::new(), status: String::new() })
            }
            (false, false, false) => {
                let now = Instant::now();
                Self::Lines(Lines {
                    unit,
                    n,
                    done,
                    done_before: done,
                    started: now,
                    printed: now,
                    speed: String::new(),
                    status: String::new(),
                })
            }
        }
    }

    /// Counts one finished item.
    pub(crate) fn tick(&mut self) {
        self.advance(1);
    }

    /// Counts finished items.
    pub(crate) fn advance(&mut self, n_items: u64) {
        match self {
            Self::Bar(bar) => {
                bar.bar.inc(n_items);
                bar.show();
            }
            Self::Lines(lines) => {
                lines.done += n_items;
                lines.print_if_due();
            }
            Self::Silent => {}
        }
    }

    /// Reduces the number of items that will be done.
    pub(crate) fn skip(&mut self, n_items: u64) {
        match self {
            Self::Bar(bar) => bar.bar.dec_length(n_items),
            Self::Lines(lines) => lines.n = lines.n.saturating_sub(n_items),
            Self::Silent => {}
        }
    }

    /// Updates the displayed speed.
    pub(crate) fn counters(&mut self, counters: &Counters) {
        let speed = || format!(", {:.0} env-steps/s", counters.env_steps as f64 / counters.wall_s.max(1e-9));
        match self {
            Self::Bar(bar) if counters.env_steps > 0 => {
                bar.speed = speed();
                bar.show();
            }
            Self::Lines(lines) if counters.env_steps > 0 => {
                lines.speed = speed();
                lines.print_if_due();
            }
            Self::Bar(_) | Self::Lines(_) | Self::Silent => {}
        }
    }

    /// Updates what is shown of the results so far, one line per part.
    pub(crate) fn status(&mut self, parts: &[String]) {
        match self {
            Self::Bar(bar) => bar.status = parts.iter().map(|part| format!("\n  {part}")).collect(),
            Self::Lines(lines) => lines.status = parts.iter().map(|part| format!("; {part}")).collect(),
            Self::Silent => {}
        }
    }

    /// Prints a line that remains visible.
    pub(crate) fn log(&self, line: &str) {
        match self {
            Self::Bar(bar) => bar.bar.suspend(|| print_message(line)),
            Self::Lines(_) | Self::Silent => print_message(line),
        }
    }

    /// Removes the bar.
    pub(crate) fn finish(&self) {
        if let Self::Bar(bar) = self {
            bar.bar.finish_and_clear();
        }
    }
}

impl BarState {
    fn show(&self) {
        let left = format_seconds(self.bar.eta().as_secs_f64());
        self.bar.set_message(format!("{}, {left} left{}", self.speed, self.status));
    }
}

impl Lines {
    fn print_if_due(&mut self) {
        if self.printed.elapsed() >= LINE_INTERVAL {
            self.printed = Instant::now();
            print_message(&self.line(self.started.elapsed()));
        }
    }

    fn line(&self, elapsed: Duration) -> String {
        let (left, rate) = match self.done - self.done_before {
            0 => ("unknown time".to_owned(), String::new()),
            n => {
                let per_second = n as f64 / elapsed.as_secs_f64();
                let left = self.n.saturating_sub(self.done) as f64 / per_second;
                (format_seconds(left), format!(", {per_second:.1} {}/s", self.unit))
            }
        };
        let Self { done, n, unit, speed, status, .. } = self;
        format!("{done}/{n} {unit}{rate}{speed}, {left} left{status}")
    }
}

/// Formats a duration with one unit, or two where one would be coarse.
pub(crate) fn format_seconds(seconds: f64) -> String {
    let whole = seconds.ceil() as u64;
    match whole {
        0..120 => format!("{whole} s"),
        120..7200 => format!("{} min", whole.div_ceil(60)),
        _ => format!("{} h {} min", whole / 3600, whole % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_shows_count_speed_and_time_left() {
        let now = Instant::now();
        let mut lines = Lines {
            unit: "episodes",
            n: 60,
            done: 20,
            done_before: 20,
            started: now,
            printed: now,
            speed: ", 512 env-steps/s".to_owned(),
            status: "; act 80.0 %".to_owned(),
        };
        insta::assert_snapshot!(lines.line(Duration::from_secs(3)), @"20/60 episodes, 512 env-steps/s, unknown time left; act 80.0 %");
        lines.done = 30;
        insta::assert_snapshot!(lines.line(Duration::from_secs(5)), @"30/60 episodes, 2.0 episodes/s, 512 env-steps/s, 15 s left; act 80.0 %");
    }
}
