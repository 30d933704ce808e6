//! Rendering cost of whole observations, on the CPU with one thread and with two, or on a GPU.
//!
//! `cargo bench -p benches --bench render -- [--renderer cpu|gpu|software] [--envs N,N,…] [--image-size
//! WxH[,wrist=WxH]] [--peer PYTHON] [--csv FILE]`. An env-frame is all images of one env: two of 224 × 224
//! px, plus one of 128 × 128 px per arm, unless `--image-size` is given. Envs differ in their seed. On the
//! CPU the cases are interleaved, so that all of them run under the same conditions, and medians after
//! warm-up are reported: plain, with shadows, and with shadows and four samples per pixel, each without and
//! with static layers. With `--peer`, MuJoCo renders the same triangles, textures and cameras in alternation
//! with ours (`peers/mujoco_render.py`, started with the given Python interpreter), and nothing else is
//! measured.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

mod mjcf;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use benches::{Peer, Report, median};
use ipc_types::{ControlMode, ImageSizes};
use sim::physics::World;
use sim::render::export::ExportedPoses;
use sim::render::gpu::{AdapterKind, Timings};
use sim::render::{CpuOptions, CpuRenderer, GpuRenderer, RenderScene, Renderer, Samples, View};
use sim::scene::Snapshot;
use sim::scene::stream::episode_seed;
use sim::{Profile, TaskId};

/// Time per case; a round that has started is finished.
const CASE_TIME: Duration = Duration::from_millis(700);

/// Turns per case on the CPU, including one warm-up turn. A turn consists of many rounds, so that the caches
/// hold the data of this case rather than that of the previous one.
const N_TURNS: u32 = 11;

fn main() -> Result<()> {
    let mut options = BenchOptions::default();
    let usage = "--renderer cpu|gpu|software, --envs N,N,…, --image-size WxH, --peer PYTHON, ";
    let mut table = Report::with_options("render", usage, |flag, value| options.parse(flag, value))?;
    if let Some(python) = &options.peer {
        compare_with_peer(python, &mut table)?;
        return table.finish();
    }
    for task in [TaskId::RaiseCube, TaskId::DualArmLiftTray] {
        for &n_envs in &options.n_envs {
            match options.adapter {
                None => measure_cpu(task, n_envs, options.sizes, &mut table)?,
                Some(kind) => {
                    measure_gpu(task, n_envs, options.sizes, kind, &mut table)?;
                }
            }
        }
    }
    table.finish()
}

/// Parsed command-line options.
struct BenchOptions {
    /// Kind of adapter, or `None` for the CPU renderer.
    adapter: Option<AdapterKind>,
    n_envs: Vec<u32>,
    sizes: ImageSizes,
    /// Python interpreter with MuJoCo installed.
    peer: Option<PathBuf>,
}

impl Default for BenchOptions {
    fn default() -> Self {
        Self { adapter: None, n_envs: vec![1, 16], sizes: ImageSizes::BENCHMARK, peer: None }
    }
}

impl BenchOptions {
    fn parse(&mut self, flag: &str, value: &str) -> Result<bool> {
        match (flag, value) {
            ("--renderer", "cpu") => self.adapter = None,
            ("--renderer", "gpu") => self.adapter = Some(AdapterKind::Hardware),
            ("--renderer", "software") => self.adapter = Some(AdapterKind::Software),
            ("--envs", list) => {
                let numbers = list.split(',').map(str::parse).collect::<Result<_, _>>();
                self.n_envs = numbers.context("--envs needs a comma-separated list of numbers")?;
            }
            ("--image-size", sizes) => self.sizes = sizes.parse().map_err(anyhow::Error::msg)?,
            ("--peer", python) => self.peer = Some(python.into()),
            _ => return Ok(false),
        }
        Ok(true)
    }
}

/// A configuration of the CPU renderer.
#[derive(Clone, Copy)]
struct CpuCase {
    name: &'static str,
    static_layers: bool,
    shadows: bool,
    samples: Samples,
}

const CASES: [CpuCase; 6] = [
    CpuCase { name: "plain", static_layers: false, shadows: false, samples: Samples::One },
    CpuCase { name: "plain/layers", static_layers: true, shadows: false, samples: Samples::One },
    CpuCase { name: "shadows", static_layers: false, shadows: true, samples: Samples::One },
    CpuCase { name: "shadows/layers", static_layers: true, shadows: true, samples: Samples::One },
    CpuCase { name: "shadows_4_samples", static_layers: false, shadows: true, samples: Samples::Four },
    CpuCase { name: "shadows_4_samples/layers", static_layers: true, shadows: true, samples: Samples::Four },
];

fn measure_cpu(task: TaskId, n_envs: u32, sizes: ImageSizes, table: &mut Report) -> Result<()> {
    for n_threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build()?;
        let mut runs = CASES.map(|case| {
            let options = CpuOptions { static_layers: case.static_layers, samples: case.samples };
            let renderer = CpuRenderer::with_options(n_threads, options);
            (case, renderer, RenderEnv::batch(task, n_envs, sizes, case.shadows), Vec::new())
        });
        for turn in 0..N_TURNS {
            for (_, renderer, envs, rounds) in &mut runs {
                let start = Instant::now();
                while start.elapsed() < CASE_TIME / (N_TURNS - 1) {
                    let mut views = RenderEnv::views(envs);
                    let round = Instant::now();
                    pool.install(|| renderer.draw(&mut views));
                    if turn > 0 {
                        rounds.push(round.elapsed().as_secs_f64());
                    }
                }
            }
        }
        for (case, renderer, envs, mut rounds) in runs {
            let rate = f64::from(n_envs) / median(&mut rounds);
            let name =
                format!("{}/{}{}/envs{n_envs}/threads{n_threads}", task.name(), case.name, suffix(sizes));
            let images_per_s = rate * envs[0].images.len() as f64;
            println!("{name:50} {rate:8.0} env_frames_per_s, {images_per_s:8.0} images per s");
            let triangles = envs[0].scene.n_triangles();
            let note = format!("{triangles} triangles; {}", renderer.name().replace(',', ""));
            table.add(&name, rate, "env_frames_per_s", &note);
        }
    }
    Ok(())
}

/// Renders in alternation with MuJoCo, with as many threads as there are processors, as MuJoCo's OpenGL
/// driver does.
fn compare_with_peer(python: &Path, table: &mut Report) -> Result<()> {
    const N_ENVS: u32 = 16;
    const N_ROUNDS: usize = 9;
    let task = TaskId::RaiseCube;
    let n_threads = std::thread::available_parallelism()?.get();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build()?;
    let folder = tempfile::tempdir()?;
    let sizes = ImageSizes::BENCHMARK;
    export(&RenderEnv::batch(task, N_ENVS, sizes, true), folder.path())?;
    let scene = folder.path().to_str().context("the temporary directory's path is not UTF-8")?;
    let mut peer = Peer::start(python, "mujoco_render.py", &[scene])?;
    for (name, shadows, samples) in [
        ("plain", false, Samples::One),
        ("4_samples", false, Samples::Four),
        ("shadows", true, Samples::One),
        ("shadows_4_samples", true, Samples::Four),
    ] {
        let mut envs = RenderEnv::batch(task, N_ENVS, sizes, shadows);
        let mut variants = [false, true].map(|static_layers| {
            let name = if static_layers { "/layers" } else { "" };
            (name, CpuRenderer::with_options(n_threads, CpuOptions { static_layers, samples }), Vec::new())
        });
        let mut theirs = Vec::new();
        // The first round is for warm-up.
        for round in 0..=N_ROUNDS {
            let n_samples = if samples == Samples::Four { 4 } else { 0 };
            let peer_s = peer.request(&format!("{} {n_samples}", i32::from(shadows)))?;
            if round > 0 {
                theirs.push(peer_s);
            }
            for (_, renderer, ours) in &mut variants {
                // Run for half as long as the peer did, so that short disturbances affect both sides.
                let (start, mut rounds) = (Instant::now(), Vec::new());
                while rounds.is_empty() || start.elapsed().as_secs_f64() < peer_s / 2.0 {
                    let mut views = RenderEnv::views(&mut envs);
                    let round = Instant::now();
                    pool.install(|| renderer.draw(&mut views));
                    rounds.push(round.elapsed().as_secs_f64());
                }
                if round > 0 {
                    ours.push(median(&mut rounds));
                }
            }
        }
        let rate = |seconds| f64::from(N_ENVS) / seconds;
        for (variant, _, ours) in variants {
            let mut ratios: Vec<f64> = theirs.iter().zip(&ours).map(|(theirs, ours)| theirs / ours).collect();
            let (mut ours, mut theirs) = (ours, theirs.clone());
            let [ours, theirs] = [rate(median(&mut ours)), rate(median(&mut theirs))];
            let case = format!("{}/{name}{variant}", task.name());
            let ratio = median(&mut ratios);
            println!("{case:40} {ours:8.0} env_frames_per_s, peer {theirs:4.0}: {ratio:.1} times as fast");
            table.add(&format!("{case}/peer"), theirs, "env_frames_per_s", &peer.name);
            table.add(&format!("{case}/times_the_peer"), ratio, "1", &format!("envs{N_ENVS}"));
            table.add(&case, ours, "env_frames_per_s", &format!("threads{n_threads}"));
        }
    }
    Ok(())
}

/// Writes the scene of the first env as MJCF, and the poses of all envs as JSON.
fn export(envs: &[RenderEnv], folder: &Path) -> Result<()> {
    let scene = &envs[0].scene;
    mjcf::write(&scene.export(), folder).context("export the scene for the peer")?;
    let poses = envs.iter().map(|env| {
        let ExportedPoses { instances, cameras } = scene.exported_poses(&env.snapshot);
        [instances, cameras].concat()
    });
    let poses: Vec<_> = poses.collect();
    let sides: Vec<_> = (0..scene.n_cameras()).map(|camera_idx| scene.size(camera_idx).height).collect();
    let text = serde_json::json!({ "poses": poses, "sides": sides }).to_string();
    std::fs::write(folder.join("poses.json"), text).context("export the poses for the peer")
}

/// Returns the part of a case's name that states its image sizes, unless they are the benchmark's.
fn suffix(sizes: ImageSizes) -> String {
    if sizes == ImageSizes::BENCHMARK {
        String::new()
    } else {
        format!("/{}", sizes.to_string().replace(',', "_"))
    }
}

fn measure_gpu(
    task: TaskId,
    n_envs: u32,
    sizes: ImageSizes,
    kind: AdapterKind,
    table: &mut Report,
) -> Result<()> {
    let envs = &mut RenderEnv::batch(task, n_envs, sizes, false);
    let mut renderer = GpuRenderer::open(kind, None, Samples::One, sizes)?;
    let note = format!("{} triangles; {}", envs[0].scene.n_triangles(), renderer.name().replace(',', ""));
    println!(
        "chunks of up to {} envs, {} MiB of device memory",
        renderer.max_chunk_envs(),
        renderer.max_chunk_bytes() >> 20
    );
    let rate = best_rate(&mut renderer, envs)? * f64::from(n_envs);
    let case = format!("{}/all{}/envs{n_envs}", task.name(), suffix(sizes));
    let Timings { submit_s, wait_s, readback_s } = renderer.timings();
    let [submit_ms, wait_ms, readback_ms] = [submit_s, wait_s, readback_s].map(|s| s * 1e3);
    let host_us = (submit_s + readback_s) * 1e6 / f64::from(n_envs);
    println!(
        "{case:40} {rate:8.0} env_frames_per_s; last call: submit {submit_ms:.2} ms, wait {wait_ms:.2} ms, readback {readback_ms:.2} ms; host {host_us:.1} us per env_frame"
    );
    table.add(&format!("{case}/host"), host_us, "us_per_env_frame", "submit and readback of the last call");
    table.add(&case, rate, "env_frames_per_s", &note);
    for (phase, ms) in [("submit", submit_ms), ("wait", wait_ms), ("readback", readback_ms)] {
        table.add(&format!("{case}/{phase}"), ms, "ms", "of the last call");
    }
    Ok(())
}

/// An env in its initial state, with buffers for its images.
struct RenderEnv {
    scene: RenderScene,
    snapshot: Snapshot,
    images: Vec<Vec<u8>>,
}

impl RenderEnv {
    fn batch(task: TaskId, n_envs: u32, sizes: ImageSizes, shadows: bool) -> Vec<Self> {
        (0..n_envs).map(|episode_idx| Self::new(task, episode_idx, sizes, shadows)).collect()
    }

    fn new(task: TaskId, episode_idx: u32, sizes: ImageSizes, shadows: bool) -> Self {
        let mut scene =
            (task.task().nominal)(Profile::Strict).draw(episode_seed(0, task.name(), episode_idx));
        scene.lights.shadows |= shadows;
        let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        World::build(&scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
        let scene = RenderScene::new(&scene, sizes);
        let images = (0..scene.n_cameras()).map(|c| vec![0; scene.size(c).n_bytes()]).collect();
        Self { scene, snapshot, images }
    }

    fn views(envs: &mut [Self]) -> Vec<View<'_>> {
        let views = envs.iter_mut().flat_map(|Self { scene, snapshot, images }| {
            let (scene, snapshot) = (&*scene, &*snapshot);
            let images = images.iter_mut().enumerate();
            images.map(move |(camera_idx, out)| View { scene, snapshot, camera_idx, out })
        });
        views.collect()
    }
}

/// Returns the rounds per second of the fastest round.
fn best_rate(renderer: &mut dyn Renderer, envs: &mut [RenderEnv]) -> Result<f64> {
    let mut views = RenderEnv::views(envs);
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
