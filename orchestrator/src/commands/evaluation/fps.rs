//! `hypogeum fps`: speed over the number of envs.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::Context;
use clap::{Args, value_parser};
use ipc_types::Morphology;
use ipc_types::layout::MAX_HORIZON;
use policy_host::PolicySpec;
use policy_host::models::Family;
use policy_host::models::act::checkpoint::colosseum::ActConfig;
use policy_host::models::synthetic;
use policy_host::nn::Precision;
use run_config::{Amount, ImageOptions, InferenceOptions, MAX_ENVS, QueryMode, RunConfig};
use serde_json::json;
use sim::TaskId;

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::interrupt;
use crate::console::output::{print_message, print_out};
use crate::console::output_files::{OutputFolder, Overwriting};
use crate::console::progress::Progress;
use crate::console::threads::start_threads;
use crate::plan::check_policies;
use crate::run::execution::{find_device, resolve};
use crate::selection::policy::{Identity, NamedPolicy};
use crate::selection::selectors::TASK_PARSER;
use crate::store::build_identity;
use crate::study::machine::{Cores, Machine};
use crate::study::speed::{
    Omission, PlannedPoint, PointStore, SpeedPlan, SpeedSettings, StopControl, measure, table, write_files,
};

/// Arguments of `fps`.
#[derive(Debug, Args)]
pub(crate) struct FpsArgs {
    /// Policy to measure (repeatable), as in `run` [default: idle, which costs nothing, and ACT of full
    /// size with random weights]
    #[arg(long = "policy", value_name = "NAME=SPEC")]
    pub(crate) policies: Vec<NamedPolicy>,
    /// Query modes, comma-separated: chunk queries once per --execute control steps, ensemble at every step
    #[arg(
        long = "mode",
        value_enum,
        ignore_case = true,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "chunk,ensemble"
    )]
    pub(crate) modes: Vec<QueryMode>,
    /// Numbers of episodes in progress at a time, comma-separated
    #[arg(long, value_name = "LIST", value_delimiter = ',',
        value_parser = value_parser!(u32).range(1..=i64::from(MAX_ENVS)),
        default_value = "1,2,4,8,16,32,64,128,256,512,1024,2048,4096,5000")]
    pub(crate) envs: Vec<u32>,
    /// Task whose episodes are run
    #[arg(long, value_name = "NAME", value_parser = TASK_PARSER, hide_possible_values = true,
        default_value = "RaiseCube")]
    pub(crate) task: TaskId,
    /// Least time of evaluation per point, in seconds
    #[arg(long, value_name = "S", value_parser = value_parser!(u32).range(1..=3600), default_value_t = 10)]
    pub(crate) seconds: u32,
    /// Rows of each action chunk to execute before the next query; always 1 in ensemble mode
    #[arg(long, value_name = "M", value_parser = value_parser!(u32).range(1..=MAX_HORIZON as i64),
        default_value_t = 30)]
    pub(crate) execute: u32,
    /// Worker threads of the sim and of each policy host [default: one per core]
    #[arg(long, value_name = "T", value_parser = value_parser!(u32).range(1..=1024))]
    pub(crate) threads: Option<u32>,
    /// GPU to use for rendering and for policies: its number, as `hypogeum doctor` lists them [default: 0]
    #[arg(long, value_name = "N")]
    pub(crate) gpu: Option<u32>,
    #[command(flatten)]
    pub(crate) rendering: ImageOptions,
    #[command(flatten)]
    pub(crate) inference: InferenceOptions,
    /// Folder for the results: fps.json, fps.svg, one CSV file per policy and mode; the same command again
    /// resumes
    #[arg(short, long, value_name = "DIR", default_value = "fps")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) overwriting: Overwriting,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub(crate) json: bool,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Measures all points that the output folder does not have yet.
pub(crate) fn fps(args: &FpsArgs) -> Result<ExitStatus, Failure> {
    start_threads()?;
    let machine = Machine::detect();
    let plan = speed_plan(args)?;
    let (points, mut omissions) = plan.points();
    omissions.iter().for_each(print_omission);
    let identities = policy_identities(&plan, &points)?;
    let settings = settings(args, &plan, &identities, &machine);
    let has_network = plan.policies.iter().any(|policy| policy.spec.checkpoint().is_some());
    let cores = Cores::measure(&machine, plan.config.resources.n_threads(), has_network);
    let mut store = PointStore::open(&args.output, &settings).or_user()?;
    let mut output = OutputFolder::open(&args.output, args.overwriting).or_user()?;
    let stop = StopControl::default();
    let _watch = {
        let stop = stop.clone();
        interrupt::watch(move || stop.request()).context("failed to install signal handlers")?
    };
    let is_done = |store: &PointStore, point: &PlannedPoint| {
        store.points.iter().any(|done| done.series == point.series && done.envs == point.envs)
    };
    let n_done = points.iter().filter(|point| is_done(&store, point)).count() as u64;
    let mut progress = Progress::of_points(points.len() as u64, n_done, args.quiet, args.json);
    for point in points.iter().filter(|point| !is_done(&store, point)).collect::<Vec<_>>() {
        let previous = store.points.iter().rfind(|done| done.series == point.series);
        if let Some(reason) = previous.and_then(|previous| plan.too_slow(point, previous)) {
            let omission = Omission { series: point.series.clone(), envs: point.envs, reason };
            progress.log(&omission.to_string());
            progress.skip(1);
            omissions.push(omission);
            continue;
        }
        progress.status(&[format!("{}, {} envs", point.series.name(), point.envs)]);
        let identity = &identities[&point.series.policy];
        let Some(measured) = measure(&plan, point, identity, cores, &mut progress, &stop)? else {
            progress.finish();
            write_files(&mut output, &settings, &store.points, &omissions).or_user()?;
            let folder = args.output.display();
            print_message(&format!("interrupted; {folder}: run the same command to resume"));
            return Ok(ExitStatus::Interrupted);
        };
        store.add(measured).context("failed to store a point").or_user()?;
        progress.tick();
    }
    progress.finish();
    write_files(&mut output, &settings, &store.points, &omissions).or_user()?;
    if args.json {
        let all = std::fs::read_to_string(args.output.join("fps.json")).context("failed to read fps.json")?;
        print_out(&all)?;
    } else {
        print_out(&table(&store.points))?;
        print_message(&format!("wrote {}", args.output.join("fps.{json,svg}").display()));
    }
    let errors = store.points.iter().any(|point| point.errors > 0);
    Ok(if errors { ExitStatus::EpisodeErrors } else { ExitStatus::Success })
}

fn print_omission(omission: &Omission) {
    print_message(&omission.to_string());
}

fn speed_plan(args: &FpsArgs) -> Result<SpeedPlan, Failure> {
    let (rendering, inference) = (args.rendering, args.inference);
    let mut config = RunConfig { rendering, inference, ..RunConfig::default() };
    config.query.execute = Some(args.execute);
    config.resources.gpu = args.gpu;
    config.resources.keep_actions = false;
    if let Some(threads) = args.threads {
        config.resources.threads = Amount::Fixed(threads);
    }
    let mut envs = args.envs.clone();
    envs.sort_unstable();
    envs.dedup();
    let policies = if args.policies.is_empty() { default_policies(args)? } else { args.policies.clone() };
    check_policies(&policies).or_user()?;
    let policies = policies.iter().map(NamedPolicy::located).collect::<Result<Vec<_>, _>>().or_user()?;
    let mut modes = Vec::new();
    for &mode in &args.modes {
        if !modes.contains(&mode) {
            modes.push(mode);
        }
    }
    let device = find_device(&policies, &mut config)?;
    Ok(SpeedPlan { policies, modes, envs, task: args.task, seconds: args.seconds, config, device })
}

/// Returns the idle policy, and ACT with random weights in a sub-folder of the output.
fn default_policies(args: &FpsArgs) -> Result<Vec<NamedPolicy>, Failure> {
    let folder = args.output.join("act-random");
    if !folder.exists() {
        let partial = args.output.join("act-random.partial");
        for morphology in Morphology::ALL {
            let network = partial.join(morphology.name());
            synthetic::write_checkpoint(&network, &ActConfig::full_size(morphology), 0).or_user()?;
        }
        let failed = || format!("failed to rename {}", partial.display());
        std::fs::rename(&partial, &folder).with_context(failed).or_user()?;
    }
    let idle = NamedPolicy { name: "idle".to_owned(), spec: PolicySpec::Idle };
    let act = NamedPolicy {
        name: "act".to_owned(),
        spec: PolicySpec::network(Family::Act, Precision::F32, folder),
    };
    Ok(vec![idle, act])
}

/// Returns the identities of the policies that have points, by name. Also checks that they can be loaded.
fn policy_identities(
    plan: &SpeedPlan,
    points: &[PlannedPoint],
) -> Result<BTreeMap<String, Identity>, Failure> {
    let mut found = BTreeMap::new();
    for policy in &plan.policies {
        if let Some(point) = points.iter().find(|point| point.series.policy == policy.name) {
            let identity = resolve(&mut point.plan.clone(), plan.device.as_deref())?.remove(0);
            found.insert(policy.name.clone(), identity);
        }
    }
    Ok(found)
}

/// Returns what all points have in common.
fn settings(
    args: &FpsArgs,
    plan: &SpeedPlan,
    identities: &BTreeMap<String, Identity>,
    machine: &Machine,
) -> SpeedSettings {
    let rendering = &plan.config.rendering;
    SpeedSettings {
        version: format!("{} {}", build_identity::VERSION, build_identity::CODE),
        task: plan.task.name().to_owned(),
        seconds: args.seconds,
        policies: json!(identities),
        options: json!({
            "execute": args.execute,
            "threads": plan.config.resources.n_threads(),
            "policy_device": plan.config.inference.policy_device,
            "renderer": rendering.renderer,
            "samples": rendering.samples,
        }),
        machine: json!(machine),
    }
}
