//! Scenes to draw, and what draws them.

use ipc_types::ControlMode;
use sim::perturb::{Composition, Strength};
use sim::physics::World;
use sim::render::gpu::{AdapterKind, GpuOptions, Visibility};
use sim::render::{GpuRenderer, RenderScene, Renderer, Samples, View};
use sim::scene::{Scene, Snapshot};
use sim::stream::episode_seed;
use sim::{Perturbation, Profile, TaskId};

pub(crate) const VISIBILITIES: [Visibility; 2] = [Visibility::Raster, Visibility::Compute];

/// A renderer on a software driver; `None` if there is no driver and none is required.
pub(crate) fn renderer(visibility: Visibility, samples: Samples) -> Option<GpuRenderer> {
    let options = GpuOptions { visibility: Some(visibility), samples };
    match GpuRenderer::open(AdapterKind::Software, &options) {
        Ok(renderer) => Some(renderer),
        Err(error) => {
            let required = std::env::var("HYPOGEUM_REQUIRE_VULKAN").is_ok_and(|value| value == "1");
            assert!(!required, "HYPOGEUM_REQUIRE_VULKAN is 1, but: {error}");
            eprintln!("left out: {error} (on Debian: apt-get install mesa-vulkan-drivers libvulkan1)");
            None
        }
    }
}

/// A scene, a moment of it, and a name.
pub(crate) struct Shot {
    pub(crate) name: String,
    pub(crate) scene: RenderScene,
    pub(crate) snapshot: Snapshot,
}

impl Shot {
    fn new(name: String, scene: &Scene) -> Self {
        let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        World::build(scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
        Self { name, scene: RenderScene::new(scene), snapshot }
    }

    /// Images of all cameras.
    pub(crate) fn images(&self, renderer: &mut dyn Renderer) -> Vec<Vec<u8>> {
        let mut images = self.blank_images();
        renderer.render(&mut self.views(&mut images)).unwrap();
        images
    }

    /// Room for the images of all cameras, full of what no image is full of.
    pub(crate) fn blank_images(&self) -> Vec<Vec<u8>> {
        (0..self.scene.n_cameras()).map(|camera| vec![7; self.scene.side(camera).pow(2) * 3]).collect()
    }

    /// Views into such room.
    pub(crate) fn views<'a>(&'a self, images: &'a mut [Vec<u8>]) -> Vec<View<'a>> {
        let view = |(camera_idx, out)| View { scene: &self.scene, snapshot: &self.snapshot, camera_idx, out };
        images.iter_mut().map(Vec::as_mut_slice).enumerate().map(view).collect()
    }
}

/// How many of a task's perturbations are drawn.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Cells {
    /// One, the next for each next task.
    OnePerTask,
    /// All that apply to it.
    All,
}

/// Every task, without or with shadows.
pub(crate) fn shots(cells: Cells, shadows: bool) -> Vec<Shot> {
    let mut shots = Vec::new();
    for (task_idx, &task) in TaskId::ALL.iter().enumerate() {
        let nominal = (task.task().nominal)();
        let applies: Vec<Perturbation> =
            Perturbation::ALL.iter().copied().filter(|p| p.applies_to(&nominal).is_ok()).collect();
        let chosen = match cells {
            Cells::OnePerTask => &applies[task_idx % applies.len()..][..1],
            Cells::All => &applies[..],
        };
        for &perturbation in chosen {
            let spec = Composition::from(perturbation).spec(task.task(), Profile::Strict, Strength::FULL);
            let mut scene = spec.draw(episode_seed(0, task.name(), 1));
            scene.lights.shadows |= shadows;
            shots.push(Shot::new(format!("{}/{}", task.name(), perturbation.name()), &scene));
        }
    }
    shots
}
