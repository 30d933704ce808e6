//! Inference cost of π0.5, with weights as stored (bf16, f32 sums) and with 8-bit weights.
//!
//! `cargo bench -p benches --bench pi05 -- --checkpoint DIR [--threads N] [--peer PYTHON] [--csv FILE]`. The
//! checkpoint is one that `hypogeum checkpoint --kind pi05` writes. Reports the memory while loading and
//! afterwards, the time of a query with three images and a prompt of 60 tokens, alone and in a batch of four,
//! and the operations per second, relative to the peak on registers. With `--peer`, LeRobot's own network
//! answers the same queries in turn with ours (`peers/pi05_inference.py`, started with the given Python
//! interpreter). With `--device gpu|software`, the queries go to a GPU (`gpu.rs`) instead, and the checkpoint
//! may be left out.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

mod gpu;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use benches::{BenchDevice, DEVICE_USAGE, Peer, Report, median};
use policy_host::generated::{fnv1a64, sym};
use policy_host::models::pi05::architecture::Pi05Architecture;
use policy_host::models::pi05::checkpoint::Pi05Checkpoint;
use policy_host::models::pi05::model::{Pi05Input, Pi05Model, SampleTokens};
use policy_host::nn::Precision;
use policy_host::nn::gemm::peak::peak_gflop_per_s;

/// Tokens of the prompt.
const N_PROMPT: usize = 60;
/// Cameras of a robot with one arm.
const N_IMAGES: usize = 3;
/// Samples of a batch, and rounds of its measurement.
const BATCHES: [(usize, usize); 2] = [(1, 2), (4, 1)];
/// Interval between two samples of the memory.
const SAMPLE_TIME: Duration = Duration::from_millis(250);

fn main() -> Result<()> {
    let mut options = Pi05BenchOptions {
        n_threads: std::thread::available_parallelism()?.get(),
        checkpoint: None,
        peer: None,
        device: BenchDevice::default(),
    };
    let mut report = Report::with_options(
        "pi05",
        &format!("--checkpoint DIR, --threads N, --peer PYTHON, {DEVICE_USAGE}"),
        |option, value| {
            match option {
                "--threads" => options.n_threads = value.parse().context("--threads needs a number")?,
                "--checkpoint" => options.checkpoint = Some(value.into()),
                "--peer" => options.peer = Some(value.into()),
                _ => return options.device.parse(option, value),
            }
            Ok(true)
        },
    )?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.n_threads).build()?;
    if options.device.kind.is_some() {
        pool.install(|| gpu::measure(options.device, options.checkpoint.as_deref(), &mut report))?;
        return report.finish();
    }
    let folder = options.checkpoint.as_deref().context("--checkpoint DIR is missing")?;
    let note = format!("{} threads", options.n_threads);
    let mut peer = match &options.peer {
        Some(python) => {
            let folder = folder.to_str().context("the path of the checkpoint is not UTF-8")?;
            let peer = Peer::start(python, "pi05_inference.py", &[folder, &options.n_threads.to_string()])?;
            println!("{}", peer.name);
            Some(peer)
        }
        None => None,
    };
    for (name, precision) in [("bf16", Precision::F32), ("int8", Precision::Int8)] {
        let network = pool.install(|| load(folder, name, precision, &note, &mut report))?;
        pool.install(|| measure(&network, name, &note, options.n_threads, peer.as_mut(), &mut report))?;
    }
    report.finish()
}

struct Pi05BenchOptions {
    n_threads: usize,
    checkpoint: Option<PathBuf>,
    peer: Option<PathBuf>,
    device: BenchDevice,
}

struct LoadedNetwork {
    model: Pi05Model,
    n_steps: usize,
}

/// Loads the network and reports time and memory.
fn load(
    folder: &Path,
    name: &str,
    precision: Precision,
    note: &str,
    report: &mut Report,
) -> Result<LoadedNetwork> {
    let loaded = AtomicBool::new(false);
    let started = Instant::now();
    let (network, curve) = std::thread::scope(|scope| {
        let sampler = scope.spawn(|| {
            let mut curve = Vec::new();
            while !loaded.load(Ordering::Relaxed) {
                curve.push((started.elapsed().as_secs_f64(), resident_mib()));
                std::thread::sleep(SAMPLE_TIME);
            }
            curve
        });
        let network = Pi05Checkpoint::open(folder).and_then(|checkpoint| {
            let n_steps = checkpoint.description().n_steps;
            Ok(LoadedNetwork { model: checkpoint.load(precision, n_steps)?, n_steps })
        });
        loaded.store(true, Ordering::Relaxed);
        (network, sampler.join().expect("reading the memory does not panic"))
    });
    let (network, load_s) = (network?, started.elapsed().as_secs_f64());
    let (own, files) = resident_mib();
    println!("{name}: loaded in {load_s:.1} s; resident: {own} MiB of its own, {files} MiB of the files");
    let stride = curve.len().div_ceil(8).max(1);
    for (second, (own, files)) in curve.into_iter().step_by(stride) {
        println!("  after {second:5.1} s: {own:5} MiB, {files:5} MiB of the files");
    }
    report.add(&format!("{name}/load"), load_s, "s", note);
    report.add(&format!("{name}/own_memory"), own as f64, "MiB", note);
    report.add(&format!("{name}/file_memory"), files as f64, "MiB", note);
    Ok(network)
}

/// Measures queries, in turn with the peer.
fn measure(
    network: &LoadedNetwork,
    name: &str,
    note: &str,
    n_threads: usize,
    mut peer: Option<&mut Peer>,
    report: &mut Report,
) -> Result<()> {
    let architecture = *network.model.architecture();
    let gflop = architecture.flop_per_query(N_IMAGES, N_PROMPT, network.n_steps) as f64 / 1e9;
    let peak = peak_gflop_per_s(n_threads);
    for (n_samples, rounds) in BATCHES {
        let (mut ours, mut theirs, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
        let batch = QueryBatch::new(&architecture, n_samples);
        for _ in 0..rounds {
            let mut actions = batch.noise.clone();
            let started = Instant::now();
            network.model.sample(batch.input(), &mut actions, None);
            ours.push(started.elapsed().as_secs_f64() / n_samples as f64);
            if let Some(peer) = peer.as_deref_mut().filter(|_| n_samples == 1) {
                let seconds = peer.request(&format!("{N_IMAGES} {N_PROMPT} {}", network.n_steps))?;
                theirs.push(seconds);
                ratios.push(seconds / ours[ours.len() - 1]);
            }
        }
        let seconds = median(&mut ours);
        let rate = gflop / seconds;
        println!(
            "{name}, batch {n_samples}: {seconds:.2} s per query of {gflop:.0} GFLOP, {rate:.0} GFLOP/s, {:.0} % of the register peak \
             of {peak:.0}",
            100.0 * rate / peak
        );
        let case = format!("{name}/batch{n_samples}");
        report.add(&case, seconds, "s_per_query", note);
        report.add(&case, rate, "gflop_per_s", note);
        if !theirs.is_empty() {
            let (peer_s, ratio) = (median(&mut theirs), median(&mut ratios));
            println!("  LeRobot in bfloat16: {peer_s:.2} s per query; ours is {ratio:.2} times as fast");
            report.add(&format!("{case}/lerobot"), peer_s, "s_per_query", note);
            report.add(&format!("{case}/times_lerobot"), ratio, "1", note);
        }
    }
    report.add("fma_peak", peak, "gflop_per_s", note);
    Ok(())
}

/// A batch of queries with distinct images.
struct QueryBatch {
    images: Vec<f32>,
    samples: Vec<SampleTokens>,
    noise: Vec<f32>,
}

impl QueryBatch {
    fn new(architecture: &Pi05Architecture, n_samples: usize) -> Self {
        let side = architecture.image_side();
        let values = |name: &str, n: usize| -> Vec<f32> {
            let stream = fnv1a64(name);
            (0..n).map(|idx| sym(stream, idx, 1.0)).collect()
        };
        let sample = |idx: usize| SampleTokens {
            images: (idx * N_IMAGES..(idx + 1) * N_IMAGES).collect(),
            prompt: (4..4 + N_PROMPT as u32).collect(),
        };
        Self {
            images: values("images", n_samples * N_IMAGES * 3 * side * side),
            samples: (0..n_samples).map(sample).collect(),
            noise: values("noise", n_samples * architecture.horizon * architecture.action_width),
        }
    }

    fn input(&self) -> Pi05Input<'_> {
        Pi05Input { images: &self.images, samples: &self.samples }
    }
}

/// Returns the resident memory of this process in MiB: its own, and pages of files.
fn resident_mib() -> (u64, u64) {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let field = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()
    };
    (field("RssAnon:").unwrap_or(0) >> 10, field("RssFile:").unwrap_or(0) >> 10)
}
