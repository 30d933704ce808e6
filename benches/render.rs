//! What pictures cost: whole observations and single images, on one thread and on two.
//!
//! `cargo bench -p benches --bench render -- [--csv FILE]`. An env-frame is all images of one env: two of 224 × 224 pixels
//! and one of 128 × 128 per arm. Envs differ in their seed. The best of several rounds is reported, after warm-up; bounded
//! to 20 s.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::time::{Duration, Instant};

use anyhow::Result;
use benches::Report;
use ipc_types::ControlMode;
use sim::TaskId;
use sim::physics::World;
use sim::render::{CpuRenderer, RenderScene, Renderer, View};
use sim::scene::Snapshot;
use sim::stream::episode_seed;

/// Time given to one case; a round that has begun is finished.
const CASE_TIME: Duration = Duration::from_millis(700);

fn main() -> Result<()> {
    let mut table = Report::from_args("render")?;
    for task in [TaskId::RaiseCube, TaskId::DualArmLiftTray] {
        for n_envs in [1, 16] {
            let mut envs: Vec<Env> = (0..n_envs).map(|episode_idx| Env::new(task, episode_idx)).collect();
            let n_triangles = envs[0].scene.n_triangles();
            for n_threads in [1, 2] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build()?;
                let mut renderer = CpuRenderer::new(n_threads);
                let note = format!("{n_triangles} triangles; {}", renderer.name().replace(',', ""));
                let mut report = |what: &str, unit: &str, rate: f64| {
                    let case = format!("{}/{what}/envs{n_envs}/threads{n_threads}", task.name());
                    println!("{case:50} {rate:8.0} {unit}");
                    table.add(&case, rate, unit, &note);
                };
                let frames = best_rate(&pool, &mut renderer, &mut envs, |_| true) * f64::from(n_envs);
                report("all", "env_frames_per_s", frames);
                if task == TaskId::RaiseCube {
                    for (what, side, per_env) in [("224", 224, 2.0), ("128", 128, 1.0)] {
                        let rounds = best_rate(&pool, &mut renderer, &mut envs, |s| s == side);
                        report(what, "images_per_s", rounds * f64::from(n_envs) * per_env);
                    }
                }
            }
        }
    }
    table.finish()
}

/// One env at its start, with room for its images.
struct Env {
    scene: RenderScene,
    snapshot: Snapshot,
    images: Vec<Vec<u8>>,
}

impl Env {
    fn new(task: TaskId, episode_idx: u32) -> Self {
        let scene = (task.task().nominal)().draw(episode_seed(0, task.name(), episode_idx));
        let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        World::build(&scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
        let scene = RenderScene::new(&scene);
        let images = (0..scene.n_cameras()).map(|c| vec![0; scene.side(c).pow(2) * 3]).collect();
        Self { scene, snapshot, images }
    }
}

/// Rounds per second in the best round; a round renders every image whose side is wanted.
fn best_rate(
    pool: &rayon::ThreadPool,
    renderer: &mut CpuRenderer,
    envs: &mut [Env],
    wanted: impl Fn(usize) -> bool + Send + Sync,
) -> f64 {
    pool.install(|| {
        let mut views: Vec<View<'_>> = envs
            .iter_mut()
            .flat_map(|Env { scene, snapshot, images }| {
                let (scene, snapshot) = (&*scene, &*snapshot);
                let images = images.iter_mut().enumerate();
                images.map(move |(camera_idx, out)| View { scene, snapshot, camera_idx, out })
            })
            .filter(|view| wanted(view.scene.side(view.camera_idx)))
            .collect();
        for _ in 0..2 {
            renderer.render(&mut views).unwrap();
        }
        let (start, mut best) = (Instant::now(), Duration::MAX);
        while start.elapsed() < CASE_TIME {
            let round = Instant::now();
            renderer.render(&mut views).unwrap();
            best = best.min(round.elapsed());
        }
        1.0 / best.as_secs_f64()
    })
}
