//! `hypogeum replay`: stored episodes done again, and whether they come out the same.

use std::path::Path;
use std::sync::Mutex;

use anyhow::Context;
use ipc_types::ControlMode;
use rayon::prelude::*;
use sim::demo::Recording;
use sim::render::CpuRenderer;
use sim::show::EpisodeSpec;
use sim::show::movie::MovieFormat;
use sim::show::{HighResScene, contact_sheet};
use sim::stream::Stream;

use crate::cli::ReplayArgs;
use crate::demos::Stored;
use crate::failure::{Ending, Failure, OrUser};
use crate::movie;
use crate::progress::{Progress, print};
use crate::report::{Align, Table, print_out};
use crate::results::Kept;

/// What it takes to do an episode again, but for its actions.
#[derive(Clone, Debug)]
pub(crate) struct StoredEpisode {
    /// Who acted.
    pub(crate) policy: String,
    pub(crate) subject: EpisodeSpec,
    /// Index of the episode under the suite seed.
    pub(crate) index: u32,
    /// Of the episode.
    pub(crate) seed: u64,
    /// How its action rows are meant.
    pub(crate) mode: ControlMode,
    /// Control steps.
    pub(crate) n_steps: u32,
    /// Hexadecimal.
    pub(crate) fingerprint: String,
}

impl StoredEpisode {
    /// For messages.
    pub(crate) fn name(&self) -> String {
        let Self { policy, subject, index, .. } = self;
        format!("{policy}'s {} {} episode {index}", subject.task.name(), subject.perturbation.name())
    }

    /// Numbers in all its action rows.
    pub(crate) fn n_numbers(&self) -> usize {
        self.n_steps as usize * self.mode.action_dim(self.subject.task.task().morphology)
    }
}

/// Where episodes are stored.
enum Source {
    Dataset(Stored),
    Results(Kept),
}

impl Source {
    fn open(path: &Path) -> anyhow::Result<Self> {
        if path.is_file() {
            Kept::open(path).map(Self::Results)
        } else {
            Stored::open(path).map(Self::Dataset)
        }
    }

    fn episodes(&self) -> &[StoredEpisode] {
        match self {
            Self::Dataset(stored) => stored.episodes(),
            Self::Results(kept) => kept.episodes(),
        }
    }

    /// The episode that the stored actions make.
    fn again(&self, episode_idx: usize) -> anyhow::Result<Recording> {
        let StoredEpisode { subject, seed, mode, .. } = self.episodes()[episode_idx];
        let actions = match self {
            Self::Dataset(stored) => stored.actions(episode_idx),
            Self::Results(kept) => kept.actions(episode_idx),
        }?;
        Recording::replay(subject, seed, mode, &actions)
            .with_context(|| format!("episode {episode_idx} cannot be replayed"))
    }
}

/// Replays episodes of a dataset or a results file.
pub(crate) fn replay(args: &ReplayArgs) -> Result<Ending, Failure> {
    let source = Source::open(&args.source).or_user()?;
    let chosen = chosen(args, source.episodes()).or_user()?;
    if let Some(path) = &args.movie {
        return draw_movie(&source, chosen[0], path, args.scale).or_user();
    }
    let progress = Mutex::new(Progress::of_replays(chosen.len() as u64, args.quiet));
    let replayed: Vec<(usize, u64)> = chosen
        .into_par_iter()
        .map(|episode_idx| {
            let fingerprint = source.again(episode_idx)?.fingerprint();
            progress.lock().unwrap_or_else(std::sync::PoisonError::into_inner).tick();
            Ok((episode_idx, fingerprint))
        })
        .collect::<anyhow::Result<_>>()
        .or_user()?;
    progress.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner).finish();
    report(source.episodes(), &replayed)
}

/// Those asked for, a sample of them, or all.
fn chosen(args: &ReplayArgs, episodes: &[StoredEpisode]) -> anyhow::Result<Vec<usize>> {
    let (path, n) = (args.source.display(), episodes.len());
    anyhow::ensure!(n > 0, "{path} has no episodes yet");
    if let Some(&beyond) = args.episodes.iter().find(|idx| **idx >= n) {
        anyhow::bail!("{path} has {n} episodes, asked for is {beyond} (the first is 0)");
    }
    if !args.episodes.is_empty() {
        return Ok(args.episodes.clone());
    }
    let is_meant = |episode: &StoredEpisode| {
        args.policy.as_ref().is_none_or(|name| *name == episode.policy)
            && args.task.is_none_or(|task| task == episode.subject.task)
            && args.perturbation.is_none_or(|perturbation| perturbation == episode.subject.perturbation)
    };
    let mut meant: Vec<usize> = (0..n).filter(|&idx| is_meant(&episodes[idx])).collect();
    anyhow::ensure!(
        !meant.is_empty(),
        "none of the {n} episodes in {path} is of that policy, task and perturbation"
    );
    if let Some(sample) = args.sample {
        let mut stream = Stream::new(args.seed, "replay");
        let n_drawn = sample.min(meant.len());
        return Ok((0..n_drawn)
            .map(|_| meant.swap_remove((stream.unit() * meant.len() as f64) as usize))
            .collect());
    }
    Ok(meant)
}

fn report(episodes: &[StoredEpisode], replayed: &[(usize, u64)]) -> Result<Ending, Failure> {
    use Align::{Left, Right};
    let mut table = Table::new(&[
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
        let StoredEpisode { policy, subject, n_steps, fingerprint: kept, .. } = &episodes[*episode_idx];
        let found = shown(*fingerprint);
        let is_same = found == *kept;
        n_same += usize::from(is_same);
        table.row(vec![
            episode_idx.to_string(),
            policy.clone(),
            subject.task.name().to_owned(),
            subject.perturbation.name(),
            n_steps.to_string(),
            kept.clone(),
            if is_same { "same".to_owned() } else { found },
        ]);
    }
    print_out(&table.to_string())?;
    print(&format!("{n_same} of {} episodes have the fingerprint they had", replayed.len()));
    Ok(if n_same == replayed.len() { Ending::Done } else { Ending::WithErrors })
}

/// The episode as a movie of all cameras, in `scale` times as many pixels as policies see along each edge.
fn draw_movie(source: &Source, episode_idx: usize, path: &Path, scale: usize) -> anyhow::Result<Ending> {
    let format = MovieFormat::from_path(path)?;
    let recording = source.again(episode_idx)?;
    let view = HighResScene::new(recording.scene(), scale);
    let mut renderer = CpuRenderer::new(rayon::current_num_threads());
    let ending = movie::write(path, format, recording.n_frames(), |frame| {
        let images = view.photograph(&mut renderer, recording.snapshot(frame));
        contact_sheet::compose(&images, images.len(), 1)
    })?;
    if ending != Ending::Done {
        return Ok(ending);
    }
    print(&format!("wrote {}", path.display()));
    if shown(recording.fingerprint()) == source.episodes()[episode_idx].fingerprint {
        return Ok(Ending::Done);
    }
    print(&format!("episode {episode_idx} does not have the fingerprint it had"));
    Ok(Ending::WithErrors)
}

/// A fingerprint as it is stored.
pub(crate) fn shown(fingerprint: u64) -> String {
    format!("{fingerprint:016x}")
}
