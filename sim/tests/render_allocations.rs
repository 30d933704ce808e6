//! After warm-up the renderer allocates nothing. A separate binary, because it counts the allocations of the
//! whole process.

#[path = "../../tests/counting.rs"]
mod counting;

use ipc_types::{ControlMode, ImageSizes};
use sim::physics::World;
use sim::render::{CpuRenderer, RenderScene, Renderer, View};
use sim::scene::Snapshot;
use sim::{Profile, TaskId};

use crate::counting::allocations;

#[test]
fn rendering_allocates_nothing_after_warm_up() {
    let mut envs = Vec::new();
    for &task in TaskId::ALL {
        let scene = (task.task().nominal)(Profile::Strict).draw(7);
        let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        World::build(&scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
        envs.push((RenderScene::new(&scene, ImageSizes::BENCHMARK), snapshot));
    }
    let mut images: Vec<Vec<Vec<u8>>> = envs
        .iter()
        .map(|(scene, _)| (0..scene.n_cameras()).map(|c| vec![0; scene.size(c).n_bytes()]).collect())
        .collect();
    let mut renderer = CpuRenderer::new(2);
    // Runs on a worker thread, because injecting work into the pool from outside allocates.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let ([_, counted], ()) = pool.install(|| {
        let mut views: Vec<View<'_>> = envs
            .iter()
            .zip(&mut images)
            .flat_map(|((scene, snapshot), images)| {
                images.iter_mut().enumerate().map(move |(camera_idx, out)| View {
                    scene,
                    snapshot,
                    camera_idx,
                    out,
                })
            })
            .collect();
        // Every workspace must have rendered every scene, and rayon decides which worker takes which view.
        for _ in 0..20 {
            renderer.render(&mut views).unwrap();
        }
        allocations(|| (0..10).for_each(|_| renderer.render(&mut views).unwrap()))
    });
    assert_eq!(counted, 0);
}
