//! Peak arithmetic throughput: fused multiply-adds on registers only, with the widest available SIMD
//! instructions.

use std::hint::black_box;
use std::{io, thread};

use run_config::trace::CpuTime;

/// Independent dependency chains: enough to saturate two FMA units with a latency of four cycles each.
const N_CHAINS: usize = 12;
/// FMA steps per chain between two clock reads.
const STEPS: usize = 20_000;
/// Minimum time that a thread runs in a round, in s.
const ROUND_S: f64 = 0.01;
/// Number of rounds.
const N_ROUNDS: usize = 7;

/// Like [`try_peak_gflop_per_s`], for programs that have to start as many threads anyway.
///
/// # Panics
/// If the system cannot start the threads.
#[must_use]
pub fn peak_gflop_per_s(n_threads: usize) -> f64 {
    try_peak_gflop_per_s(n_threads).expect("the system can start a thread per core")
}

/// Measures the aggregate GFLOP/s of `n_threads` new threads that run at the same time: the median over seven
/// rounds. Takes 0.07 s.
///
/// # Errors
/// If the system cannot start the threads.
pub fn try_peak_gflop_per_s(n_threads: usize) -> io::Result<f64> {
    let rounds = || -> Vec<f64> { (0..N_ROUNDS).map(|_| round()).collect() };
    let rates_by_thread: Vec<Vec<f64>> = thread::scope(|scope| {
        let start = |_| thread::Builder::new().spawn_scoped(scope, rounds);
        let threads: Vec<_> = (0..n_threads).map(start).collect::<Result<_, _>>()?;
        let rates = threads.into_iter().map(|thread| thread.join().expect("FMA threads do not panic"));
        io::Result::Ok(rates.collect())
    })?;
    let mut sums: Vec<f64> =
        (0..N_ROUNDS).map(|round| rates_by_thread.iter().map(|rates| rates[round]).sum()).collect();
    sums.sort_by(f64::total_cmp);
    Ok(sums[N_ROUNDS / 2])
}

/// Counts the time that the thread runs: on a busy machine it waits, but is not slower.
fn round() -> f64 {
    let (started, mut flop) = (CpuTime::of_thread(), 0.0);
    while started.elapsed().as_secs_f64() < ROUND_S {
        flop += chains();
    }
    flop / started.elapsed().as_secs_f64() / 1e9
}

/// Runs all chains once and returns the number of floating-point operations performed.
fn chains() -> f64 {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f") {
            // SAFETY: AVX-512F was detected.
            return unsafe { chains_512() };
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: AVX2 and FMA were detected.
            return unsafe { chains_256() };
        }
    }
    let mut sums = [black_box(1.0_f32); N_CHAINS];
    for _ in 0..STEPS {
        sums.iter_mut().for_each(|sum| *sum = *sum * black_box(0.5) + 0.25);
    }
    black_box(sums);
    (2 * N_CHAINS * STEPS) as f64
}

macro_rules! chains {
    ($name:ident, $features:literal, $lanes:literal, $splat:ident, $fma:ident) => {
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = $features)]
        fn $name() -> f64 {
            use core::arch::x86_64::{$fma, $splat};
            let (factor, addend) = ($splat(black_box(0.5)), $splat(black_box(0.25)));
            let mut sums = [$splat(black_box(1.0)); N_CHAINS];
            for _ in 0..STEPS {
                for sum in &mut sums {
                    *sum = $fma(*sum, factor, addend);
                }
            }
            black_box(sums);
            (2 * $lanes * N_CHAINS * STEPS) as f64
        }
    };
}

chains!(chains_512, "avx512f", 16, _mm512_set1_ps, _mm512_fmadd_ps);
chains!(chains_256, "avx2,fma", 8, _mm256_set1_ps, _mm256_fmadd_ps);
