//! How far long work is, for the person at the terminal. Everything goes to stderr, and nothing depends on it.

use std::io::{self, IsTerminal, Write};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use sim::serve::protocol::Counters;

/// Time between two lines where there is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// A view of the progress of a run or a movie.
#[derive(Debug)]
pub(crate) enum Progress {
    /// A bar on a terminal.
    Bar(ProgressBar),
    /// A line now and then.
    Lines(Lines),
    /// Nothing but what children log.
    Silent,
}

/// What lines are made from.
#[derive(Debug)]
pub(crate) struct Lines {
    /// What is counted.
    unit: &'static str,
    n: u64,
    done: u64,
    /// Those that were done when the work started.
    done_before: u64,
    started: Instant,
    printed: Instant,
    speed: String,
}

impl Progress {
    /// Of a run of `n_episodes`, `done` of which an earlier run has finished.
    pub(crate) fn new(n_episodes: u64, done: u64, quiet: bool, json: bool) -> Self {
        Self::of("episodes", n_episodes, done, quiet, json)
    }

    /// Of a movie.
    pub(crate) fn of_frames(n_frames: u64) -> Self {
        Self::of("frames", n_frames, 0, false, false)
    }

    /// Of a dataset of `n` demonstrations, `done` of which are there.
    pub(crate) fn of_demonstrations(n: u64, done: u64, quiet: bool) -> Self {
        Self::of("demonstrations", n, done, quiet, false)
    }

    /// Of replays.
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

    /// An episode or a frame is done.
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

    /// The sim has counted.
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

    /// A line for the person; it stays.
    pub(crate) fn log(&self, line: &str) {
        match self {
            Self::Bar(bar) => bar.suspend(|| print(line)),
            Self::Lines(_) | Self::Silent => print(line),
        }
    }

    /// The work is over: the bar goes.
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
            print(&self.line(self.started.elapsed()));
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

/// One line on stderr.
pub(crate) fn print(line: &str) {
    // Nobody reads it if stderr is closed, which is no reason to stop.
    let _ = writeln!(io::stderr().lock(), "{line}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_how_far_how_fast_how_long() {
        let now = Instant::now();
        let speed = ", 512 env-steps/s".to_owned();
        let mut lines =
            Lines { unit: "episodes", n: 60, done: 20, done_before: 20, started: now, printed: now, speed };
        insta::assert_snapshot!(lines.line(Duration::from_secs(3)), @"20/60 episodes, 512 env-steps/s, unknown time left");
        lines.done = 30;
        insta::assert_snapshot!(lines.line(Duration::from_secs(5)), @"30/60 episodes, 512 env-steps/s, 15 s left");
    }
}
