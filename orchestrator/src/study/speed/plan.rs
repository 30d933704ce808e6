//! The choice of points: those that fit into memory, and of these the ones that end in a reasonable time.

use std::path::PathBuf;

use ipc_types::link::{SHM, check_budget};
use run_config::allotment::available_memory;
use run_config::{Amount, MAX_ENVS, QueryMode, RunConfig};
use serde::Serialize;
use sim::{Perturbation, TaskId};

use crate::plan::RunPlan;
use crate::plan::capacity::{Capacity, env_bytes};
use crate::plan::lanes::lanes;
use crate::selection::condition::Condition;
use crate::selection::policy::NamedPolicy;
use crate::study::speed::point::{Series, SpeedPoint};

/// Least number of queries of every env in a point, each with the control steps that follow it. The first
/// ones alone would say little: they all come at once.
const MIN_QUERIES: u32 = 2;
/// Longest time for these, as a multiple of the time per point.
const MAX_TIMES: f64 = 20.0;

/// The policies, modes and numbers of envs to measure.
#[derive(Clone, Debug)]
pub(crate) struct SpeedPlan {
    pub(crate) policies: Vec<NamedPolicy>,
    pub(crate) modes: Vec<QueryMode>,
    /// Numbers of envs, ascending, `auto` last.
    pub(crate) envs: Vec<Amount>,
    pub(crate) tasks: Vec<TaskId>,
    /// Seconds of evaluation per point.
    pub(crate) seconds: u32,
    /// Options of all points; `mode`, `execute` and `envs` are those of the point.
    pub(crate) config: RunConfig,
    /// Identity of the device on which the policies compute, unless it is the CPU.
    pub(crate) device: Option<String>,
}

/// A point to measure.
#[derive(Clone, Debug)]
pub(crate) struct PlannedPoint {
    pub(crate) series: Series,
    pub(crate) envs: Amount,
    pub(crate) plan: RunPlan,
    /// Least number of control steps, all envs together; with `auto`, of those at the start.
    pub(crate) min_steps: u64,
}

/// A point that is left out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Omission {
    pub(crate) series: Series,
    pub(crate) envs: Amount,
    pub(crate) reason: String,
}

impl std::fmt::Display for Omission {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "left out {}, {} envs: {}", self.series.name(), self.envs, self.reason)
    }
}

impl SpeedPlan {
    /// Returns all points, series by series, and those that do not fit into memory.
    pub(crate) fn points(&self) -> (Vec<PlannedPoint>, Vec<Omission>) {
        let (mut points, mut omissions) = (Vec::new(), Vec::new());
        let available = available_memory();
        for policy in &self.policies {
            for &mode in &self.modes {
                let series = Series { policy: policy.name.clone(), mode };
                for &envs in &self.envs {
                    let (series, plan) = (series.clone(), self.run_plan(vec![policy.clone()], mode, envs));
                    let capacity = Capacity::new(&plan, usize::MAX);
                    if let Some(reason) = too_large(&plan, capacity, available) {
                        omissions.push(Omission { series, envs, reason });
                        continue;
                    }
                    let min_steps = u64::from(capacity.envs * MIN_QUERIES * plan.executions[0].execute);
                    points.push(PlannedPoint { series, envs, plan, min_steps });
                }
            }
        }
        (points, omissions)
    }

    /// Returns the run of some policies with a query mode and a number of envs.
    pub(crate) fn run_plan(&self, policies: Vec<NamedPolicy>, mode: QueryMode, envs: Amount) -> RunPlan {
        let mut config = self.config.clone();
        config.query.mode = Some(mode);
        config.query.execute = config.query.execute.filter(|_| mode == QueryMode::Chunk);
        config.resources.envs = envs;
        RunPlan {
            executions: vec![config.query.without_checkpoint(); policies.len()],
            policies,
            conditions: self
                .tasks
                .iter()
                .map(|&task| Condition { task, perturbation: Perturbation::None.into() })
                .collect(),
            // More than any machine finishes in the time of a point.
            episodes: envs.unwrap_or_else(|| MAX_ENVS) + 2000 * self.seconds,
            config,
            db: PathBuf::new(),
            stopping: None,
        }
    }

    /// Returns why a point would take too long, judged by the previous point of its series.
    pub(crate) fn too_slow(&self, point: &PlannedPoint, measured: &[SpeedPoint]) -> Option<String> {
        let previous = measured.iter().rfind(|previous| previous.series == point.series)?;
        let seconds = point.min_steps as f64 / previous.env_steps_per_s;
        (seconds > MAX_TIMES * f64::from(self.seconds)).then(|| {
            format!("{MIN_QUERIES} queries of every env would take {seconds:.0} s; use a larger --seconds")
        })
    }

    /// Returns `true` once a point has been measured for long enough.
    pub(crate) fn is_enough(&self, point: &PlannedPoint, env_steps: u64, wall_s: f64) -> bool {
        wall_s >= f64::from(self.seconds) && env_steps >= point.min_steps
    }
}

/// Returns why a point does not fit into memory.
fn too_large(plan: &RunPlan, capacity: Capacity, available: Option<u64>) -> Option<String> {
    let specs: Vec<_> = lanes(plan, capacity.batch).into_iter().map(|policy| policy.lane.spec).collect();
    let shm = match check_budget(&specs, SHM.as_ref()) {
        Ok(bytes) => bytes,
        Err(error) => return Some(error.to_string()),
    };
    let needed = u64::from(capacity.max_envs) * env_bytes(plan) + shm;
    available.filter(|available| needed > *available).map(|available| {
        format!(
            "its envs need about {} MiB, and {} MiB of memory are available",
            needed >> 20,
            available >> 20
        )
    })
}

#[cfg(test)]
mod tests {
    use run_config::Execution;

    use super::*;

    fn plan() -> SpeedPlan {
        SpeedPlan {
            policies: vec!["idle".parse().unwrap()],
            modes: vec![QueryMode::Chunk, QueryMode::Ensemble],
            envs: vec![Amount::Fixed(1), Amount::Fixed(64), Amount::Auto],
            tasks: vec![TaskId::RaiseCube],
            seconds: 10,
            config: RunConfig::default(),
            device: None,
        }
    }

    #[test]
    fn points_have_the_options_of_their_series() {
        let (points, omissions) = plan().points();
        assert_eq!(omissions, []);
        let options = points.iter().map(|point| {
            let config = &point.plan.config;
            (point.plan.executions[0], config.resources.envs)
        });
        let expected = [
            (Execution::chunk(30), Amount::Fixed(1)),
            (Execution::chunk(30), Amount::Fixed(64)),
            (Execution::chunk(30), Amount::Auto),
            (Execution::ENSEMBLE, Amount::Fixed(1)),
            (Execution::ENSEMBLE, Amount::Fixed(64)),
            (Execution::ENSEMBLE, Amount::Auto),
        ];
        assert_eq!(options.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn points_beyond_memory_are_left_out() {
        let (points, _) = plan().points();
        let reason = |plan| too_large(plan, Capacity::new(plan, usize::MAX), Some(10 << 20));
        let large = reason(&points[1].plan).unwrap();
        assert!(large.contains("10 MiB of memory are available"), "{large}");
        assert_eq!(reason(&points[0].plan), None);
    }

    #[test]
    fn points_need_time_and_two_queries_per_env() {
        let plan = plan();
        let (points, _) = plan.points();
        for (point, min_steps) in [(&points[1], 64 * 60), (&points[4], 64 * 2)] {
            assert!(!plan.is_enough(point, 100_000, 9.0));
            assert!(!plan.is_enough(point, min_steps - 1, 11.0));
            assert!(plan.is_enough(point, min_steps, 11.0));
        }
    }
}
