//! What pictures cost: whole observations and single images, on one thread and on two, or on a device.
//!
//! `cargo bench -p benches --bench render -- [--renderer cpu|gpu|software] [--visibility raster|compute] [--envs N,N,…]
//! [--csv FILE]`. An env-frame is all images of one env: two of 224 × 224 pixels and one of 128 × 128 per arm. Envs differ
//! in their seed. The best of several rounds is reported, after warm-up; bounded to 20 s with what is done by default.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use benches::Report;
use ipc_types::ControlMode;
use sim::TaskId;
use sim::physics::World;
use sim::render::gpu::{AdapterKind, GpuOptions, Timings, Visibility};
use sim::render::{CpuRenderer, GpuRenderer, RenderScene, Renderer, View};
use sim::scene::Snapshot;
use sim::stream::episode_seed;

/// Time given to one case; a round that has begun is finished.
const CASE_TIME: Duration = Duration::from_millis(700);

fn main() -> Result<()> {
    let mut options = Options::default();
    let usage = "--renderer cpu|gpu|software, --visibility raster|compute, --envs N,N,…, ";
    let mut table = Report::with_options("render", usage, |flag, value| options.take(flag, value))?;
    for task in [TaskId::RaiseCube, TaskId::DualArmLiftTray] {
        for &n_envs in &options.n_envs {
            let mut envs: Vec<Env> = (0..n_envs).map(|episode_idx| Env::new(task, episode_idx)).collect();
            match options.adapter {
                None => on_cpu(task, &mut envs, &mut table)?,
                Some(kind) => on_device(task, &mut envs, kind, options.visibility, &mut table)?,
            }
        }
    }
    table.finish()
}

/// What was asked for.
struct Options {
    /// `None` for the CPU.
    adapter: Option<AdapterKind>,
    visibility: Option<Visibility>,
    n_envs: Vec<u32>,
}

impl Default for Options {
    fn default() -> Self {
        Self { adapter: None, visibility: None, n_envs: vec![1, 16] }
    }
}

impl Options {
    fn take(&mut self, flag: &str, value: &str) -> Result<bool> {
        match (flag, value) {
            ("--renderer", "cpu") => self.adapter = None,
            ("--renderer", "gpu") => self.adapter = Some(AdapterKind::Hardware),
            ("--renderer", "software") => self.adapter = Some(AdapterKind::Software),
            ("--visibility", "raster") => self.visibility = Some(Visibility::Raster),
            ("--visibility", "compute") => self.visibility = Some(Visibility::Compute),
            ("--envs", list) => {
                let numbers = list.split(',').map(str::parse).collect::<Result<_, _>>();
                self.n_envs = numbers.context("--envs takes numbers with commas between them")?;
            }
            _ => return Ok(false),
        }
        Ok(true)
    }
}

fn on_cpu(task: TaskId, envs: &mut [Env], table: &mut Report) -> Result<()> {
    let (n_envs, n_triangles) = (envs.len(), envs[0].scene.n_triangles());
    for n_threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build()?;
        let mut renderer = CpuRenderer::new(n_threads);
        let note = format!("{n_triangles} triangles; {}", renderer.name().replace(',', ""));
        let mut report = |what: &str, unit: &str, rate: f64| {
            let case = format!("{}/{what}/envs{n_envs}/threads{n_threads}", task.name());
            println!("{case:50} {rate:8.0} {unit}");
            table.add(&case, rate, unit, &note);
        };
        let rounds = pool.install(|| best_rate(&mut renderer, envs, |_| true))?;
        report("all", "env_frames_per_s", rounds * n_envs as f64);
        if task == TaskId::RaiseCube {
            for (what, side, per_env) in [("224", 224, 2.0), ("128", 128, 1.0)] {
                let rounds = pool.install(|| best_rate(&mut renderer, envs, |s| s == side))?;
                report(what, "images_per_s", rounds * n_envs as f64 * per_env);
            }
        }
    }
    Ok(())
}

fn on_device(
    task: TaskId,
    envs: &mut [Env],
    kind: AdapterKind,
    visibility: Option<Visibility>,
    table: &mut Report,
) -> Result<()> {
    let options = GpuOptions { visibility, ..GpuOptions::default() };
    let mut renderer = GpuRenderer::open(kind, &options)?;
    let note = format!("{} triangles; {}", envs[0].scene.n_triangles(), renderer.name().replace(',', ""));
    let n_envs = envs.len();
    let rate = best_rate(&mut renderer, envs, |_| true)? * n_envs as f64;
    let case = format!("{}/all/envs{n_envs}", task.name());
    let Timings { submit_s, wait_s, readback_s } = renderer.timings();
    let [submit_ms, wait_ms, readback_ms] = [submit_s, wait_s, readback_s].map(|s| s * 1e3);
    println!(
        "{case:40} {rate:8.0} env_frames_per_s; last call: submit {submit_ms:.2} ms, wait {wait_ms:.2} ms, readback {readback_ms:.2} ms"
    );
    table.add(&case, rate, "env_frames_per_s", &note);
    for (what, ms) in [("submit", submit_ms), ("wait", wait_ms), ("readback", readback_ms)] {
        table.add(&format!("{case}/{what}"), ms, "ms", "of the last call");
    }
    Ok(())
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
fn best_rate(renderer: &mut dyn Renderer, envs: &mut [Env], wanted: impl Fn(usize) -> bool) -> Result<f64> {
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
        renderer.render(&mut views)?;
    }
    let (start, mut best) = (Instant::now(), Duration::MAX);
    while start.elapsed() < CASE_TIME {
        let round = Instant::now();
        renderer.render(&mut views)?;
        best = best.min(round.elapsed());
    }
    Ok(1.0 / best.as_secs_f64())
}
