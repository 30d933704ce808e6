//! HyperQueue: a job with one task per shard, and a task that depends on them and merges.

use anyhow::Context;
use clap::Args;
use serde_json::json;

use crate::commands::distribution::submit::sharded_sweep::{
    EngineDefaults, ParseRun, ShardedSweep, ShardingArgs, line,
};
use crate::commands::distribution::submit::template::TemplateArgs;
use crate::commands::distribution::submit::tool::{self, ToolOptions};
use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::print_out;

/// Built-in template of the job definition file.
pub(crate) const TEMPLATE: &str = include_str!("../../../../templates/hyperqueue.toml");
/// Name of the job definition file in the folder of the shards.
const FILE: &str = "hyperqueue.toml";

/// Arguments of `submit hyperqueue`.
#[derive(Args, Clone, Debug)]
pub(crate) struct HyperqueueArgs {
    #[command(flatten)]
    pub(crate) sharding: ShardingArgs,
    #[command(flatten)]
    template: TemplateArgs,
    /// Cores of each shard
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value_t = 1)]
    cpus: u32,
    /// Options of hq, for example "--server-dir hq-server" (repeatable)
    #[arg(long, value_name = "OPTIONS", allow_hyphen_values = true)]
    hq: Vec<ToolOptions>,
}

/// Submits the job, or prints its definition.
pub(crate) fn submit(args: &HyperqueueArgs, parse: ParseRun<'_>) -> Result<ExitStatus, Failure> {
    if args.template.print(TEMPLATE)? {
        return Ok(ExitStatus::Success);
    }
    let sweep = ShardedSweep::resolve(&args.sharding, EngineDefaults::default(), parse)?;
    let definition = definition(args, &sweep)?;
    if args.sharding.dry_run {
        print_out(&definition)?;
        return Ok(ExitStatus::Success);
    }
    sweep.prepare()?;
    let path = sweep.folder.path().join(FILE);
    std::fs::write(&path, definition)
        .with_context(|| format!("failed to write {}", path.display()))
        .or_user()?;
    let mut words = ["job", "submit-file"].map(str::to_owned).to_vec();
    words.push(path.to_string_lossy().into_owned());
    words.extend(ToolOptions::words(&args.hq));
    let output = tool::run("hq", &words, "")?;
    print_out(&format!("{}\n\nProgress: {}\n", output.trim_end(), sweep.status_command()?))?;
    Ok(ExitStatus::Success)
}

/// Returns the job definition file.
pub(crate) fn definition(args: &HyperqueueArgs, sweep: &ShardedSweep) -> Result<String, Failure> {
    let mut variables = sweep.variables()?;
    let quoted = |path: &std::path::Path| line(&[path.to_string_lossy().into_owned()]);
    let logs = (0..sweep.shards).map(|index| quoted(&sweep.log(index))).collect::<Result<Vec<_>, _>>()?;
    variables.insert("logs".to_owned(), json!(logs));
    variables.insert("merge_log".to_owned(), json!(quoted(&sweep.folder.path().join("merge.log"))?));
    variables.insert("cpus".to_owned(), json!(args.cpus));
    args.template.read(TEMPLATE)?.fill(&variables)
}
