//! Stored episodes from any source, executed again and shown.

use std::path::Path;

use anyhow::Context;
use ipc_types::ImageSizes;
use rayon::prelude::*;
use run_config::Samples;
use sim::demo::Recording;
use sim::render::{CpuOptions, CpuRenderer, RenderScene};
use sim::show::contact_sheet::{self, Panel};
use sim::show::movie::MovieFormat;
use sim::show::scaled;

use crate::console::exit::ExitStatus;
use crate::run::movie;
use crate::store::demos::StoredDataset;
use crate::store::results::RecordedEpisodes;
use crate::store::stored_episode::StoredEpisode;
use crate::study::analysis::{Flip, FlipSide};

/// A store of episodes.
pub(crate) enum EpisodeSource {
    Dataset(StoredDataset),
    Results(RecordedEpisodes),
}

impl EpisodeSource {
    pub(crate) fn open(path: &Path) -> anyhow::Result<Self> {
        if path.is_file() {
            RecordedEpisodes::open(path).map(Self::Results)
        } else {
            StoredDataset::open(path).map(Self::Dataset)
        }
    }

    pub(crate) fn episodes(&self) -> &[StoredEpisode] {
        match self {
            Self::Dataset(dataset) => dataset.episodes(),
            Self::Results(results) => results.episodes(),
        }
    }

    /// Executes the stored actions of an episode again.
    pub(crate) fn replay(&self, episode_idx: usize) -> anyhow::Result<ReplayedEpisode> {
        let StoredEpisode { ref policy, subject, seed, mode, images, .. } = self.episodes()[episode_idx];
        let actions = match self {
            Self::Dataset(dataset) => dataset.actions(episode_idx),
            Self::Results(results) => results.actions(episode_idx),
        }?;
        let recording = Recording::replay(subject, seed, mode, &actions)
            .with_context(|| format!("failed to replay episode {episode_idx}"))?;
        Ok(ReplayedEpisode { title: format!("{policy}: {}", subject.title()), recording, images })
    }
}

/// An episode that has been replayed, and the title of its caption.
pub(crate) struct ReplayedEpisode {
    pub(crate) title: String,
    pub(crate) recording: Recording,
    /// Sizes of the images that the policy saw.
    pub(crate) images: ImageSizes,
}

/// Options of a movie of replayed episodes.
pub(crate) struct MovieOptions {
    /// Show the first external camera of every episode on a grid of so many columns, instead of all cameras
    /// of the first.
    pub(crate) grid: Option<usize>,
    pub(crate) scale: usize,
    pub(crate) samples: Samples,
    /// Control steps per frame.
    pub(crate) stride: u16,
}

/// Writes a movie of episodes. One that has ended keeps its last state.
///
/// # Errors
/// If the movie cannot be written.
pub(crate) fn write_movie(
    path: &Path,
    episodes: &[ReplayedEpisode],
    options: &MovieOptions,
) -> anyhow::Result<ExitStatus> {
    let &MovieOptions { grid, scale, samples, stride } = options;
    let format = MovieFormat::from_path(path)?;
    let prepare = |ReplayedEpisode { recording, images, .. }: &ReplayedEpisode| {
        RenderScene::new(recording.scene(), scaled(*images, scale))
    };
    let scenes: Vec<RenderScene> = episodes.par_iter().map(prepare).collect();
    let n_steps = episodes.iter().map(|episode| episode.recording.n_frames()).max().unwrap_or(0);
    let options = CpuOptions { samples, ..CpuOptions::default() };
    let mut renderer = CpuRenderer::with_options(rayon::current_num_threads(), options);
    let mut panel = |episode: &ReplayedEpisode, scene: &RenderScene, step: usize| {
        let ReplayedEpisode { title, recording, .. } = episode;
        let step = step.min(recording.n_frames());
        let snapshot = recording.snapshot(step);
        let images = match grid {
            Some(_) => renderer.render_camera_range(scene, snapshot, 0..1),
            None => renderer.render_cameras(scene, snapshot),
        };
        Panel { caption: format!("{title}\n{}", recording.outcome().after(step as u32)), images }
    };
    let n_shown = if grid.is_some() { episodes.len() } else { 1 };
    let n_frames = n_steps.div_ceil(usize::from(stride)) + 1;
    movie::write(path, format, n_frames, stride, |frame| {
        let step = frame * usize::from(stride);
        let shown = episodes.iter().zip(&scenes).take(n_shown);
        let panels: Vec<Panel> = shown.map(|(episode, scene)| panel(episode, scene, step)).collect();
        contact_sheet::compose(&panels, grid.unwrap_or(1), 1)
    })
}

/// Control steps per frame of the movie of a flip.
const FLIP_STRIDE: u16 = 3;

/// Writes a movie of both sides of a flip, next to each other, seen by the first external camera.
///
/// # Errors
/// If an episode cannot be replayed or the movie cannot be written.
pub(crate) fn write_flip_movie(flip: &Flip, path: &Path) -> anyhow::Result<()> {
    let replay = |side: &FlipSide| {
        let source = EpisodeSource::open(&side.file)?;
        let is_it = |episode: &StoredEpisode| {
            episode.policy == side.policy
                && episode.subject.task == side.condition.task
                && episode.subject.perturbation == side.condition.perturbation
                && episode.index == flip.episode
        };
        let position = source.episodes().iter().position(is_it);
        let position = position.with_context(|| format!("{} has changed", side.file.display()))?;
        source.replay(position)
    };
    let episodes = flip.sides.iter().map(replay).collect::<anyhow::Result<Vec<_>>>()?;
    let options =
        MovieOptions { grid: Some(episodes.len()), scale: 1, samples: Samples::One, stride: FLIP_STRIDE };
    write_movie(path, &episodes, &options).map(drop)
}
