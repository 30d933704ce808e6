//! Moments of episodes, ready to be drawn: the rows of a sheet or the frames of a movie.

use ipc_types::ControlMode;

use super::ShowError;
use super::contact_sheet::{self, RgbImage};
use super::episode::{Script, Subject, Until, snapshot};
use super::paint::{Key, Painter, What};
use crate::physics::World;
use crate::render::RenderScene;
use crate::scene::Snapshot;

/// Pixels of a sheet per rendered pixel.
const SHEET_UPSCALE: usize = 2;

/// Moments in order, all of scenes with the same cameras and things.
pub struct Film {
    scenes: Vec<RenderScene>,
    /// Of the scenes.
    instructions: Vec<String>,
    moments: Vec<Moment>,
    painter: Painter,
}

/// One moment.
pub(super) struct Moment {
    /// Index of its scene.
    pub(super) scene_idx: usize,
    /// Where everything is.
    pub(super) snapshot: Snapshot,
}

impl Film {
    /// The starts of episodes of one task, each a subject and a seed.
    ///
    /// # Panics
    /// If there is none.
    #[must_use]
    pub fn of_starts(episodes: &[(Subject, u64)], what: What) -> Self {
        assert!(!episodes.is_empty(), "a film shows an episode");
        let drawn: Vec<_> = episodes.iter().map(|(subject, seed)| subject.draw(*seed)).collect();
        let start = |(scene_idx, scene)| Moment {
            scene_idx,
            snapshot: snapshot(scene, &World::build(scene, ControlMode::JointPos)),
        };
        let moments: Vec<Moment> = drawn.iter().enumerate().map(start).collect();
        let scenes: Vec<RenderScene> = drawn.iter().map(RenderScene::new).collect();
        let painter = Painter::new(what, &drawn, &scenes, &moments);
        let instructions = drawn.into_iter().map(|scene| scene.instruction).collect();
        Self { scenes, instructions, moments, painter }
    }

    /// The start of an episode, its first success (or its end) and the moment halfway between them.
    ///
    /// # Errors
    /// If the expert has no plan or the world blows up.
    pub fn of_highlights(
        subject: Subject,
        episode_seed: u64,
        script: Script,
        what: What,
    ) -> Result<Self, ShowError> {
        Self::along(subject, episode_seed, script, what, Until::Success, |snapshots| {
            let last = snapshots.len() - 1;
            [0, last / 2, last].map(|i| snapshots[i].clone()).into()
        })
    }

    /// A whole episode: its start and the moment after each control step.
    ///
    /// # Errors
    /// If the expert has no plan or the world blows up.
    pub fn of_episode(
        subject: Subject,
        episode_seed: u64,
        script: Script,
        what: What,
    ) -> Result<Self, ShowError> {
        Self::along(subject, episode_seed, script, what, Until::End, |snapshots| snapshots)
    }

    fn along(
        subject: Subject,
        episode_seed: u64,
        script: Script,
        what: What,
        until: Until,
        choose: impl Fn(Vec<Snapshot>) -> Vec<Snapshot>,
    ) -> Result<Self, ShowError> {
        let scene = subject.draw(episode_seed);
        let snapshots = choose(subject.roll_out(&scene, script, until)?);
        let moments: Vec<Moment> =
            snapshots.into_iter().map(|snapshot| Moment { scene_idx: 0, snapshot }).collect();
        let scenes = vec![RenderScene::new(&scene)];
        let painter = Painter::new(what, core::slice::from_ref(&scene), &scenes, &moments);
        Ok(Self { scenes, instructions: vec![scene.instruction], moments, painter })
    }

    /// Number of moments, at least 1.
    #[must_use]
    pub fn n_moments(&self) -> usize {
        self.moments.len()
    }

    /// What policies are told in each of its episodes.
    #[must_use]
    pub fn instructions(&self) -> &[String] {
        &self.instructions
    }

    /// What its colours mean.
    #[must_use]
    pub fn key(&self) -> &Key {
        self.painter.key()
    }

    /// One moment: all cameras side by side.
    ///
    /// # Panics
    /// If there is no such moment.
    #[must_use]
    pub fn picture(&mut self, moment_idx: usize) -> RgbImage {
        let images = self.images(moment_idx);
        contact_sheet::compose(&images, images.len(), 1)
    }

    /// All moments: a row of cameras for each.
    #[must_use]
    pub fn sheet(&mut self) -> RgbImage {
        let images: Vec<_> = (0..self.n_moments()).flat_map(|moment_idx| self.images(moment_idx)).collect();
        contact_sheet::compose(&images, self.scenes[0].n_cameras(), SHEET_UPSCALE)
    }

    fn images(&mut self, moment_idx: usize) -> Vec<(usize, Vec<u8>)> {
        let Moment { scene_idx, snapshot } = &self.moments[moment_idx];
        self.painter.paint(&self.scenes[*scene_idx], snapshot)
    }
}
