//! Progress display on stderr: a bar on a terminal, occasional lines otherwise.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use sim::serve::protocol::Counters;

use crate::output::print_message;

/// Interval between lines if stderr is not a terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// The progress display of a long operation.
#[derive(Debug)]
pub(crate) enum Progress {
    /// A bar on a terminal.
    Bar(ProgressBar),
    /// Occasional lines on stderr.
    Lines(Lines),
    /// Only logged lines.
    Silent,
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

    fn of(unit: &'static str, n: u64, done: u64, quiet: bool, json: bool) -> Self {
        match (quiet, io::stderr().is_terminal(), json) {
            (true, _, _) | (_, false, true) => Self::Silent,
            (false, true, _) => {
                let bar = ProgressBar::new(n).with_position(done);
                let template = format!("{{bar:32}} {{pos}}/{{len}} {unit} {{msg}}, {{eta}} left");
                bar.set_style(
                    ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar()),
                );
                bar.enable_steady_tick(Duration::from_millis(500));
                bar.reset_eta();
                Self::Bar(bar)
            }
            (false, false, false) => {
                let now = Instant::now();
                let speed = String::new();
                Self::Lines(Lines { unit, n, done, done_before: done, started: now, printed: now, speed })
            }
        }
    }

    /// Counts one finished item.
    pub(crate) fn tick(&mut self) {
        match self {
            Self::Bar(bar) => bar.inc(1),
            Self::Lines(lines) => {
                lines.done += 1;
                lines.print_if_due();
            }
            Self::Silent => {}
        }
    }

    /// Updates the displayed speed.
    pub(crate) fn counters(&mut self, counters: &Counters) {
        let speed = || format!(", {:.0} env-steps/s", counters.env_steps as f64 / counters.wall_s.max(1e-9));
        match self {
            Self::Bar(bar) if counters.env_steps > 0 => bar.set_message(speed()),
            Self::Lines(lines) if counters.env_steps > 0 => {
                lines.speed = speed();
                lines.print_if_due();
            }
            Self::Bar(_) | Self::Lines(_) | Self::Silent => {}
        }
    }

    /// Prints a line that remains visible.
    pub(crate) fn log(&self, line: &str) {
        match self {
            Self::Bar(bar) => bar.suspend(|| print_message(line)),
            Self::Lines(_) | Self::Silent => print_message(line),
        }
    }

    /// Removes the bar.
    pub(crate) fn finish(&self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
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
        let left = match self.done - self.done_before {
            0 => "unknown time".to_owned(),
            n => {
                let seconds = elapsed.as_secs_f64() / n as f64 * (self.n - self.done) as f64;
                format!("{seconds:.0} s")
            }
        };
        format!("{}/{} {}{}, {left} left", self.done, self.n, self.unit, self.speed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_shows_count_speed_and_time_left() {
        let now = Instant::now();
        let speed = ", 512 env-steps/s".to_owned();
        let mut lines =
            Lines { unit: "episodes", n: 60, done: 20, done_before: 20, started: now, printed: now, speed };
        insta::assert_snapshot!(lines.line(Duration::from_secs(3)), @"20/60 episodes, 512 env-steps/s, unknown time left");
        lines.done = 30;
        insta::assert_snapshot!(lines.line(Duration::from_secs(5)), @"30/60 episodes, 512 env-steps/s, 15 s left");
    }
}
