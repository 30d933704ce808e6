//! What a query costs: ACT of full size and the tiny one, with generated weights and images, at several batch sizes.
//!
//! `cargo bench -p benches --bench policy -- [--threads N] [--csv FILE]`. A query is one env of a batch; `gflop_per_s`
//! counts the arithmetic of `ActConfig::flop_per_query` (what the definition needs: Winograd's convolutions do less). Then
//! the products that ACT makes, plain as the library makes them and with weights packed beforehand, in turn. Medians of
//! several rounds, after warm-up; bounded to 40 s.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use bytemuck::Zeroable;
use ipc_types::frame::EnvBlockMut;
use ipc_types::layout::block_pages;
use ipc_types::{ActionBlock, Morphology, ObservationHeader, ObservationView, Page, SCHEMA_HASH};
use policy_host::act::ActPolicy;
use policy_host::act::config::ActConfig;
use policy_host::act::model::ActModel;
use policy_host::generated::{fnv1a64, unit};
use policy_host::nn::matmul::{Into, multiply, view, view_mut};
use policy_host::nn::packed::Packed;
use policy_host::{Policy, synthetic};

/// Time given to one case.
const CASE_TIME: Duration = Duration::from_millis(2500);
/// Fewest rounds of a case.
const MIN_ROUNDS: usize = 3;

fn main() -> Result<()> {
    let options = Options::parse()?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.n_threads).build()?;
    let mut csv = String::from("bench,case,value,unit,note\n");
    type Size = fn(Morphology) -> ActConfig;
    for (name, size) in [("full", ActConfig::full_size as Size), ("tiny", ActConfig::tiny as Size)] {
        for morphology in Morphology::ALL {
            let config = size(morphology);
            let gflop = config.flop_per_query() as f64 / 1e9;
            let started = Instant::now();
            let model = ActModel::new(config.clone(), &synthetic::weights(&config, 0));
            let made_s = started.elapsed().as_secs_f64();
            let mut policy = ActPolicy::new(model, options.n_threads);
            let robot = morphology.name();
            println!("{name} {robot}: {gflop:.2} GFLOP a query, made in {made_s:.1} s");
            let batches: &[usize] = if morphology == Morphology::Single { &[1, 2, 8] } else { &[2] };
            for &n_envs in batches {
                let seconds = pool.install(|| median_round(&mut policy, morphology, n_envs))?;
                let per_query = seconds / n_envs as f64;
                let (queries_per_s, rate) = (1.0 / per_query, gflop / per_query);
                println!(
                    "  batch {n_envs:2}: {:8.2} ms a query, {queries_per_s:7.1} queries/s, {rate:6.1} GFLOP/s",
                    per_query * 1e3
                );
                let case = format!("act_{name}_{robot}_batch{n_envs}");
                let note = format!("{} threads", options.n_threads);
                writeln!(csv, "policy,{case},{queries_per_s:.3},queries_per_s,{note}")?;
                writeln!(csv, "policy,{case},{:.3},ms_per_query,{note}", per_query * 1e3)?;
                writeln!(csv, "policy,{case},{rate:.2},gflop_per_s,{note}")?;
            }
        }
    }
    products(options.n_threads, &mut csv)?;
    if let Some(path) = options.csv {
        std::fs::write(&path, csv).with_context(|| format!("write {path}"))?;
    }
    Ok(())
}

struct Options {
    n_threads: usize,
    csv: Option<String>,
}

impl Options {
    fn parse() -> Result<Self> {
        let n_threads = std::thread::available_parallelism()?.get();
        let mut options = Self { n_threads, csv: None };
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            let mut value = || arguments.next().with_context(|| format!("{argument} needs a value"));
            match argument.as_str() {
                // What cargo itself adds.
                "--bench" => {}
                "--csv" => options.csv = Some(value()?),
                "--threads" => options.n_threads = value()?.parse().context("--threads needs a number")?,
                _ => bail!("unknown argument {argument}: expected --threads N or --csv FILE"),
            }
        }
        Ok(options)
    }
}

/// Shapes of products that ACT makes: rows, width, depth.
const PRODUCTS: [(usize, usize, usize); 6] =
    [(150, 512, 512), (150, 1600, 512), (150, 512, 1600), (64, 64, 64), (48, 512, 512), (256, 64, 147)];
/// Rounds and time of a product.
const PRODUCT_ROUNDS: usize = 9;
const PRODUCT_TIME: Duration = Duration::from_millis(15);

/// Each thread makes products of its own; the rates are summed.
fn products(n_threads: usize, csv: &mut String) -> Result<()> {
    for (n_rows, width, depth) in PRODUCTS {
        let of_thread = || {
            let numbers = |n: usize| vec![0.5_f32; n];
            let (x, weights, mut out) =
                (numbers(n_rows * depth), numbers(depth * width), numbers(n_rows * width));
            let packed = Packed::new(&weights, depth, width);
            let mut rates = [const { Vec::new() }; 2];
            for round in 0..2 * PRODUCT_ROUNDS {
                let started = Instant::now();
                let mut n = 0;
                while started.elapsed() < PRODUCT_TIME {
                    if round % 2 == 0 {
                        let out = view_mut(&mut out, n_rows, width, width);
                        multiply(
                            out,
                            Into::Replace,
                            view(&x, n_rows, depth, depth),
                            view(&weights, depth, width, width),
                        );
                    } else {
                        packed.run(&x, depth, &mut out, Into::Replace);
                    }
                    n += 1;
                }
                let flop = (2 * n_rows * width * depth * n) as f64;
                rates[round % 2].push(flop / started.elapsed().as_secs_f64() / 1e9);
            }
            rates.map(median)
        };
        let rates = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..n_threads).map(|_| scope.spawn(of_thread)).collect();
            threads
                .into_iter()
                .map(|thread| thread.join().expect("no product panics"))
                .fold([0.0, 0.0], |sum: [f64; 2], of_thread| [sum[0] + of_thread[0], sum[1] + of_thread[1]])
        });
        let [plain, packed] = rates;
        let name = format!("product_{n_rows}x{width}x{depth}");
        println!("{name}: plain {plain:.0} GFLOP/s, packed {packed:.0} GFLOP/s, x{:.2}", packed / plain);
        for (by, rate) in [("plain", plain), ("packed", packed)] {
            writeln!(csv, "policy,{name}_{by},{rate:.2},gflop_per_s,{n_threads} threads together")?;
        }
    }
    Ok(())
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}

/// Seconds of the median round.
fn median_round(policy: &mut dyn Policy, morphology: Morphology, n_envs: usize) -> Result<f64> {
    let (header, pages) = observation(morphology, n_envs);
    let view = ObservationView::new(header, &pages)?;
    let mut answer = vec![ActionBlock::zeroed(); n_envs];
    policy.act(&view, &mut answer)?;
    let mut rounds = Vec::new();
    let started = Instant::now();
    while rounds.len() < MIN_ROUNDS || started.elapsed() < CASE_TIME {
        let round = Instant::now();
        policy.act(&view, &mut answer)?;
        rounds.push(round.elapsed().as_secs_f64());
    }
    Ok(median(rounds))
}

/// An observation of noise, with an instruction.
fn observation(morphology: Morphology, n_envs: usize) -> (ObservationHeader, Vec<Page>) {
    let block_len = block_pages(morphology, true);
    let mut pages = vec![Page::zeroed(); n_envs * block_len];
    for (env_idx, block) in pages.chunks_exact_mut(block_len).enumerate() {
        let stream = fnv1a64(&format!("env {env_idx}"));
        let env = EnvBlockMut::new(morphology, block);
        let bytes = env.external.iter_mut().chain(env.hand);
        bytes.enumerate().for_each(|(idx, x)| *x = (256.0 * unit(stream, idx)) as u8);
        let instruction = "raise the cube";
        env.record.instruction_len = instruction.len() as u32;
        env.record.instruction[..instruction.len()].copy_from_slice(instruction.as_bytes());
        env.record.state_dim = morphology.state_dim() as u32;
        env.record.execute = 1;
    }
    let header = ObservationHeader {
        schema_hash: SCHEMA_HASH,
        n_envs: n_envs as u32,
        block_pages: block_len as u32,
        morphology: morphology.code(),
        control_mode: morphology.default_control_mode().code(),
        images: 1,
        ..ObservationHeader::zeroed()
    };
    (header, pages)
}
