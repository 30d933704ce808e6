//! Slurm: a job array with one task per shard, and a job after it that merges.

use clap::Args;
use serde_json::json;

use crate::commands::distribution::submit::sharded_sweep::{
    EngineDefaults, ParseRun, ShardedSweep, ShardingArgs,
};
use crate::commands::distribution::submit::template::TemplateArgs;
use crate::commands::distribution::submit::tool::{self, ToolOptions};
use crate::console::exit::{ExitStatus, Failure};
use crate::console::output::print_out;

/// Built-in template of both scripts.
pub(crate) const TEMPLATE: &str = include_str!("../../../../templates/slurm.sh");

/// Arguments of `submit slurm`.
#[derive(Args, Clone, Debug)]
pub(crate) struct SlurmArgs {
    #[command(flatten)]
    pub(crate) sharding: ShardingArgs,
    #[command(flatten)]
    template: TemplateArgs,
    /// Options of sbatch for both jobs, for example "--partition=long --cpus-per-task=8 --time=4:00:00"
    /// (repeatable)
    #[arg(long, value_name = "OPTIONS", allow_hyphen_values = true)]
    sbatch: Vec<ToolOptions>,
}

/// The scripts of the array and of the merge.
#[derive(Debug)]
pub(crate) struct SlurmScripts {
    pub(crate) array: String,
    pub(crate) merge: String,
}

/// Submits both jobs, or prints their scripts.
pub(crate) fn submit(args: &SlurmArgs, parse: ParseRun<'_>) -> Result<ExitStatus, Failure> {
    if args.template.print(TEMPLATE)? {
        return Ok(ExitStatus::Success);
    }
    let sweep = ShardedSweep::resolve(&args.sharding, EngineDefaults::default(), parse)?;
    let SlurmScripts { array, merge } = scripts(args, &sweep)?;
    if args.sharding.dry_run {
        print_out(&format!("{array}\n# After it, with --dependency=afterany:ID:\n{merge}"))?;
        return Ok(ExitStatus::Success);
    }
    sweep.prepare()?;
    let array_id = sbatch(&[], &array)?;
    let merge_id = match sbatch(&[format!("--dependency=afterany:{array_id}")], &merge) {
        Err(Failure::User(error)) => {
            let merge = &sweep.variables()?["merge"];
            let array_runs = format!(
                "job {array_id} with the shards is submitted, but not the merge (when the job has ended, type `{}`)",
                merge.as_str().unwrap_or_default()
            );
            return Err(Failure::User(error.context(array_runs)));
        }
        submitted => submitted?,
    };
    let status = sweep.status_command()?;
    print_out(&format!(
        "{array_id}: {} shards\n{merge_id}: merge, when they have ended\n\nProgress: {status}\n",
        sweep.shards
    ))?;
    Ok(ExitStatus::Success)
}

/// Fills the template for both jobs.
pub(crate) fn scripts(args: &SlurmArgs, sweep: &ShardedSweep) -> Result<SlurmScripts, Failure> {
    let template = args.template.read(TEMPLATE)?;
    let mut variables = sweep.variables()?;
    variables
        .insert("sbatch".to_owned(), args.sbatch.iter().map(|ToolOptions(line)| line.as_str()).collect());
    // Slurm replaces what follows a percent sign.
    let folder = sweep.folder.path();
    let folder =
        std::path::Path::new(&sweep.working_folder).join(folder).to_string_lossy().replace('%', "%%");
    let digits = (sweep.shards - 1).to_string().len();
    let array_log = format!("{folder}/shard-%{digits}a-of-{}.log", sweep.shards);
    let mut fill = |part: &str, log: String| {
        variables.insert("part".to_owned(), json!(part));
        variables.insert("log".to_owned(), json!(directive_value(&log)));
        template.fill(&variables)
    };
    Ok(SlurmScripts {
        array: fill("shard", array_log)?,
        merge: fill("merge", format!("{folder}/merge.log"))?,
    })
}

/// Quotes a value in a line with `#SBATCH`, whose quotes and backslashes sbatch reads.
fn directive_value(value: &str) -> String {
    if value.contains(|c: char| c.is_whitespace() || "\"'\\#".contains(c)) {
        format!("\"{}\"", value.replace('\\', "\\\\").replace('"', "\\\""))
    } else {
        value.to_owned()
    }
}

/// Submits a script and returns the id of its job.
fn sbatch(options: &[String], script: &str) -> Result<String, Failure> {
    let arguments = [&["--parsable".to_owned()], options].concat();
    let output = tool::run("sbatch", &arguments, script)?;
    // The name of a cluster may follow the id.
    Ok(output.trim().split(';').next().unwrap_or_default().to_owned())
}
