//! The figures of one point.

use std::time::Duration;

use run_config::{Amount, QueryMode};
use serde::{Deserialize, Serialize};

use crate::fleet::Totals;
use crate::study::machine::Cores;
use crate::study::report::Fps;

/// Control steps of an episode in the paper's experiment.
pub(crate) const PAPER_STEPS: f64 = 200.0;

/// A policy in a query mode.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Series {
    /// Name of the policy.
    pub(crate) policy: String,
    pub(crate) mode: QueryMode,
}

/// Figures of a series with one number of envs. All rates but the paper's refer to the window from the first
/// work to the last control step (see [`Fps`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SpeedPoint {
    #[serde(flatten)]
    pub(crate) series: Series,
    /// Number of envs as it was asked for.
    pub(crate) envs: Amount,
    /// Number of envs, with `auto` the one in use at the end.
    pub(crate) n_envs: u32,
    /// Control steps executed.
    pub(crate) env_steps: u64,
    /// Wall seconds from the first work to the last control step.
    pub(crate) wall_s: f64,
    /// `env_steps / wall_s`.
    pub(crate) env_steps_per_s: f64,
    /// `env_steps_per_s` of every round, ascending. The other figures are those of the median round.
    pub(crate) rounds_env_steps_per_s: Vec<f64>,
    /// Register peak in GFLOP/s, measured just before: a gauge of how fast the machine was.
    pub(crate) peak_gflop: Option<f64>,
    /// Wall seconds before and after that window: start and end of all processes.
    pub(crate) overhead_s: f64,
    /// Control steps per second by the paper's definition: one batch of `envs` episodes of 200 steps, timed
    /// over the whole process.
    pub(crate) paper_fps: f64,
    pub(crate) images_per_s: f64,
    pub(crate) queries_per_s: f64,
    /// Median and 95th percentile of the seconds between sending a query and receiving its answer.
    pub(crate) latency_p50_s: Option<f64>,
    pub(crate) latency_p95_s: Option<f64>,
    pub(crate) core_s_per_step: CoreSeconds,
    /// Largest memory of sim and policy host in bytes, without shared memory.
    pub(crate) memory_bytes: u64,
    /// Shared memory in bytes.
    pub(crate) shm_bytes: u64,
    /// Control steps per second at which all cores would only step, render and infer.
    pub(crate) bound_env_steps_per_s: f64,
    /// Fraction of the bound that was reached.
    pub(crate) reached: f64,
    /// Fraction of the register peak in f32 that inference reaches on its cores; `None` without a network
    /// there.
    pub(crate) peak_fraction: Option<f64>,
    /// Fraction of `wall_s` in which a device rendered or had a batch of the policy, or an attached host a
    /// query, whichever was longest; `None` without any of them.
    pub(crate) device_fraction: Option<f64>,
    /// Number of episodes that ended with an error.
    pub(crate) errors: u64,
}

/// Core-seconds per control step, by stage. Their sum is the number of cores over `env_steps_per_s`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct CoreSeconds {
    /// Building worlds and stepping physics.
    pub(crate) physics: f64,
    /// Rendering of observations.
    pub(crate) render: f64,
    /// Inference.
    pub(crate) policy: f64,
    /// Everything else in sim and policy host: assembling batches, shared memory, polling for answers.
    pub(crate) transport: f64,
    /// Waiting, and other processes.
    pub(crate) unused: f64,
}

impl SpeedPoint {
    /// Computes the figures from the totals of a fleet that lived for `process` on `cores`; `None` without a
    /// control step.
    pub(crate) fn new(
        series: Series,
        envs: Amount,
        totals: &Totals,
        process: Duration,
        cores: Cores,
        errors: u64,
    ) -> Option<Self> {
        let fps = Fps::new(totals, process, cores);
        let sim = totals.sim();
        let (rate, bound) = (fps.env_steps_per_s?, fps.bound?);
        let overhead_s = (fps.process_wall_s - fps.wall_s).max(0.0);
        let n_envs = envs.unwrap_or_else(|| totals.choice.as_ref().map_or(0, |choice| choice.envs));
        let batch = f64::from(n_envs) * PAPER_STEPS;
        let n = fps.env_steps as f64;
        let ledger = fps.ledger;
        Some(Self {
            series,
            envs,
            n_envs,
            env_steps: fps.env_steps,
            wall_s: fps.wall_s,
            env_steps_per_s: rate,
            rounds_env_steps_per_s: vec![rate],
            peak_gflop: cores.peak_gflop,
            overhead_s,
            paper_fps: batch / (overhead_s + batch / rate),
            images_per_s: fps.images_per_s.unwrap_or(0.0),
            queries_per_s: fps.queries_per_s.unwrap_or(0.0),
            latency_p50_s: sim.latencies.quantile(0.5),
            latency_p95_s: sim.latencies.quantile(0.95),
            core_s_per_step: CoreSeconds {
                physics: ledger.physics_s / n,
                render: ledger.render_s / n,
                policy: ledger.policy_s / n,
                transport: ledger.transport_s / n,
                unused: ledger.unused_s / n,
            },
            memory_bytes: totals.memory_bytes,
            shm_bytes: totals.shm_bytes,
            bound_env_steps_per_s: bound.env_steps_per_s,
            reached: bound.reached,
            peak_fraction: fps.inference.map(|speed| speed.fraction),
            device_fraction: fps.busiest_s().map(|seconds| seconds / fps.wall_s),
            errors,
        })
    }

    /// Returns the number of envs as text, marked if the program chose it.
    pub(crate) fn envs_text(&self) -> String {
        match self.envs {
            Amount::Fixed(envs) => envs.to_string(),
            Amount::Auto => format!("auto ({})", self.n_envs),
        }
    }
}

impl Series {
    /// Returns policy and mode, as used in file names.
    pub(crate) fn name(&self) -> String {
        format!("{}-{}", self.policy, self.mode_name())
    }

    /// Returns the mode as on the command line.
    pub(crate) fn mode_name(&self) -> &'static str {
        match self.mode {
            QueryMode::Chunk => "chunk",
            QueryMode::Ensemble => "ensemble",
        }
    }
}

#[cfg(test)]
mod tests {
    use sim::serve::protocol::{Counters, Latencies};

    use super::*;
    use crate::fleet::HostWork;

    const CORES: Cores = Cores { count: 2, n_threads: 2, peak_gflop: Some(100.0) };

    #[test]
    fn parts_add_up_to_all_cores() {
        let mut totals = Totals::new(1, None);
        let mut latencies = Latencies::default();
        latencies.record(Duration::from_millis(5), 100);
        totals.on_sim_counters(Counters {
            env_steps: 1000,
            images: 300,
            queries: 100,
            wall_s: 2.0,
            physics_s: 0.6,
            render_s: 0.4,
            cpu_s: 1.2,
            latencies,
            ..Counters::default()
        });
        totals.on_host_work(
            0,
            HostWork {
                queries: 100,
                batches: 20,
                busy_s: 1.5,
                cpu_s: 1.6,
                device_s: 0.0,
                flop: 75_000_000_000,
            },
        );
        let series = Series { policy: "act".to_owned(), mode: QueryMode::Chunk };
        let point =
            SpeedPoint::new(series, Amount::Fixed(10), &totals, Duration::from_secs(3), CORES, 0).unwrap();
        let parts = point.core_s_per_step;
        let sum = parts.physics + parts.render + parts.policy + parts.transport + parts.unused;
        assert!((sum - 2.0 / point.env_steps_per_s).abs() < 1e-12, "{parts:?}");
        assert!(
            (parts.transport - 0.3e-3).abs() < 1e-12 && (parts.unused - 1.2e-3).abs() < 1e-12,
            "{parts:?}"
        );
        assert!((point.peak_fraction.unwrap() - 0.5).abs() < 1e-12, "{:?}", point.peak_fraction);
        // 10 episodes of 200 steps at 500 steps/s take 4 s, and start and end another second.
        assert!((point.paper_fps - 400.0).abs() < 1e-9);
    }

    #[test]
    fn run_without_a_step_has_no_figures() {
        let series = Series { policy: "act".to_owned(), mode: QueryMode::Chunk };
        let envs = Amount::Fixed(1);
        assert_eq!(SpeedPoint::new(series, envs, &Totals::default(), Duration::from_secs(1), CORES, 0), None);
    }
}
