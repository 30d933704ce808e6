//! Contact sheets: what the cameras see at the start of an episode, or along the expert's episode.

use std::path::Path;

use ipc_types::ControlMode;
use ipc_types::layout::MAX_ACTION_DIM;
use thiserror::Error;

use crate::expert::{Expert, PlanError};
use crate::perturb::Perturbation;
use crate::physics::World;
use crate::predicate::first_unmet;
use crate::profile::Profile;
use crate::render::sheet::{SheetError, write_png};
use crate::render::{CpuRenderer, RenderError, RenderScene, Renderer, View};
use crate::scene::{Scene, Snapshot};
use crate::tasks::TaskId;

/// Pixels of the sheet per rendered pixel.
const UPSCALE: usize = 2;

/// Which moments of the episode to show, one row of cameras each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moments {
    /// Its first observation.
    Start,
    /// Start, middle and success (or end) of the scripted expert's episode.
    ExpertEpisode,
}

/// Why there is no sheet.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum ShowError {
    #[error("the expert found no plan: {0}")]
    Plan(#[from] PlanError),
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error(transparent)]
    Sheet(#[from] SheetError),
}

/// Writes a PNG with one column per camera.
///
/// # Errors
/// When the expert has no plan, or the file cannot be written.
pub fn contact_sheet(
    task: TaskId,
    perturbation: Perturbation,
    profile: Profile,
    episode_seed: u64,
    moments: Moments,
    path: &Path,
) -> Result<(), ShowError> {
    let scene = perturbation.apply((task.task().nominal)(), profile).draw(episode_seed);
    let snapshots = match moments {
        Moments::Start => vec![snapshot(&scene, &World::build(&scene, ControlMode::JointPos))],
        Moments::ExpertEpisode => expert_episode(task, &scene, profile)?,
    };
    let view = RenderScene::new(&scene);
    let mut renderer = CpuRenderer::new(rayon::current_num_threads());
    let mut images = Vec::new();
    for snapshot in &snapshots {
        for camera_idx in 0..view.n_cameras() {
            let side = view.side(camera_idx);
            let mut out = vec![0; side * side * 3];
            renderer.render(&mut [View { scene: &view, snapshot, camera_idx, out: &mut out }])?;
            images.push((side, out));
        }
    }
    let images: Vec<(usize, &[u8])> = images.iter().map(|(side, rgb)| (*side, rgb.as_slice())).collect();
    Ok(write_png(path, &images, view.n_cameras(), UPSCALE)?)
}

/// Snapshots at the start, halfway to the first success (or the end), and there.
fn expert_episode(task: TaskId, scene: &Scene, profile: Profile) -> Result<Vec<Snapshot>, ShowError> {
    let task = task.task();
    let mut expert = Expert::new(scene, &(task.expert)(scene))?;
    let mut world = World::build(scene, ControlMode::JointPos);
    let success = (task.success)(scene, profile);
    let mut row = [0.0; MAX_ACTION_DIM];
    let row = &mut row[..ControlMode::JointPos.action_dim(task.morphology)];
    let mut snapshots = vec![snapshot(scene, &world)];
    for _ in 0..task.max_steps {
        expert.act(&world, row);
        world.step(row);
        snapshots.push(snapshot(scene, &world));
        if first_unmet(&success, &world).is_none() {
            break;
        }
    }
    let last = snapshots.len() - 1;
    Ok([0, last / 2, last].map(|i| snapshots[i].clone()).into())
}

fn snapshot(scene: &Scene, world: &World) -> Snapshot {
    let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
    world.write_snapshot(&mut snapshot);
    snapshot
}
