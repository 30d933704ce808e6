//! Frame sequences: the rows of a contact sheet or the frames of a movie.

use ipc_types::ControlMode;

use super::contact_sheet::{self, RgbImage};
use super::episode::{Actor, EpisodeSpec, RolloutEnd, snapshot};
use super::error::ShowError;
use super::frame_renderer::{FrameRenderer, Legend, SequenceFrame, ViewMode};
use crate::physics::World;
use render::{RenderScene, Samples};
use scene::Snapshot;

/// Pixels of a contact sheet per rendered pixel, along each axis.
const SHEET_UPSCALE: usize = 2;

/// A sequence of frames, ready to be rendered. All scenes have the same cameras and the same kinds of
/// objects.
pub struct FrameSequence {
    scenes: Vec<RenderScene>,
    /// Instruction per scene.
    instructions: Vec<String>,
    frames: Vec<SequenceFrame>,
    renderer: FrameRenderer,
}

impl FrameSequence {
    /// Creates one frame per episode: its initial state. All episodes, each a spec and a seed, are of the
    /// same task.
    ///
    /// # Panics
    /// If `episodes` is empty.
    #[must_use]
    pub fn initial_states(episodes: &[(EpisodeSpec, u64)], mode: ViewMode) -> Self {
        assert!(!episodes.is_empty(), "a sequence needs at least one episode");
        let sampled: Vec<_> = episodes.iter().map(|(spec, seed)| spec.draw(*seed)).collect();
        let initial = |(scene_idx, scene)| SequenceFrame {
            scene_idx,
            snapshot: snapshot(scene, &World::build(scene, ControlMode::JointPos)),
        };
        let frames: Vec<SequenceFrame> = sampled.iter().enumerate().map(initial).collect();
        let scenes: Vec<RenderScene> = sampled.iter().map(RenderScene::new).collect();
        let renderer = FrameRenderer::new(mode, &sampled, &scenes, &frames);
        let instructions = sampled.into_iter().map(|scene| scene.instruction).collect();
        Self { scenes, instructions, frames, renderer }
    }

    /// Creates three frames of one episode: the initial state, the first success (or the end of the episode),
    /// and the state halfway between them.
    ///
    /// # Errors
    /// If the expert has no plan or the simulation diverges.
    pub fn highlights(
        spec: EpisodeSpec,
        episode_seed: u64,
        actor: Actor,
        mode: ViewMode,
    ) -> Result<Self, ShowError> {
        Self::rollout(spec, episode_seed, actor, mode, RolloutEnd::FirstSuccess, |snapshots| {
            let last = snapshots.len() - 1;
            [0, last / 2, last].map(|i| snapshots[i].clone()).into()
        })
    }

    /// Creates the frames of a whole episode: the initial state and the state after each control step.
    ///
    /// # Errors
    /// If the expert has no plan or the simulation diverges.
    pub fn episode(
        spec: EpisodeSpec,
        episode_seed: u64,
        actor: Actor,
        mode: ViewMode,
    ) -> Result<Self, ShowError> {
        Self::rollout(spec, episode_seed, actor, mode, RolloutEnd::StepLimit, |snapshots| snapshots)
    }

    fn rollout(
        spec: EpisodeSpec,
        episode_seed: u64,
        actor: Actor,
        mode: ViewMode,
        end: RolloutEnd,
        select: impl Fn(Vec<Snapshot>) -> Vec<Snapshot>,
    ) -> Result<Self, ShowError> {
        let scene = spec.draw(episode_seed);
        let snapshots = select(spec.roll_out(&scene, actor, end)?);
        let frames: Vec<SequenceFrame> =
            snapshots.into_iter().map(|snapshot| SequenceFrame { scene_idx: 0, snapshot }).collect();
        let scenes = vec![RenderScene::new(&scene)];
        let renderer = FrameRenderer::new(mode, core::slice::from_ref(&scene), &scenes, &frames);
        Ok(Self { scenes, instructions: vec![scene.instruction], frames, renderer })
    }

    /// Sets the samples per pixel of colour images; 1 unless set.
    #[must_use]
    pub fn with_samples(mut self, samples: Samples) -> Self {
        self.renderer.set_samples(samples);
        self
    }

    /// Returns the number of frames, at least 1.
    #[must_use]
    pub fn n_frames(&self) -> usize {
        self.frames.len()
    }

    /// Returns the language instruction of each episode.
    #[must_use]
    pub fn instructions(&self) -> &[String] {
        &self.instructions
    }

    /// Returns the meaning of the colours, which is the same in all frames.
    #[must_use]
    pub fn legend(&self) -> &Legend {
        self.renderer.legend()
    }

    /// Renders one frame: the images of all cameras side by side.
    ///
    /// # Panics
    /// If `frame_idx` is out of range.
    #[must_use]
    pub fn render_frame(&mut self, frame_idx: usize) -> RgbImage {
        let images = self.camera_images(frame_idx);
        contact_sheet::compose(&images, images.len(), 1)
    }

    /// Renders all frames as a contact sheet, with one row of camera images per frame.
    #[must_use]
    pub fn render_sheet(&mut self) -> RgbImage {
        let images: Vec<_> = (0..self.n_frames()).flat_map(|idx| self.camera_images(idx)).collect();
        contact_sheet::compose(&images, self.scenes[0].n_cameras(), SHEET_UPSCALE)
    }

    /// Renders one camera's image of one frame: its side in px and its `[side, side, 3] u8` sRGB bytes.
    ///
    /// # Panics
    /// If there is no such frame or camera.
    #[must_use]
    pub fn render_camera(&mut self, frame_idx: usize, camera_idx: usize) -> (usize, Vec<u8>) {
        self.camera_images(frame_idx).swap_remove(camera_idx)
    }

    fn camera_images(&mut self, frame_idx: usize) -> Vec<(usize, Vec<u8>)> {
        let SequenceFrame { scene_idx, snapshot } = &self.frames[frame_idx];
        self.renderer.render(&self.scenes[*scene_idx], snapshot)
    }
}
