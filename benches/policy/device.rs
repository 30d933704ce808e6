//! Whole queries of ACT on a GPU, or on a software Vulkan driver.
//!
//! Batches follow each other as in a run: while the device computes one, the host uploads the next. On a
//! software driver the network is tiny, which shows that the benchmark works, and nothing else.

use std::time::Instant;

use anyhow::{Context, Result};
use benches::{BenchDevice, Report, median};
use ipc_types::{ImageSizes, Morphology, ObservationView};
use policy_host::Policy;
use policy_host::models::act::GpuActPolicy;
use policy_host::models::act::checkpoint::colosseum::ActConfig;
use policy_host::models::synthetic;
use policy_host::nn::gpu::AdapterKind;

use super::Batch;

/// Envs of a batch.
const BATCHES: [usize; 4] = [1, 8, 32, 128];
/// Largest batch on a software driver.
const MAX_SOFTWARE_BATCH: usize = 1;
/// Batches in flight, as in a policy host.
const DEPTH: usize = 2;
/// Rounds of a measurement on a GPU, of which the median counts.
const ROUNDS: usize = 3;
/// Queries of a round on a GPU.
const ROUND_QUERIES: usize = 256;

/// Measures queries of both robots.
pub(crate) fn measure(device: BenchDevice, report: &mut Report) -> Result<()> {
    let gpu = device.open()?;
    // Commas would split the CSV field.
    let note = gpu.name().replace(',', ";");
    println!("{note}");
    let is_software = device.kind == Some(AdapterKind::Software);
    for morphology in Morphology::ALL {
        let (size, config) = match is_software {
            false => ("full", ActConfig::full_size(morphology)),
            true => ("tiny", ActConfig::tiny(morphology)),
        };
        let architecture = config.architecture();
        let gflop = architecture.flop_per_query(architecture.horizon) as f64 / 1e9;
        let folder = tempfile::tempdir().context("create a temporary folder")?;
        synthetic::write_checkpoint(folder.path(), &config, 0)?;
        let started = Instant::now();
        let gpu = device.open()?;
        let mut policy = GpuActPolicy::load(gpu, folder.path(), &[morphology], ImageSizes::BENCHMARK)?;
        let (robot, load_s) = (morphology.name(), started.elapsed().as_secs_f64());
        println!("{size} {robot}: {gflop:.2} GFLOP per query, loaded in {load_s:.1} s");
        report.add(&format!("act_{size}_{robot}_load"), load_s, "s", &note);
        let largest = if is_software { MAX_SOFTWARE_BATCH } else { usize::MAX };
        for n_envs in BATCHES.into_iter().filter(|n_envs| *n_envs <= largest) {
            let n_batches = if is_software { 2 * DEPTH } else { (ROUND_QUERIES / n_envs).max(2 * DEPTH) };
            let mut batch = Batch::new(morphology, n_envs);
            stream(&mut policy, &mut batch, DEPTH)?;
            let n_rounds = if is_software { 1 } else { ROUNDS };
            let rates = (0..n_rounds).map(|_| {
                let seconds = stream(&mut policy, &mut batch, n_batches)?;
                Ok((n_batches * n_envs) as f64 / seconds)
            });
            let rate = median(&mut rates.collect::<Result<Vec<_>>>()?);
            println!("  batch {n_envs:3}: {rate:8.1} queries/s, {:8.1} GFLOP/s", rate * gflop);
            let case = format!("act_{size}_{robot}_batch{n_envs}");
            report.add(&case, rate, "queries_per_s", &note);
            report.add(&case, rate * gflop, "gflop_per_s", &note);
        }
    }
    Ok(())
}

/// Answers the same batch a number of times, with [`DEPTH`] of them in flight, and returns the time in s.
fn stream(policy: &mut GpuActPolicy, batch: &mut Batch, n_batches: usize) -> Result<f64> {
    let view = ObservationView::new(batch.header, &batch.pages)?;
    let pipeline = policy.pipeline().context("the policy has no pipeline")?;
    let started = Instant::now();
    for index in 0..n_batches + DEPTH {
        if index >= DEPTH {
            pipeline.collect(&view, &mut batch.chunks)?;
        }
        if index < n_batches {
            pipeline.submit(&view)?;
        }
    }
    Ok(started.elapsed().as_secs_f64())
}
