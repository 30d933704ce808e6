//! Test scenes and renderers.

use ipc_types::{ControlMode, ImageSizes};
use sim::perturb::{Composition, Strength};
use sim::physics::World;
use sim::render::gpu::AdapterKind;
use sim::render::{GpuRenderer, RenderScene, Renderer, Samples, View};
use sim::scene::stream::episode_seed;
use sim::scene::{Scene, Snapshot};
use sim::{Perturbation, Profile, TaskId};

/// Opens a renderer.
pub(crate) fn renderer(samples: Samples, sizes: ImageSizes) -> GpuRenderer {
    GpuRenderer::open(adapter_kind(), None, samples, sizes).unwrap()
}

/// Returns the kind of adapter that tests open: a software driver, unless `HYPOGEUM_TEST_DEVICE` is `gpu`.
pub(crate) fn adapter_kind() -> AdapterKind {
    match std::env::var("HYPOGEUM_TEST_DEVICE").as_deref() {
        Ok("gpu") => AdapterKind::Hardware,
        _ => AdapterKind::Software,
    }
}

/// A named scene in its initial state.
pub(crate) struct TestScene {
    pub(crate) name: String,
    pub(crate) scene: RenderScene,
    pub(crate) snapshot: Snapshot,
}

impl TestScene {
    fn new(name: String, scene: &Scene, sizes: ImageSizes) -> Self {
        let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        World::build(scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
        Self { name, scene: RenderScene::new(scene, sizes), snapshot }
    }

    /// Renders all cameras.
    pub(crate) fn images(&self, renderer: &mut dyn Renderer) -> Vec<Vec<u8>> {
        let mut images = self.blank_images();
        renderer.render(&mut self.views(&mut images)).unwrap();
        images
    }

    /// Allocates images for all cameras, filled with a value that does not occur uniformly in any rendering.
    pub(crate) fn blank_images(&self) -> Vec<Vec<u8>> {
        (0..self.scene.n_cameras()).map(|camera| vec![7; self.scene.size(camera).n_bytes()]).collect()
    }

    /// Returns the views that render all cameras into `images`.
    pub(crate) fn views<'a>(&'a self, images: &'a mut [Vec<u8>]) -> Vec<View<'a>> {
        let view = |(camera_idx, out)| View { scene: &self.scene, snapshot: &self.snapshot, camera_idx, out };
        images.iter_mut().map(Vec::as_mut_slice).enumerate().map(view).collect()
    }
}

/// Selection of the perturbations of each task.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum PerturbationSet {
    /// One perturbation per task, cycling through those that apply.
    OnePerTask,
    /// The same, for every seventh task only.
    FewTasks,
    /// All perturbations that apply to the task.
    All,
}

/// Creates scenes of every task, with shadows forced on if `shadows` is `true`.
pub(crate) fn test_scenes(set: PerturbationSet, shadows: bool, sizes: ImageSizes) -> Vec<TestScene> {
    let mut scenes = Vec::new();
    for (task_idx, &task) in TaskId::ALL.iter().enumerate() {
        let nominal = (task.task().nominal)(Profile::Strict);
        let applies: Vec<Perturbation> =
            Perturbation::ALL.iter().copied().filter(|p| p.applies_to(&nominal).is_ok()).collect();
        let chosen = match set {
            PerturbationSet::FewTasks if !task_idx.is_multiple_of(7) => &[],
            PerturbationSet::OnePerTask | PerturbationSet::FewTasks => {
                &applies[task_idx % applies.len()..][..1]
            }
            PerturbationSet::All => &applies[..],
        };
        for &perturbation in chosen {
            let spec = Composition::from(perturbation).spec(task.task(), Profile::Strict, Strength::FULL);
            let mut scene = spec.draw(episode_seed(0, task.name(), 1));
            scene.lights.shadows |= shadows;
            scenes.push(TestScene::new(format!("{}/{}", task.name(), perturbation.name()), &scene, sizes));
        }
    }
    scenes
}
