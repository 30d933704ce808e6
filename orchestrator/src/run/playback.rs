//! Stored episodes from any source, executed again and shown.

use std::path::Path;

use anyhow::Context;
use sim::demo::Recording;
use sim::render::{CpuOptions, CpuRenderer};
use sim::show::movie::MovieFormat;
use sim::show::{HighResScene, contact_sheet};

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
    pub(crate) fn replay(&self, episode_idx: usize) -> anyhow::Result<Recording> {
        let StoredEpisode { subject, seed, mode, .. } = self.episodes()[episode_idx];
        let actions = match self {
            Self::Dataset(dataset) => dataset.actions(episode_idx),
            Self::Results(results) => results.actions(episode_idx),
        }?;
        Recording::replay(subject, seed, mode, &actions)
            .with_context(|| format!("failed to replay episode {episode_idx}"))
    }
}

/// An episode that has been replayed, and how to render it.
pub(crate) struct MovieEpisode {
    pub(crate) recording: Recording,
    pub(crate) scene: HighResScene,
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
    let recordings = flip.sides.iter().map(replay).collect::<anyhow::Result<Vec<_>>>()?;
    let episode = |recording: Recording| {
        let scene = HighResScene::new(recording.scene(), 1);
        MovieEpisode { recording, scene }
    };
    let replayed: Vec<MovieEpisode> = recordings.into_iter().map(episode).collect();
    let n_steps = replayed.iter().map(|episode| episode.recording.n_frames()).max().unwrap_or(0);
    let stride = usize::from(FLIP_STRIDE);
    let mut renderer = CpuRenderer::with_options(rayon::current_num_threads(), CpuOptions::default());
    movie::write(path, MovieFormat::from_path(path)?, n_steps.div_ceil(stride), FLIP_STRIDE, |frame| {
        let step = frame * stride;
        let snapshot =
            |it: &MovieEpisode| it.recording.snapshot(step.min(it.recording.n_frames() - 1)).clone();
        let camera = |it: &MovieEpisode| it.scene.photograph_camera(&mut renderer, &snapshot(it), 0);
        let images: Vec<(usize, Vec<u8>)> = replayed.iter().map(camera).collect();
        contact_sheet::compose(&images, images.len(), 1)
    })?;
    Ok(())
}
