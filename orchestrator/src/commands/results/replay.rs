//! `hypogeum replay`: replays stored episodes and compares their fingerprints with the stored ones.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{bail, ensure};
use clap::Args;
use rayon::prelude::*;
use run_config::Samples;
use sim::TaskId;
use sim::perturb::Composition;
use sim::scene::stream::Stream;
use sim::show::SCALES;

use crate::commands::results::trajectory;
use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::{print_message, print_out};
use crate::console::output_files::Overwriting;
use crate::console::progress::Progress;
use crate::console::table::{Align, TextTable};
use crate::console::threads::start_threads;
use crate::run::playback::{EpisodeSource, MovieOptions, ReplayedEpisode, write_movie};
use crate::selection::selectors::{PERTURBATION_PARSER, TASK_PARSER};
use crate::store::stored_episode::{StoredEpisode, format_fingerprint};

/// Arguments of `replay`.
#[derive(Debug, Args)]
pub(crate) struct ReplayArgs {
    /// Dataset, which is single/ or bimanual/ in a folder that `demos` wrote, or a results file of
    /// `run`
    #[arg(value_name = "DATASET|FILE.db", required_unless_present = "start")]
    pub(crate) source: Option<PathBuf>,
    /// Instead of stored episodes, start in the state of this file (docs/trajectories.md)
    #[arg(long, value_name = "FILE", requires = "actions",
        conflicts_with_all = ["source", "episodes", "policy", "task", "perturbation", "index", "sample", "grid"])]
    pub(crate) start: Option<PathBuf>,
    /// Execute the actions of this file, which may be the same
    #[arg(long, value_name = "FILE", requires = "start")]
    pub(crate) actions: Option<PathBuf>,
    /// Print the state after every step as JSON
    #[arg(long, requires = "start", conflicts_with = "movie")]
    pub(crate) json: bool,
    /// Episodes, comma-separated indices into the source [default: all, or the first for a movie]
    #[arg(long, value_name = "LIST", value_delimiter = ',',
        conflicts_with_all = ["policy", "task", "perturbation"])]
    pub(crate) episodes: Vec<usize>,
    /// Only episodes of this policy, by its name in the results
    #[arg(long, value_name = "NAME")]
    pub(crate) policy: Option<String>,
    /// Only episodes of this task
    #[arg(long, value_name = "NAME", value_parser = TASK_PARSER, hide_possible_values = true)]
    pub(crate) task: Option<TaskId>,
    /// Only episodes under this perturbation, or under these joined by +
    #[arg(long, value_name = "NAME", value_parser = PERTURBATION_PARSER, hide_possible_values = true)]
    pub(crate) perturbation: Option<Composition>,
    /// Only the episode with this index under the suite seed, as in the column `episode` of results
    #[arg(long, value_name = "N", conflicts_with = "episodes")]
    pub(crate) index: Option<u32>,
    /// Replay a random sample of this many of them
    #[arg(long, value_name = "N", conflicts_with_all = ["episodes", "movie"])]
    pub(crate) sample: Option<usize>,
    /// Seed of the sample
    #[arg(long, value_name = "S", default_value_t = 0, requires = "sample")]
    pub(crate) seed: u64,
    /// Write the first of them as a movie of all cameras: .png or .apng (lossless), .gif (small) or .mp4
    /// (smallest; needs ffmpeg)
    #[arg(long, value_name = "FILE")]
    pub(crate) movie: Option<PathBuf>,
    /// Movie resolution as a multiple, 1 to 8, of what policies receive: 224 pixels per edge for external
    /// cameras, 128 for hand cameras
    #[arg(long, value_name = "N", default_value_t = 1, requires = "movie", value_parser = parse_scale)]
    pub(crate) scale: usize,
    /// Samples per pixel of the movie
    #[arg(long, value_enum, default_value_t = Samples::One, requires = "movie")]
    pub(crate) samples: Samples,
    /// Show all selected episodes side by side in the movie, the first external camera of each
    #[arg(long, requires = "movie")]
    pub(crate) grid: bool,
    /// Keep every Nth frame of the movie, which plays at the same speed
    #[arg(long, value_name = "N", default_value_t = 1, requires = "movie",
        value_parser = clap::value_parser!(u16).range(1..=20))]
    pub(crate) stride: u16,
    #[command(flatten)]
    pub(crate) overwriting: Overwriting,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Replays episodes of a dataset or a results file.
pub(crate) fn replay(args: &ReplayArgs) -> Result<ExitStatus, Failure> {
    start_threads()?;
    args.movie.iter().try_for_each(|path| args.overwriting.check(path)).or_user()?;
    if let (Some(start), Some(actions)) = (&args.start, &args.actions) {
        return match &args.movie {
            Some(path) => {
                let episode = trajectory::record(start, actions).or_user()?;
                write_episodes(&[episode], path, args).or_user()
            }
            None => trajectory::print(start, actions, args.json),
        };
    }
    let source = EpisodeSource::open(source_path(args)).or_user()?;
    let selected = select(args, source.episodes()).or_user()?;
    if let Some(path) = &args.movie {
        let shown = if args.grid { &selected[..] } else { &selected[..1] };
        return write_stored(&source, shown, path, args).or_user();
    }
    let progress = Mutex::new(Progress::of_replays(selected.len() as u64, args.quiet));
    let replayed: Vec<(usize, u64)> = selected
        .into_par_iter()
        .map(|episode_idx| {
            let fingerprint = source.replay(episode_idx)?.recording.fingerprint();
            progress.lock().unwrap_or_else(PoisonError::into_inner).tick();
            Ok((episode_idx, fingerprint))
        })
        .collect::<anyhow::Result<_>>()
        .or_user()?;
    progress.into_inner().unwrap_or_else(PoisonError::into_inner).finish();
    report(source.episodes(), &replayed)
}

/// Returns the path of the stored episodes.
fn source_path(args: &ReplayArgs) -> &Path {
    args.source.as_deref().expect("clap requires a source without --start")
}

/// Returns the indices of the episodes that the arguments select, at least one.
fn select(args: &ReplayArgs, episodes: &[StoredEpisode]) -> anyhow::Result<Vec<usize>> {
    let (path, n) = (source_path(args).display(), episodes.len());
    ensure!(n > 0, "{path} has no episodes yet");
    if let Some(&beyond) = args.episodes.iter().find(|idx| **idx >= n) {
        bail!("{path} has {n} episodes, but episode {beyond} was requested (the first is 0)");
    }
    if !args.episodes.is_empty() {
        return Ok(args.episodes.clone());
    }
    let matches = |episode: &StoredEpisode| {
        args.policy.as_ref().is_none_or(|name| *name == episode.policy)
            && args.task.is_none_or(|task| task == episode.subject.task)
            && args.perturbation.is_none_or(|perturbation| perturbation == episode.subject.perturbation)
            && args.index.is_none_or(|index| index == episode.index)
    };
    let mut selected: Vec<usize> = (0..n).filter(|&idx| matches(&episodes[idx])).collect();
    ensure!(
        !selected.is_empty(),
        "none of the {n} episodes in {path} has that policy, task, perturbation and index"
    );
    if let Some(sample) = args.sample {
        let mut stream = Stream::new(args.seed, "replay");
        let n_drawn = sample.min(selected.len());
        return Ok((0..n_drawn)
            .map(|_| selected.swap_remove((stream.unit() * selected.len() as f64) as usize))
            .collect());
    }
    Ok(selected)
}

fn report(episodes: &[StoredEpisode], replayed: &[(usize, u64)]) -> Result<ExitStatus, Failure> {
    use Align::{Left, Right};
    let mut table = TextTable::new(&[
        ("episode", Right),
        ("policy", Left),
        ("task", Left),
        ("perturbation", Left),
        ("steps", Right),
        ("stored", Left),
        ("replayed", Left),
    ]);
    let mut n_same = 0;
    for (episode_idx, fingerprint) in replayed {
        let StoredEpisode { policy, subject, n_steps, fingerprint: stored, .. } = &episodes[*episode_idx];
        let found = format_fingerprint(*fingerprint);
        let is_same = found == *stored;
        n_same += usize::from(is_same);
        table.row(vec![
            episode_idx.to_string(),
            policy.clone(),
            subject.task.name().to_owned(),
            subject.perturbation.name(),
            n_steps.to_string(),
            stored.clone(),
            if is_same { "same".to_owned() } else { found },
        ]);
    }
    print_out(&table.to_string())?;
    print_message(&format!("{n_same} of {} episodes reproduce the stored fingerprint", replayed.len()));
    Ok(if n_same == replayed.len() { ExitStatus::Success } else { ExitStatus::EpisodeErrors })
}

/// Writes a movie of stored episodes and compares their fingerprints with the stored ones.
fn write_stored(
    source: &EpisodeSource,
    episodes: &[usize],
    path: &Path,
    args: &ReplayArgs,
) -> anyhow::Result<ExitStatus> {
    let replayed: Vec<ReplayedEpisode> =
        episodes.par_iter().map(|idx| source.replay(*idx)).collect::<anyhow::Result<_>>()?;
    let mut status = write_episodes(&replayed, path, args)?;
    for (&episode_idx, ReplayedEpisode { recording, .. }) in episodes.iter().zip(&replayed) {
        if status == ExitStatus::Success
            && format_fingerprint(recording.fingerprint()) != source.episodes()[episode_idx].fingerprint
        {
            print_message(&format!("episode {episode_idx} does not reproduce the stored fingerprint"));
            status = ExitStatus::EpisodeErrors;
        }
    }
    Ok(status)
}

/// Writes a movie of one episode with all cameras, or of several with the first external camera of each.
fn write_episodes(
    episodes: &[ReplayedEpisode],
    path: &Path,
    args: &ReplayArgs,
) -> anyhow::Result<ExitStatus> {
    let &ReplayArgs { scale, samples, stride, grid, .. } = args;
    let grid = grid.then(|| episodes.len().div_ceil(2).clamp(1, 4));
    let status = write_movie(path, episodes, &MovieOptions { grid, scale, samples, stride })?;
    if status == ExitStatus::Success {
        print_message(&format!("wrote {}", path.display()));
    }
    Ok(status)
}

fn parse_scale(typed: &str) -> Result<usize, String> {
    let scales = SCALES;
    typed
        .parse()
        .ok()
        .filter(|scale| scales.contains(scale))
        .ok_or_else(|| format!("expected {} to {}", scales.start(), scales.end()))
}
