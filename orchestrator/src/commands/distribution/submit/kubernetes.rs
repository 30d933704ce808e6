//! Kubernetes: an Indexed Job with one pod per shard, and a Job that waits for them and merges.

use std::path::Path;

use anyhow::anyhow;
use clap::Args;
use serde_json::json;

use crate::commands::distribution::submit::sharded_sweep::{
    EngineDefaults, ParseRun, ShardedSweep, ShardingArgs,
};
use crate::commands::distribution::submit::template::TemplateArgs;
use crate::commands::distribution::submit::tool::{self, ToolOptions};
use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::print_out;

/// Built-in template of the manifest.
pub(crate) const TEMPLATE: &str = include_str!("../../../../templates/kubernetes.yaml");
/// Longest name of a Job, from which the names of pods with an index follow.
const MAX_NAME: usize = 45;
/// The program and the scratch folder of a pod.
pub(crate) const IN_POD: EngineDefaults =
    EngineDefaults { program: Some("hypogeum"), scratch: Some("/scratch") };

/// Arguments of `submit kubernetes`.
#[derive(Args, Clone, Debug)]
pub(crate) struct KubernetesArgs {
    #[command(flatten)]
    pub(crate) sharding: ShardingArgs,
    #[command(flatten)]
    template: TemplateArgs,
    /// Container image with the program
    #[arg(long)]
    image: Option<String>,
    /// PersistentVolumeClaim with the sweep file and the checkpoints, which all pods can write
    #[arg(long, value_name = "PVC")]
    claim: Option<String>,
    /// Folder at which pods see the claim. They work in the current folder if it lies in that one, or else in
    /// that one [default: the current folder]
    #[arg(long, value_name = "PATH")]
    mount: Option<String>,
    /// Cores of each pod, as Kubernetes writes them
    #[arg(long, value_name = "N")]
    cpus: Option<String>,
    /// Memory of each pod, as Kubernetes writes it, for example 8Gi; it includes shared memory
    #[arg(long, value_name = "M")]
    memory: Option<String>,
    /// Options of kubectl, for example "--namespace lab" (repeatable)
    #[arg(long, value_name = "OPTIONS", allow_hyphen_values = true)]
    kubectl: Vec<ToolOptions>,
}

/// Applies the manifest, or prints it.
pub(crate) fn submit(args: &KubernetesArgs, parse: ParseRun<'_>) -> Result<ExitStatus, Failure> {
    if args.template.print(TEMPLATE)? {
        return Ok(ExitStatus::Success);
    }
    let sweep = ShardedSweep::resolve(&args.sharding, IN_POD, parse)?;
    let manifest = manifest(args, &sweep)?;
    if args.sharding.dry_run {
        print_out(&manifest)?;
        return Ok(ExitStatus::Success);
    }
    sweep.prepare()?;
    let words =
        [ToolOptions::words(&args.kubectl), ["apply", "-f", "-"].map(str::to_owned).to_vec()].concat();
    let output = tool::run("kubectl", &words, &manifest)?;
    print_out(&format!("{}\n\nProgress: {}\n", output.trim_end(), sweep.status_command()?))?;
    Ok(ExitStatus::Success)
}

/// Returns the manifest of both Jobs.
pub(crate) fn manifest(args: &KubernetesArgs, sweep: &ShardedSweep) -> Result<String, Failure> {
    let (Some(image), Some(claim)) = (&args.image, &args.claim) else {
        return Err(anyhow!("name the container image and the claim: --image IMAGE --claim PVC")).or_user();
    };
    let mount = args.mount.as_ref().unwrap_or(&sweep.working_folder);
    if !mount.starts_with('/') || mount.contains(':') {
        return Err(anyhow!("--mount is {mount}, expected an absolute path without a colon")).or_user();
    }
    let is_inside = Path::new(&sweep.working_folder).starts_with(mount);
    let mut variables = sweep.variables()?;
    let own = [
        ("name", json!(job_name(&sweep.name))),
        ("folder", json!(if is_inside { &sweep.working_folder } else { mount })),
        ("image", json!(image)),
        ("claim", json!(claim)),
        ("mount", json!(mount)),
        ("scratch", json!(sweep.scratch)),
        ("cpus", json!(args.cpus)),
        ("memory", json!(args.memory)),
    ];
    variables.extend(own.map(|(name, value)| (name.to_owned(), value)));
    args.template.read(TEMPLATE)?.fill(&variables)
}

/// Returns the name of a Job: lower-case letters, digits and hyphens between them.
fn job_name(sweep: &str) -> String {
    let lower = sweep.to_ascii_lowercase();
    let plain: String = lower.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    let name: String = format!("hypogeum-{}", plain.trim_matches('-')).chars().take(MAX_NAME).collect();
    name.trim_end_matches('-').to_owned()
}
