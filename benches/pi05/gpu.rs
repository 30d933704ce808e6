//! π0.5 and the product kernel on a GPU, or on a software Vulkan driver.
//!
//! Measures the product kernel at the shapes of π0.5's language model and of ACT's transformer, of which a
//! software driver leaves out the large ones. Then come whole queries of a network with generated weights in
//! bf16, full-size on a GPU and tiny on a software driver, unless `--checkpoint` names one. Their time
//! includes uploads and read-back: of each batch alone, then of batches that follow each other as in a run,
//! so that the host uploads the next one while the device computes.

use std::collections::VecDeque;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use benches::{BenchDevice, Report, median};
use ipc_types::Morphology;
use policy_host::generated::{fnv1a64, sym};
use policy_host::models::pi05::GpuPi05Network;
use policy_host::models::pi05::architecture::Pi05Architecture;
use policy_host::models::pi05::checkpoint::Pi05Checkpoint;
use policy_host::models::synthetic::write_pi05_checkpoint;
use policy_host::nn::gpu::ops::{DeviceWeights, OpBuilder, ProductEpilogue, SampleRows};
use policy_host::nn::gpu::steps::{NetworkStep, run};
use policy_host::nn::gpu::{AdapterKind, DeviceBuffer, GpuDevice, KernelCache};

use super::{N_IMAGES, N_PROMPT, QueryBatch};

/// Shapes of products: rows, inner dimension and columns. Those of an MLP of π0.5's language model for one
/// sample, of one of its action expert for eight, and of ACT's transformer for eight.
const PRODUCTS: [(usize, usize, usize); 5] =
    [(968, 2048, 16_384), (968, 16_384, 2048), (400, 1024, 4096), (1200, 512, 512), (1200, 512, 3200)];
/// Operations of a round of a product on a GPU.
const ROUND_FLOP: f64 = 2e12;
/// Operations of the largest product that a software driver computes in a few seconds.
const SOFTWARE_FLOP: f64 = 5e9;
/// Samples of a batch.
const BATCHES: [usize; 2] = [1, 8];
/// Batches in flight: one, and as many as in a policy host, each with the end of its name in the report.
const DEPTHS: [(usize, &str); 2] = [(1, ""), (2, "_in_flight")];
/// Batches of a round that follow each other.
const ROUND_BATCHES: usize = 2;
/// Rounds of a measurement, of which the median counts.
const ROUNDS: usize = 3;

/// Measures products and whole queries.
pub(crate) fn measure(device: BenchDevice, checkpoint: Option<&Path>, report: &mut Report) -> Result<()> {
    let gpu = Arc::new(device.open()?);
    println!("{}", gpu.name());
    // Commas would split the CSV field.
    let note = gpu.name().replace(',', ";");
    let is_software = device.kind == Some(AdapterKind::Software);
    products(&gpu, &note, is_software, report)?;
    if let Some(folder) = checkpoint {
        return queries(&gpu, &note, folder, report);
    }
    let architecture = if is_software { Pi05Architecture::TINY } else { Pi05Architecture::FULL };
    let folder = tempfile::tempdir().context("create a temporary folder")?;
    write_pi05_checkpoint(folder.path(), &architecture, Morphology::Single, 0, |_| {})?;
    queries(&gpu, &note, folder.path(), report)
}

/// Measures the product kernel with weights in f32 and in bf16.
fn products(gpu: &GpuDevice, note: &str, is_software: bool, report: &mut Report) -> Result<()> {
    let batch = DeviceBuffer::uniform(gpu, "batch");
    batch.write(gpu, 0, &[1_u32]);
    let values = |name: &str, len: usize| -> Vec<f32> {
        let stream = fnv1a64(name);
        (0..len).map(|idx| sym(stream, idx, 1.0)).collect()
    };
    let (round_flop, limit) = if is_software { (0.0, SOFTWARE_FLOP) } else { (ROUND_FLOP, f64::INFINITY) };
    let flop_of = |(n_rows, k, n): (usize, usize, usize)| 2.0 * (n_rows * k * n) as f64;
    for (n_rows, k, n) in PRODUCTS.into_iter().filter(|shape| flop_of(*shape) <= limit) {
        let (a, weights) = (values("a", n_rows * k), values("weights", k * n));
        let bits: Vec<u16> = weights.iter().map(|x| (x.to_bits() >> 16) as u16).collect();
        let (a, out) = (DeviceBuffer::of(gpu, "a", &a), DeviceBuffer::zeroed(gpu, "out", n_rows * n));
        let layers = [
            ("f32", DeviceWeights::new(gpu, &weights, &vec![0.0; n])),
            ("bf16", DeviceWeights::bf16(gpu, k, &bits)),
        ];
        gpu.finish_uploads()?;
        for (name, layer) in layers {
            let mut ops = OpBuilder { gpu, kernels: KernelCache::default(), batch: &batch };
            let flop = flop_of((n_rows, k, n));
            let rows = SampleRows::all(n_rows);
            let mut product =
                || ops.linear(&layer, n_rows, (&a, rows, None), (&out, rows), ProductEpilogue::Store);
            let count = (round_flop / flop).ceil().max(1.0) as usize;
            let steps: Vec<_> = (0..count).map(|_| NetworkStep::Run(product())).collect();
            run(gpu, &steps[..1], 1)?;
            let mut rates = Vec::new();
            for _ in 0..ROUNDS {
                let started = Instant::now();
                run(gpu, &steps, 1)?;
                rates.push(flop * count as f64 / started.elapsed().as_secs_f64() / 1e9);
            }
            let rate = median(&mut rates);
            println!("product {n_rows} x {k} x {n}, weights in {name}: {rate:.1} GFLOP/s");
            report.add(&format!("product_{n_rows}x{k}x{n}_{name}"), rate, "gflop_per_s", note);
        }
    }
    Ok(())
}

/// Measures whole queries.
fn queries(gpu: &Arc<GpuDevice>, note: &str, folder: &Path, report: &mut Report) -> Result<()> {
    let started = Instant::now();
    let checkpoint = Pi05Checkpoint::open(folder)?;
    let n_steps = checkpoint.description().n_steps;
    let mut network = checkpoint.load_on_gpu(gpu, n_steps)?;
    let load_s = started.elapsed().as_secs_f64();
    let capacity = network.capacity();
    println!("loaded in {load_s:.1} s, up to {capacity} samples at a time");
    report.add("load", load_s, "s", note);
    let architecture = checkpoint.description().architecture;
    let gflop = architecture.flop_per_query(N_IMAGES, N_PROMPT, n_steps) as f64 / 1e9;
    for n_samples in BATCHES.into_iter().filter(|n_samples| *n_samples <= capacity) {
        let batch = QueryBatch::new(&architecture, n_samples);
        stream(&mut network, &batch, 1)?;
        for (depth, name) in DEPTHS {
            let mut seconds =
                (0..ROUNDS).map(|_| stream(&mut network, &batch, depth)).collect::<Result<Vec<_>>>()?;
            let rate = (ROUND_BATCHES * n_samples) as f64 / median(&mut seconds);
            println!(
                "batch {n_samples}, {depth} in flight: {rate:.3} queries/s of {gflop:.2} GFLOP, {:.2} GFLOP/s",
                rate * gflop
            );
            report.add(&format!("batch{n_samples}{name}"), rate, "queries_per_s", note);
            report.add(&format!("batch{n_samples}{name}"), rate * gflop, "gflop_per_s", note);
        }
    }
    Ok(())
}

/// Answers the same batch [`ROUND_BATCHES`] times, with `depth` of them in flight, and returns the time in s.
fn stream(network: &mut GpuPi05Network, batch: &QueryBatch, depth: usize) -> Result<f64> {
    let mut in_flight = VecDeque::new();
    let started = Instant::now();
    for index in 0..ROUND_BATCHES + depth {
        if index >= depth
            && let Some(oldest) = in_flight.pop_front()
        {
            network.collect(oldest, |actions| {
                black_box(actions);
            })?;
        }
        if index < ROUND_BATCHES {
            in_flight.push_back(network.submit(batch.input(), &batch.noise)?);
        }
    }
    Ok(started.elapsed().as_secs_f64())
}
