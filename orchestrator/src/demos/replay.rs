//! `hypogeum replay`: stored episodes done again, and whether they come out the same.

use std::path::Path;
use std::sync::Mutex;

use anyhow::Context;
use rayon::prelude::*;
use sim::TaskId;
use sim::demo::Recording;
use sim::render::CpuRenderer;
use sim::render::sheet;
use sim::show::Subject;
use sim::show::movie::Format;
use sim::stream::{Stream, episode_seed};

use super::dataset::{EpisodeRecord, Settings, Stored, shown};
use crate::cli::ReplayArgs;
use crate::failure::{Ending, Failure, OrUser};
use crate::movie;
use crate::names::pick;
use crate::progress::{Progress, print};
use crate::report::{Align, Table, print_out};

/// Replays episodes of a dataset.
pub(crate) fn replay(args: &ReplayArgs) -> Result<Ending, Failure> {
    let stored = Stored::open(&args.dataset).or_user()?;
    let chosen = chosen(args, stored.n_episodes()).or_user()?;
    if let Some(path) = &args.movie {
        return draw_movie(&stored, chosen[0], path).or_user();
    }
    let progress = Mutex::new(Progress::of_replays(chosen.len() as u64, args.quiet));
    let replayed: Vec<(usize, u64)> = chosen
        .into_par_iter()
        .map(|episode_idx| {
            let fingerprint = again(&stored, episode_idx)?.fingerprint();
            progress.lock().unwrap_or_else(std::sync::PoisonError::into_inner).tick();
            Ok((episode_idx, fingerprint))
        })
        .collect::<anyhow::Result<_>>()
        .or_user()?;
    progress.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner).finish();
    report(&stored, &replayed)
}

/// Those asked for, a sample of all, or all.
fn chosen(args: &ReplayArgs, n: usize) -> anyhow::Result<Vec<usize>> {
    anyhow::ensure!(n > 0, "{} has no episodes yet", args.dataset.display());
    if let Some(&beyond) = args.episodes.iter().find(|idx| **idx >= n) {
        anyhow::bail!("{} has {n} episodes, asked for is {beyond} (the first is 0)", args.dataset.display());
    }
    if let Some(sample) = args.sample {
        let mut all: Vec<usize> = (0..n).collect();
        let mut stream = Stream::new(args.seed, "replay");
        let drawn = (0..sample.min(n)).map(|_| all.swap_remove((stream.unit() * all.len() as f64) as usize));
        return Ok(drawn.collect());
    }
    if !args.episodes.is_empty() {
        return Ok(args.episodes.clone());
    }
    Ok(if args.movie.is_some() { vec![0] } else { (0..n).collect() })
}

/// The episode that the stored actions make.
fn again(stored: &Stored, episode_idx: usize) -> anyhow::Result<Recording> {
    let record = stored.record(episode_idx);
    let Settings { perturbation, strength, profile, control_mode, seed, .. } = *stored.settings();
    let task = pick("task", &record.task, TaskId::ALL, TaskId::name)?;
    let subject = Subject { task, perturbation, strength, profile };
    let actions = stored.actions(episode_idx)?;
    Recording::replay(subject, episode_seed(seed, task.name(), record.index), control_mode, &actions)
        .with_context(|| format!("episode {episode_idx} cannot be replayed"))
}

fn report(stored: &Stored, replayed: &[(usize, u64)]) -> Result<Ending, Failure> {
    use Align::{Left, Right};
    let columns =
        [("episode", Right), ("task", Left), ("frames", Right), ("stored", Left), ("replayed", Left)];
    let mut table = Table::new(&columns);
    let mut n_same = 0;
    for (episode_idx, fingerprint) in replayed {
        let EpisodeRecord { task, n_frames, fingerprint: kept, .. } = stored.record(*episode_idx);
        let found = shown(*fingerprint);
        let verdict = if found == *kept { "same".to_owned() } else { found.clone() };
        n_same += usize::from(found == *kept);
        table.row(vec![episode_idx.to_string(), task.clone(), n_frames.to_string(), kept.clone(), verdict]);
    }
    print_out(&table.to_string())?;
    print(&format!("{n_same} of {} episodes have the fingerprint they had", replayed.len()));
    Ok(if n_same == replayed.len() { Ending::Done } else { Ending::WithErrors })
}

/// The episode as a movie of all cameras.
fn draw_movie(stored: &Stored, episode_idx: usize, path: &Path) -> anyhow::Result<Ending> {
    let format = Format::of(path)?;
    let recording = again(stored, episode_idx)?;
    let (view, mut renderer) = (recording.view(), CpuRenderer::new(rayon::current_num_threads()));
    let ending = movie::write(path, format, recording.n_frames(), |frame| {
        let images = recording.draw(&view, &mut renderer, frame);
        sheet::compose(&images, images.len(), 1)
    })?;
    if ending != Ending::Done {
        return Ok(ending);
    }
    print(&format!("wrote {}", path.display()));
    if shown(recording.fingerprint()) == stored.record(episode_idx).fingerprint {
        return Ok(Ending::Done);
    }
    print(&format!("episode {episode_idx} does not have the fingerprint it had"));
    Ok(Ending::WithErrors)
}
