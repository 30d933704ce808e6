//! Inference cost of ACT at full size and at a tiny size, with generated weights and images, for several
//! batch sizes.
//!
//! `cargo bench -p benches --bench policy -- [--threads N] [--peer PYTHON] [--device gpu|software]
//! [--csv FILE]`. A query is one env of a batch. `gflop_per_s` is based on
//! `Architecture::flop_per_query`, the operation count of the direct algorithm; Winograd convolutions perform
//! fewer. It is compared with the peak on registers only, measured before and after. The full-size network is
//! also measured with int8 weights, along with the error of its actions. The matrix products that occur in
//! ACT follow, with the plain library kernel and with pre-packed weights in alternation, and the layers of
//! the full-size network one by one (`layers.rs`). All figures are medians of several rounds after warm-up.
//! Takes about two minutes.
//!
//! With `--peer`, ONNX Runtime and PyTorch run the same queries in alternation with ours
//! (`peers/act_inference.py`, started with the given Python interpreter), and nothing else is measured:
//! medians, and the median of the ratios per round. On either side, the second of two successive batches
//! counts. Our int8 network is compared with ONNX Runtime in f32 and with the network that ONNX Runtime has
//! quantised itself. With `--device`, only queries on a GPU are measured
//! (`device.rs`).

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

mod device;
mod layers;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use benches::{BenchDevice, DEVICE_USAGE, Peer, Report, median};
use bytemuck::Zeroable;
use ipc_types::frame::EnvBlockMut;
use ipc_types::{ImageSizes, Morphology, ObservationHeader, ObservationView, Page, SCHEMA_HASH};
use policy_host::generated::{fnv1a64, unit};
use policy_host::models::act::checkpoint::colosseum::ActConfig;
use policy_host::models::synthetic;
use policy_host::nn::Precision;
use policy_host::nn::gemm::matmul::{Accum, matmul, view, view_mut};
use policy_host::nn::gemm::packed::PackedWeights;
use policy_host::nn::gemm::peak::peak_gflop_per_s;
use policy_host::{ActionChunk, Policy};

/// Minimum measuring time per case.
const CASE_TIME: Duration = Duration::from_millis(2500);
/// Minimum number of rounds per case.
const MIN_ROUNDS: usize = 3;
/// Rounds per batch size of the peer comparison.
const PEER_ROUNDS: usize = 9;

fn main() -> Result<()> {
    let n_threads = std::thread::available_parallelism()?.get();
    let mut options = PolicyOptions { n_threads, peer: None, device: BenchDevice::default() };
    let usage = format!("--threads N, --peer PYTHON, {DEVICE_USAGE}");
    let mut report = Report::with_options("policy", &usage, |option, value| {
        match option {
            "--threads" => options.n_threads = value.parse().context("--threads needs a number")?,
            "--peer" => options.peer = Some(value.into()),
            _ => return options.device.parse(option, value),
        }
        Ok(true)
    })?;
    match (&options.peer, options.device.kind) {
        (_, Some(_)) => device::measure(options.device, &mut report)?,
        (Some(python), None) => against_peers(python, options.n_threads, &mut report)?,
        (None, None) => {
            queries(options.n_threads, &mut report)?;
            layers::layers(options.n_threads, &mut report)?;
            products(options.n_threads, &mut report);
        }
    }
    report.finish()
}

struct PolicyOptions {
    n_threads: usize,
    peer: Option<PathBuf>,
    device: BenchDevice,
}

fn queries(n_threads: usize, report: &mut Report) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build()?;
    let note = format!("{n_threads} threads");
    let peak = peak_gflop_per_s(n_threads);
    type Size = fn(Morphology) -> ActConfig;
    let cases = [
        ("full", ActConfig::full_size as Size, Precision::F32),
        ("full_int8", ActConfig::full_size as Size, Precision::Int8),
        ("tiny", ActConfig::tiny as Size, Precision::F32),
    ];
    for morphology in Morphology::ALL {
        let mut f32_actions = Vec::new();
        for (name, size, precision) in cases {
            let config = size(morphology);
            let gflop = config.architecture().flop_per_query(config.architecture().horizon) as f64 / 1e9;
            let started = Instant::now();
            let mut policy = synthetic::policy(&config, 0, precision, n_threads);
            let build_s = started.elapsed().as_secs_f64();
            let robot = morphology.name();
            println!("{name} {robot}: {gflop:.2} GFLOP per query, built in {build_s:.1} s");
            let batches: &[usize] = if morphology == Morphology::Single { &[1, 2, 8] } else { &[2] };
            for &n_envs in batches {
                let mut batch = Batch::new(morphology, n_envs);
                let seconds = pool.install(|| -> Result<f64> {
                    batch.run(&mut policy)?;
                    let (started, mut rounds) = (Instant::now(), Vec::new());
                    while rounds.len() < MIN_ROUNDS || started.elapsed() < CASE_TIME {
                        rounds.push(batch.run(&mut policy)?);
                    }
                    Ok(median(&mut rounds))
                })?;
                let per_query = seconds / n_envs as f64;
                let (queries_per_s, rate) = (1.0 / per_query, gflop / per_query);
                println!(
                    "  batch {n_envs:2}: {:8.2} ms per query, {queries_per_s:7.1} queries/s, {rate:6.1} GFLOP/s, {:.0} % of \
                     peak",
                    per_query * 1e3,
                    100.0 * rate / peak
                );
                let case = format!("act_{name}_{robot}_batch{n_envs}");
                report.add(&case, queries_per_s, "queries_per_s", &note);
                report.add(&case, per_query * 1e3, "ms_per_query", &note);
                report.add(&case, rate, "gflop_per_s", &note);
                match name {
                    "full" => f32_actions = batch.actions(),
                    "full_int8" => {
                        let (max_abs, rms_ratio) = difference(&f32_actions, &batch.actions());
                        println!(
                            "    max action error {max_abs:.4}, RMS error {:.2} % of the standard deviation",
                            100.0 * rms_ratio
                        );
                        report.add(&case, max_abs, "largest_difference", &note);
                        report.add(&case, rms_ratio, "difference_rms_by_spread", &note);
                    }
                    _ => {}
                }
            }
        }
    }
    let peak_after = peak_gflop_per_s(n_threads);
    println!("peak of fused multiply-adds on registers: {peak:.0} GFLOP/s before, {peak_after:.0} after");
    report.add("fma_peak", peak, "gflop_per_s", &format!("{note} before"));
    report.add("fma_peak", peak_after, "gflop_per_s", &format!("{note} after"));
    Ok(())
}

/// Returns the maximum absolute error of `quantised`, and its RMS error divided by the standard deviation of
/// `exact`.
fn difference(exact: &[f32], quantised: &[f32]) -> (f64, f64) {
    let n = exact.len() as f64;
    let mean = exact.iter().map(|&x| f64::from(x)).sum::<f64>() / n;
    let variance = exact.iter().map(|&x| (f64::from(x) - mean).powi(2)).sum::<f64>() / n;
    let differences = exact.iter().zip(quantised).map(|(x, y)| f64::from((x - y).abs()));
    let (max_abs, squares) =
        differences.fold((0.0, 0.0), |(max_abs, squares): (f64, f64), x| (max_abs.max(x), squares + x * x));
    (max_abs, (squares / n / variance).sqrt())
}

/// Compares full-size single-arm ACT with engines of the peer, in alternation.
fn against_peers(python: &Path, n_threads: usize, report: &mut Report) -> Result<()> {
    const CASES: [(&str, Precision, [&str; 2]); 2] = [
        ("f32", Precision::F32, ["onnxruntime", "torch"]),
        ("int8", Precision::Int8, ["onnxruntime", "onnxruntime-int8"]),
    ];
    let config = ActConfig::full_size(Morphology::Single);
    let gflop = config.architecture().flop_per_query(config.architecture().horizon) as f64 / 1e9;
    let folder = tempfile::tempdir().context("create a temporary directory")?;
    synthetic::write_checkpoint(folder.path(), &config, 0)?;
    let path = folder.path().to_str().context("the temporary directory's path is not UTF-8")?;
    let mut peer = Peer::start(python, "act_inference.py", &[path, &n_threads.to_string()])?;
    println!("{}", peer.name);
    for (name, precision, engines) in CASES {
        let mut policy = synthetic::policy(&config, 0, precision, n_threads);
        against_engines(name, (&mut policy, gflop), (&mut peer, engines), n_threads, report)?;
    }
    Ok(())
}

/// Compares a policy, which takes `gflop` per query, with engines of the peer.
fn against_engines(
    name: &str,
    (policy, gflop): (&mut dyn Policy, f64),
    (peer, engines): (&mut Peer, [&str; 2]),
    n_threads: usize,
    report: &mut Report,
) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build()?;
    let note = format!("{n_threads} threads");
    for n_envs in [1, 8] {
        let mut batch = Batch::new(Morphology::Single, n_envs);
        // In a run, queries follow each other. So the first of two wakes the threads and fills the caches.
        let mut query = || {
            pool.install(|| batch.run(policy))?;
            pool.install(|| batch.run(policy))
        };
        let (mut ours, mut theirs, mut ratios) =
            (Vec::new(), [const { Vec::new() }; 2], [const { Vec::new() }; 2]);
        let mut peaks = Vec::new();
        for _ in 0..PEER_ROUNDS {
            peaks.push(peak_gflop_per_s(n_threads));
            for (idx, engine) in engines.into_iter().enumerate() {
                // Time ours before and after the peer, so that drift of the machine affects both sides
                // equally.
                let before = query()?;
                let seconds = peer.request(&format!("{engine} {n_envs}"))?;
                let after = query()?;
                ratios[idx].push(2.0 * seconds / (before + after));
                theirs[idx].push(seconds);
                ours.extend([before, after]);
            }
        }
        let ms = |seconds: f64| seconds / n_envs as f64 * 1e3;
        let (own_ms, peak) = (ms(median(&mut ours)), median(&mut peaks));
        let rate = gflop / own_ms * 1e3;
        println!(
            "{name}, batch {n_envs}: {own_ms:.1} ms per query, {rate:.0} GFLOP/s, {:.0} % of the register peak of {peak:.0}",
            100.0 * rate / peak
        );
        let case = format!("peers_{name}_batch{n_envs}");
        report.add(&case, own_ms, "ms_per_query", &note);
        report.add(&case, rate, "gflop_per_s", &note);
        report.add(&format!("{case}/fma_peak"), peak, "gflop_per_s", &note);
        for ((engine, theirs), ratios) in engines.into_iter().zip(&mut theirs).zip(&mut ratios) {
            let (peer_ms, ratio) = (ms(median(theirs)), median(ratios));
            println!("  {engine}: {peer_ms:.1} ms per query; ours is {ratio:.2} times as fast");
            report.add(&format!("{case}/{engine}"), peer_ms, "ms_per_query", &note);
            report.add(&format!("{case}/times_{engine}"), ratio, "1", &note);
        }
    }
    Ok(())
}

/// Shapes of matrix products in ACT: rows, columns and inner dimension.
const PRODUCTS: [(usize, usize, usize); 6] =
    [(150, 512, 512), (150, 1600, 512), (150, 512, 1600), (64, 64, 64), (48, 512, 512), (256, 64, 147)];
/// Rounds per product, half of them with each kernel, and minimum time per round.
const PRODUCT_ROUNDS: usize = 9;
const PRODUCT_TIME: Duration = Duration::from_millis(15);

/// Measures matrix products. Each thread multiplies its own matrices; the rates are summed.
fn products(n_threads: usize, report: &mut Report) {
    for (n_rows, width, depth) in PRODUCTS {
        let thread_rates = || {
            let values = |n: usize| vec![0.5_f32; n];
            let (x, weights, mut out) =
                (values(n_rows * depth), values(depth * width), values(n_rows * width));
            let packed = PackedWeights::new(&weights, depth, width);
            let mut rates = [const { Vec::new() }; 2];
            for round in 0..2 * PRODUCT_ROUNDS {
                let started = Instant::now();
                let mut n = 0;
                while started.elapsed() < PRODUCT_TIME {
                    if round % 2 == 0 {
                        let out = view_mut(&mut out, n_rows, width, width);
                        matmul(
                            out,
                            Accum::Replace,
                            view(&x, n_rows, depth, depth),
                            view(&weights, depth, width, width),
                        );
                    } else {
                        packed.matmul(&x, depth, &mut out, Accum::Replace);
                    }
                    n += 1;
                }
                let flop = (2 * n_rows * width * depth * n) as f64;
                rates[round % 2].push(flop / started.elapsed().as_secs_f64() / 1e9);
            }
            rates.map(|mut rates| median(&mut rates))
        };
        let rates = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..n_threads).map(|_| scope.spawn(thread_rates)).collect();
            threads
                .into_iter()
                .map(|thread| thread.join().expect("matrix products do not panic"))
                .fold([0.0, 0.0], |sum: [f64; 2], rates| [sum[0] + rates[0], sum[1] + rates[1]])
        });
        let [plain, packed] = rates;
        let name = format!("product_{n_rows}x{width}x{depth}");
        println!("{name}: plain {plain:.0} GFLOP/s, packed {packed:.0} GFLOP/s, x{:.2}", packed / plain);
        for (kernel, rate) in [("plain", plain), ("packed", packed)] {
            report.add(
                &format!("{name}_{kernel}"),
                rate,
                "gflop_per_s",
                &format!("{n_threads} threads together"),
            );
        }
    }
}

/// A batched observation and the buffer for its action chunks.
struct Batch {
    header: ObservationHeader,
    pages: Vec<Page>,
    chunks: Vec<ActionChunk>,
}

impl Batch {
    fn new(morphology: Morphology, n_envs: usize) -> Self {
        let (header, pages) = observation(morphology, n_envs);
        Self { header, pages, chunks: vec![ActionChunk::default(); n_envs] }
    }

    /// Runs the policy once and returns the elapsed time in s.
    fn run(&mut self, policy: &mut dyn Policy) -> Result<f64> {
        let view = ObservationView::new(self.header, &self.pages)?;
        let started = Instant::now();
        policy.act(&view, &mut self.chunks)?;
        Ok(started.elapsed().as_secs_f64())
    }

    /// Returns all actions of the last run, concatenated.
    fn actions(&self) -> Vec<f32> {
        self.chunks.iter().flat_map(ActionChunk::rows).copied().collect()
    }
}

/// Creates an observation with noise images and an instruction.
fn observation(morphology: Morphology, n_envs: usize) -> (ObservationHeader, Vec<Page>) {
    let images = Some(ImageSizes::BENCHMARK);
    let header = ObservationHeader {
        schema_hash: SCHEMA_HASH,
        n_envs: n_envs as u32,
        control_mode: morphology.default_control_mode().code(),
        ..ObservationHeader::zeroed()
    }
    .with_images(morphology, images);
    let block_len = header.block_pages as usize;
    let mut pages = vec![Page::zeroed(); n_envs * block_len];
    for (env_idx, block) in pages.chunks_exact_mut(block_len).enumerate() {
        let stream = fnv1a64(&format!("env {env_idx}"));
        let env = EnvBlockMut::new(morphology, images, block);
        let bytes = env.external.iter_mut().chain(env.hand);
        bytes.enumerate().for_each(|(idx, x)| *x = (256.0 * unit(stream, idx)) as u8);
        let instruction = "raise the cube";
        env.record.instruction_len = instruction.len() as u32;
        env.record.instruction[..instruction.len()].copy_from_slice(instruction.as_bytes());
        env.record.state_dim = morphology.state_dim() as u32;
        env.record.execute = 1;
    }
    (header, pages)
}
