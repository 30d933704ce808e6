//! Behaviour after a device failure, when unused meshes are removed, and in small chunks; device memory.

use ipc_types::{ControlMode, ImageSizes};

use super::chunk::size::ChunkSize;
use super::{AdapterKind, GpuRenderer};
use crate::{RenderScene, Renderer, Samples, View};
use scene::Snapshot;
use scene::stream::episode_seed;
use sim::physics::World;
use sim::{Profile, TaskId};

/// An env in its initial state.
struct TestEnv {
    scene: RenderScene,
    snapshot: Snapshot,
}

impl TestEnv {
    fn new(task: TaskId, episode: u32) -> Self {
        let mut scene = (task.task().nominal)(Profile::Strict).draw(episode_seed(0, task.name(), episode));
        scene.lights.shadows = episode.is_multiple_of(2);
        let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        World::build(&scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
        Self { scene: RenderScene::new(&scene, ImageSizes::BENCHMARK), snapshot }
    }
}

/// Renders all images of envs in one batch.
fn render_all(renderer: &mut GpuRenderer, envs: &[TestEnv]) -> Vec<Vec<u8>> {
    let cameras =
        |env: &TestEnv| (0..env.scene.n_cameras()).map(|c| vec![0; env.scene.size(c).n_bytes()]).collect();
    let mut images: Vec<Vec<Vec<u8>>> = envs.iter().map(cameras).collect();
    let views = envs.iter().zip(&mut images).flat_map(|(TestEnv { scene, snapshot }, images)| {
        let images = images.iter_mut().enumerate();
        images.map(move |(camera_idx, out)| View { scene, snapshot, camera_idx, out })
    });
    renderer.render(&mut views.collect::<Vec<_>>()).unwrap();
    images.into_iter().flatten().collect()
}

fn renderer() -> GpuRenderer {
    GpuRenderer::open(AdapterKind::Software, None, Samples::One, ImageSizes::BENCHMARK).unwrap()
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn render_fails_permanently_after_device_loss() {
    let env = TestEnv::new(TaskId::RaiseCube, 3);
    let mut renderer = renderer();
    render_all(&mut renderer, core::slice::from_ref(&env));
    renderer.gpu.device.destroy();
    let mut out = vec![0; env.scene.size(0).n_bytes()];
    for _ in 0..2 {
        let TestEnv { scene, snapshot } = &env;
        let error = renderer.render(&mut [View { scene, snapshot, camera_idx: 0, out: &mut out }]);
        let error = error.unwrap_err().to_string();
        assert!(error.contains("render on") && error.contains("lost"), "{error}");
    }
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn images_survive_removal_of_meshes() {
    // Other tasks have other meshes.
    let tasks = [TaskId::RaiseCube, TaskId::PlaceDishInRack, TaskId::HammerNail, TaskId::ScoopBanana];
    let kept = [TestEnv::new(TaskId::PickSodaFromCabinet, 3)];
    let mut renderer = renderer();
    let mut render = |task| render_all(&mut renderer, &[TestEnv::new(task, 3)]);
    let expected = tasks.map(&mut render);
    assert!(expected.windows(2).all(|pair| pair[0] != pair[1]), "other tasks, other images");
    let expected_kept = render_all(&mut renderer, &kept);
    let n_all = renderer.pipeline.assets.n_vertices();
    renderer.pipeline.assets.min_eviction_vertices = 1;
    let mut fewest = n_all;
    for (task, expected) in tasks.iter().zip(&expected).chain(tasks.iter().zip(&expected).rev()) {
        let images = render_all(&mut renderer, &[TestEnv::new(*task, 3)]);
        assert!(images == *expected, "the images of {task:?} changed");
        fewest = fewest.min(renderer.pipeline.assets.n_vertices());
    }
    assert!(fewest < n_all, "no mesh was removed of {n_all} vertices");
    assert!(renderer.pipeline.assets.generation() > 0, "no mesh has moved");
    assert!(render_all(&mut renderer, &kept) == expected_kept, "the images of a scene that lives on");
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn images_are_independent_of_chunk_limits() {
    let tasks = [TaskId::RaiseCube, TaskId::DualArmLiftTray, TaskId::ScoopBanana];
    let envs: Vec<TestEnv> =
        (0..2).flat_map(|episode| tasks.map(|task| TestEnv::new(task, episode))).collect();
    let mut renderer = renderer();
    let expected = render_all(&mut renderer, &envs);
    let largest = renderer.pipeline.limits.largest;
    let limits = [
        ChunkSize { images: 1, ..largest },
        ChunkSize { images: 5, ..largest },
        ChunkSize { pixels: 60_000, ..largest },
        ChunkSize { shadow_maps: 1, ..largest },
        ChunkSize { instances: 200, ..largest },
        ChunkSize { image_blocks: 900, ..largest },
        ChunkSize { poses: 40, ..largest },
        ChunkSize::default(),
    ];
    for limit in limits {
        renderer.pipeline.limits.largest = limit;
        assert!(render_all(&mut renderer, &envs) == expected, "{limit:?}");
    }
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn device_memory_does_not_grow_with_episodes() {
    let tasks = [TaskId::RaiseCube, TaskId::DualArmLiftTray, TaskId::PlaceDishInRack];
    let mut renderer = renderer();
    let mut render_round = |n_envs: usize, episode: u32| {
        let envs: Vec<TestEnv> =
            (0..n_envs).map(|i| TestEnv::new(tasks[i % 3], episode + i as u32)).collect();
        render_all(&mut renderer, &envs);
        let chunk_bytes = renderer.chunk_bytes();
        assert!(chunk_bytes <= renderer.max_chunk_bytes(), "{chunk_bytes}");
        let total =
            renderer.gpu.device.generate_allocator_report().map_or(0, |report| report.total_allocated_bytes);
        [chunk_bytes, renderer.pipeline.scenes.buffer.buffer().size(), total]
    };
    let first: Vec<[u64; 3]> = (0..3).map(|round| render_round(8, round * 8)).collect();
    let later: Vec<[u64; 3]> = (3..12).map(|round| render_round(8 - round as usize % 3, round * 8)).collect();
    assert!(first[2][0] > 0 && first[2][2] > first[2][0], "{first:?}");
    assert!(later.iter().all(|bytes| bytes == &first[2]), "{first:?}, then {later:?}");
}
