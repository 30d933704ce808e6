//! Runs of one shard of a sweep: the options, and the way from a plan to its shard.

use std::path::{Path, PathBuf};
use std::rc::Rc;

use anyhow::{anyhow, ensure};
use clap::Args;

use crate::console::exit::{Failure, OrUser};
use crate::plan::RunPlan;
use crate::plan::partition::{EpisodeCosts, Partition, ShardPart, ShardRequest};
use crate::store::package::read_results;
use crate::store::results::{Manifest, ResultsFile, StoredPlan};
use crate::store::shards::{ShardTask, ShardsFolder, SharedSweep};
use crate::study::machine::host_name;

/// The options of a shard, all of which have a value.
pub(crate) const OPTIONS: [&str; 4] = ["--shard", "--audit", "--costs", "--scratch"];

/// Options by which one of many tasks runs its part of a sweep.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct ShardArgs {
    /// Run one part of the sweep: shard I of N, from 0; `auto` if an array of Slurm, SGE or LSF tells both
    /// numbers, `auto/N` if HyperQueue, Kubernetes or PBS tells I. Its results go to FILE.shards beside --db
    #[arg(long, value_name = "I/N|auto|auto/N")]
    pub(crate) shard: Option<ShardRequest>,
    /// Folder on a disk of this node for the results until they are saved [default: $SLURM_TMPDIR, $TMPDIR
    /// or /tmp]
    #[arg(long, value_name = "DIR", requires = "shard")]
    pub(crate) scratch: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) cutting: CuttingArgs,
}

/// Options that decide which episodes a shard has. They are the same for all shards of a sweep.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct CuttingArgs {
    /// Share of the episodes that two shards run, so that `merge` can compare them, for example 1%
    #[arg(long, value_name = "SHARE", value_parser = parse_share)]
    pub(crate) audit: Option<f64>,
    /// Results file of an earlier run of the same policies, by whose times shards are made equal
    #[arg(long, value_name = "RESULTS.db")]
    pub(crate) costs: Option<PathBuf>,
}

impl ShardArgs {
    /// Turns a plan into that of a shard, if one is asked for: its results go to a file on this node.
    ///
    /// # Errors
    /// If it is not clear which shard is meant, the folder belongs to another sweep, or another task runs
    /// the shard.
    pub(crate) fn enter(
        &self,
        plan: &mut RunPlan,
        manifest: &Manifest,
    ) -> Result<Option<(ShardTask, ShardPart)>, Failure> {
        let Some(request) = self.shard else {
            if self.cutting.audit.is_some() || self.cutting.costs.is_some() {
                return Err(anyhow!(
                    "--audit and --costs say how a sweep is cut into shards: add --shard I/N"
                ))
                .or_user();
            }
            return Ok(None);
        };
        let shard = request.resolve(&|name| std::env::var(name).ok()).or_user()?;
        let (folder, partition) = prepare(plan, manifest, shard.count, &self.cutting)?;
        let part = ShardPart::new(Rc::new(partition), shard);
        let task = ShardTask::enter(folder, &part, self.scratch.as_deref()).or_user()?;
        plan.db = task.scratch().to_owned();
        Ok(Some((task, part)))
    }
}

/// Cuts a plan into shards.
///
/// # Errors
/// If there are fewer episodes than shards, or the file of costs cannot be read.
pub(crate) fn partition(plan: &RunPlan, n_shards: u32, cutting: &CuttingArgs) -> Result<Partition, Failure> {
    if u64::from(n_shards) > plan.n_episodes() {
        return Err(anyhow!("there are {n_shards} shards, but only {} episodes", plan.n_episodes()))
            .or_user();
    }
    let audit = cutting.audit.unwrap_or(0.0);
    if audit > 0.0 && n_shards == 1 {
        return Err(anyhow!("--audit compares shards, and this is the only one")).or_user();
    }
    let earlier = cutting.costs.as_deref().map(read_costs).transpose().or_user()?;
    let costs = EpisodeCosts::new(plan, earlier.as_ref());
    let pair = plan.stopping.as_ref().map(|rule| &rule.policies);
    Ok(Partition::new(&StoredPlan::new(plan), pair, &costs, n_shards, audit))
}

/// Reads the results that tell what episodes cost.
fn read_costs(path: &Path) -> anyhow::Result<ResultsFile> {
    let file = read_results(path)?;
    ensure!(
        file.rows.iter().any(|row| row.seconds() > 0.0),
        "{} has no times, from which the costs of episodes are taken: it was packed with --without-times. Name another \
         file with --costs, or omit the option",
        path.display()
    );
    Ok(file)
}

/// Cuts a plan into shards, and makes sure that their folder belongs to it.
///
/// # Errors
/// As [`partition`], and if the folder belongs to another sweep.
pub(crate) fn prepare(
    plan: &RunPlan,
    manifest: &Manifest,
    n_shards: u32,
    cutting: &CuttingArgs,
) -> Result<(ShardsFolder, Partition), Failure> {
    let partition = partition(plan, n_shards, cutting)?;
    let folder = ShardsFolder::beside(&plan.db);
    folder.agree(&SharedSweep::new(plan, manifest, partition.cuts.clone(), &host_name())).or_user()?;
    Ok((folder, partition))
}

/// Parses a share, as a fraction or in percent.
fn parse_share(typed: &str) -> Result<f64, String> {
    let number = match typed.strip_suffix('%') {
        Some(percent) => percent.trim().parse::<f64>().ok().map(|percent| percent / 100.0),
        None => typed.parse().ok(),
    };
    let share = number.filter(|share| *share > 0.0 && *share <= 1.0);
    share.ok_or_else(|| "expected a share above 0 and up to 1, for example 1% or 0.01".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_fractions_or_percent() {
        assert_eq!(
            (parse_share("1%"), parse_share("0.01"), parse_share("100 %")),
            (Ok(0.01), Ok(0.01), Ok(1.0))
        );
        for wrong in ["0", "2", "101%", "x", "-1%", "nan"] {
            assert!(parse_share(wrong).is_err(), "{wrong}");
        }
    }
}
