//! The numbers of envs that a run may use: what the user fixed, or what cores, memory and episodes admit.

use ipc_types::link::{BudgetError, LaneSpec, SHM, check_budget};
use run_config::Amount;
use run_config::allotment::{available_memory, n_cores};

use crate::plan::RunPlan;
use crate::plan::lanes::lanes;

/// Divisors of the available memory that give the budgets of all envs and of all lanes. The hosts and the
/// orchestrator need the rest.
const ENVS_SHARE: u64 = 3;
const LANES_SHARE: u64 = 6;
/// Envs per core at the start, at most, and at most in a batch of a host on these cores.
const FIRST_PER_CORE: u32 = 16;
const MAX_PER_CORE: u32 = 128;
const BATCH_PER_CORE: u32 = 16;
/// Largest batch with a fixed number of envs, or for a foreign host, unless there are many cores. Larger ones
/// would cost no less per query, but keep their envs waiting and take shared memory: ACT of full size took a
/// minute for a batch of 2,500 on two cores.
const BATCH_LIMIT: u32 = 256;
/// Largest numbers of envs at the start and later, for machines with many cores.
const FIRST_LIMIT: u32 = 128;
const LIMIT: u32 = 4096;

/// The numbers of envs of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Capacity {
    /// At the start.
    pub(crate) envs: u32,
    /// At most.
    pub(crate) max_envs: u32,
    /// At most in one batch.
    pub(crate) batch: u32,
    /// `true` if the number is chosen while the run goes on.
    pub(crate) tunes: bool,
}

impl Capacity {
    /// Returns the numbers for a run of `n_jobs` episodes.
    pub(crate) fn new(plan: &RunPlan, n_jobs: usize) -> Self {
        match plan.config.resources.envs {
            Amount::Fixed(envs) => {
                Self { envs, max_envs: envs, batch: half_batch(envs, n_cores()), tunes: false }
            }
            Amount::Auto => Self::auto(plan, n_jobs.try_into().unwrap_or(u32::MAX), n_cores()),
        }
    }

    fn auto(plan: &RunPlan, n_jobs: u32, n_cores: u32) -> Self {
        let env_bytes = env_bytes(plan);
        let available = available_memory().unwrap_or(u64::MAX);
        let by_memory = u32::try_from(available / ENVS_SHARE / env_bytes).unwrap_or(u32::MAX);
        let by_cores = n_cores.saturating_mul(MAX_PER_CORE).min(LIMIT);
        let max_envs = by_cores.min(by_memory).min(n_jobs).max(1);
        // A foreign host may leave the cores idle while it answers, and cost much per batch.
        let foreign = plan.policies.iter().any(|policy| policy.spec.is_elsewhere());
        let mut batch = if foreign {
            half_batch(max_envs, n_cores)
        } else {
            max_envs.min(n_cores.saturating_mul(BATCH_PER_CORE))
        };
        while batch > 1 && !fits(plan, batch, available / LANES_SHARE) {
            batch /= 2;
        }
        Self {
            envs: n_cores.saturating_mul(FIRST_PER_CORE).min(FIRST_LIMIT).min(max_envs),
            max_envs,
            batch,
            tunes: true,
        }
    }
}

/// Returns the memory of an env of a run in bytes.
pub(crate) fn env_bytes(plan: &RunPlan) -> u64 {
    sim::episode::env_bytes(plan.needs_images())
}

/// Returns the largest batch that leaves half of the envs to step meanwhile.
fn half_batch(envs: u32, n_cores: u32) -> u32 {
    envs.div_ceil(2).min(n_cores.saturating_mul(BATCH_PER_CORE).max(BATCH_LIMIT))
}

/// Returns `true` if lanes with batches of this size need at most this many bytes and leave half of the
/// shared memory free. A failure to tell counts as yes, because the start of the fleet checks again and
/// reports it.
fn fits(plan: &RunPlan, batch: u32, bytes: u64) -> bool {
    let specs: Vec<_> = lanes(plan, batch).into_iter().map(|lane| lane.lane.spec).collect();
    let needed: u64 = specs.iter().map(LaneSpec::shm_bytes).sum();
    let twice = [&specs[..], &specs[..]].concat();
    needed <= bytes && !matches!(check_budget(&twice, SHM.as_ref()), Err(BudgetError::TooSmall { .. }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::sweep::SweepArgs;

    fn capacity(arguments: &str, n_jobs: u32, n_cores: u32) -> Capacity {
        Capacity::auto(&RunPlan::new(&SweepArgs::parse(arguments).unwrap()).unwrap(), n_jobs, n_cores)
    }

    #[test]
    fn cores_and_episodes_limit_envs() {
        let of = |n_jobs, n_cores| {
            let Capacity { envs, max_envs, batch, tunes } = capacity("--policy idle", n_jobs, n_cores);
            assert!(tunes);
            (envs, max_envs, batch)
        };
        assert_eq!(of(10, 2), (10, 10, 10));
        assert_eq!(of(1000, 2), (32, 256, 32));
        assert_eq!(of(1, 64), (1, 1, 1));
        assert_eq!(of(100_000, 64), (128, 4096, 1024));
        let foreign = |n_jobs, n_cores| capacity("--policy a=attach:a", n_jobs, n_cores).batch;
        assert_eq!((foreign(10, 2), foreign(1000, 2), foreign(100_000, 64)), (5, 128, 1024));
    }

    #[test]
    fn fixed_number_is_kept() {
        let plan = RunPlan::new(&SweepArgs::parse("--policy idle --envs 300").unwrap()).unwrap();
        let expected = Capacity { envs: 300, max_envs: 300, batch: 150, tunes: false };
        assert_eq!(Capacity::new(&plan, 10), expected);
        assert_eq!([half_batch(1, 2), half_batch(5000, 2), half_batch(5000, 64)], [1, 256, 1024]);
    }
}
