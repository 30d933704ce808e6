//! Frame sequences: the rows of a contact sheet or the frames of a movie.

use ipc_types::{ControlMode, ImageSize, ImageSizes};

use super::contact_sheet::{self, Panel, RgbImage};
use super::episode::{Actor, RolloutEnd, roll_out};
use super::error::ShowError;
use super::frame_renderer::{FrameRenderer, Legend, SequenceFrame, ViewMode};
use super::status::EpisodeStatus;
use crate::episode::EpisodeSpec;
use crate::physics::World;
use render::{RenderScene, Samples};

/// Pixels of a contact sheet per rendered pixel, along each axis.
const SHEET_UPSCALE: usize = 2;
/// Columns of a contact sheet of one camera.
const GRID_COLUMNS: usize = 6;

/// A sequence of frames, ready to be rendered. All scenes have the same cameras and the same kinds of
/// objects.
pub struct FrameSequence {
    scenes: Vec<RenderScene>,
    /// Titles of the captions, one per scene.
    titles: Vec<String>,
    /// Instruction per scene.
    instructions: Vec<String>,
    /// Instruction that policies of the task are trained with.
    training_instruction: &'static str,
    /// Length and success of the episode, unless only its start is shown.
    outcome: Option<EpisodeStatus>,
    /// The only camera shown, if not all are.
    camera_idx: Option<usize>,
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
    pub fn initial_states(episodes: &[(EpisodeSpec, u64)], mode: ViewMode, images: ImageSizes) -> Self {
        assert!(!episodes.is_empty(), "a sequence needs at least one episode");
        let sampled: Vec<_> = episodes.iter().map(|(spec, seed)| spec.draw(*seed)).collect();
        let initial = |(scene_idx, scene)| SequenceFrame {
            scene_idx,
            snapshot: World::build(scene, ControlMode::JointPos).snapshot(),
            step: 0,
        };
        let frames: Vec<SequenceFrame> = sampled.iter().enumerate().map(initial).collect();
        let prepared = sampled.iter().map(|scene| RenderScene::new(scene, images));
        let scenes: Vec<RenderScene> = prepared.collect();
        let renderer = FrameRenderer::new(mode, &sampled, &scenes, &frames);
        Self {
            scenes,
            titles: episodes.iter().map(|(spec, _)| spec.title()).collect(),
            instructions: sampled.into_iter().map(|scene| scene.instruction).collect(),
            training_instruction: episodes[0].0.task.task().instruction,
            outcome: None,
            camera_idx: None,
            frames,
            renderer,
        }
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
        images: ImageSizes,
    ) -> Result<Self, ShowError> {
        Self::rollout(spec, episode_seed, actor, mode, images, RolloutEnd::FirstSuccess, |last| {
            vec![0, last / 2, last]
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
        images: ImageSizes,
    ) -> Result<Self, ShowError> {
        Self::rollout(spec, episode_seed, actor, mode, images, RolloutEnd::StepLimit, |last| {
            (0..=last).collect()
        })
    }

    fn rollout(
        spec: EpisodeSpec,
        episode_seed: u64,
        actor: Actor,
        mode: ViewMode,
        images: ImageSizes,
        end: RolloutEnd,
        select_steps: impl Fn(u32) -> Vec<u32>,
    ) -> Result<Self, ShowError> {
        let scene = spec.draw(episode_seed);
        let (snapshots, outcome) = roll_out(spec, &scene, actor, end)?;
        let frame = |step| SequenceFrame { scene_idx: 0, snapshot: snapshots[step as usize].clone(), step };
        let frames: Vec<SequenceFrame> = select_steps(outcome.n_steps).into_iter().map(frame).collect();
        let scenes = vec![RenderScene::new(&scene, images)];
        let renderer = FrameRenderer::new(mode, core::slice::from_ref(&scene), &scenes, &frames);
        Ok(Self {
            scenes,
            titles: vec![spec.title()],
            instructions: vec![scene.instruction],
            training_instruction: spec.task.task().instruction,
            outcome: Some(outcome),
            camera_idx: None,
            frames,
            renderer,
        })
    }

    /// Sets the samples per pixel of colour images; 1 unless set.
    #[must_use]
    pub fn with_samples(mut self, samples: Samples) -> Self {
        self.renderer.set_samples(samples);
        self
    }

    /// Replaces the titles of the captions, one per episode. A title consists of task and perturbation unless
    /// set.
    #[must_use]
    pub fn with_titles(self, titles: Vec<String>) -> Self {
        assert_eq!(titles.len(), self.scenes.len(), "one title per episode");
        Self { titles, ..self }
    }

    /// Shows one camera only.
    ///
    /// # Panics
    /// If there is no such camera.
    #[must_use]
    pub fn with_camera(self, camera_idx: usize) -> Self {
        assert!(camera_idx < self.n_cameras(), "there is no camera {camera_idx}");
        Self { camera_idx: Some(camera_idx), ..self }
    }

    /// Shows only the external camera that sees most bodies at the start: the first, if it sees as many.
    #[must_use]
    pub fn with_clearest_camera(mut self) -> Self {
        let snapshot = &self.frames[0].snapshot;
        let n_visible = [0, 1].map(|idx| self.renderer.n_visible_bodies(&self.scenes[0], snapshot, idx));
        self.with_camera(usize::from(n_visible[1] > n_visible[0]))
    }

    /// Returns the number of cameras of the robot.
    #[must_use]
    pub fn n_cameras(&self) -> usize {
        self.scenes[0].n_cameras()
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

    /// Renders one frame: the images of the shown cameras side by side.
    ///
    /// # Panics
    /// If `frame_idx` is out of range.
    #[must_use]
    pub fn render_frame(&mut self, frame_idx: usize) -> RgbImage {
        contact_sheet::compose(&[self.panel(frame_idx)], 1, 1)
    }

    /// Renders all frames as a contact sheet: one row of images per frame, or a grid if one camera is shown.
    #[must_use]
    pub fn render_sheet(&mut self) -> RgbImage {
        let panels: Vec<Panel> = (0..self.n_frames()).map(|idx| self.panel(idx)).collect();
        let (columns, upscale) =
            if self.camera_idx.is_some() { (GRID_COLUMNS, 1) } else { (1, SHEET_UPSCALE) };
        contact_sheet::compose(&panels, columns, upscale)
    }

    /// Renders all frames side by side, under the title of the first.
    #[must_use]
    pub fn render_strip(&mut self) -> Panel {
        let images = (0..self.n_frames()).flat_map(|idx| self.images(idx)).collect();
        Panel { caption: self.titles[0].clone(), images }
    }

    fn panel(&mut self, frame_idx: usize) -> Panel {
        let SequenceFrame { scene_idx, step, .. } = self.frames[frame_idx];
        let (title, instruction) = (&self.titles[scene_idx], &self.instructions[scene_idx]);
        let mut lines = vec![title.clone()];
        lines.extend(self.outcome.map(|outcome| outcome.after(step)));
        if instruction.is_empty() {
            lines.push("no instruction".to_owned());
        } else if instruction != self.training_instruction {
            lines.push(format!("\"{instruction}\""));
        }
        Panel { caption: lines.join("\n"), images: self.images(frame_idx) }
    }

    fn images(&mut self, frame_idx: usize) -> Vec<(ImageSize, Vec<u8>)> {
        let SequenceFrame { scene_idx, snapshot, .. } = &self.frames[frame_idx];
        let scene = &self.scenes[*scene_idx];
        let cameras = self.camera_idx.map_or(0..scene.n_cameras(), |idx| idx..idx + 1);
        self.renderer.render(scene, snapshot, cameras)
    }
}
