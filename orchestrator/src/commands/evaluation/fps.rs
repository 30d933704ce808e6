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
use run_config::{Amount, ImageOptions, InferenceOptions, MAX_ENVS, ProtocolOptions, QueryMode, RunConfig};
use serde_json::json;

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::interrupt;
use crate::console::output::{print_message, print_out};
use crate::console::output_files::{OutputFolder, Overwriting};
use crate::console::progress::Progress;
use crate::console::threads::start_threads;
use crate::plan::check_policies;
use crate::run::execution::{find_device, resolve};
use crate::selection::policy::{Identity, NamedPolicy};
use crate::selection::selectors::TaskSelector;
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
    /// Numbers of episodes in progress at a time, comma-separated; auto is the choice of `run`
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = Amount::parser(MAX_ENVS),
        default_value = "1,2,4,8,16,32,64,128,256,512,1024,2048,4096,5000")]
    pub(crate) envs: Vec<Amount>,
    /// Tasks whose episodes are run, as in `run`
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = TaskSelector::PARSER,
        hide_possible_values = true, default_value = "RaiseCube")]
    pub(crate) tasks: Vec<TaskSelector>,
    /// Measurements of each point, in alternation with the others of its policy and mode; the median counts
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..=100), default_value_t = 1)]
    pub(crate) rounds: u32,
    /// Least time of evaluation per measurement, in seconds
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
    pub(crate) protocol: ProtocolOptions,
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
    let mut plan = speed_plan(args)?;
    let identities = resolve_policies(&mut plan)?;
    let (points, mut omissions) = plan.points();
    omissions.iter().for_each(|omission| print_message(&omission.to_string()));
    let settings = settings(args, &plan, &identities, &machine);
    let mut store = PointStore::open(&args.output, &settings).or_user()?;
    let mut output = OutputFolder::open(&args.output, args.overwriting).or_user()?;
    let stop = StopControl::default();
    let _watch = {
        let stop = stop.clone();
        interrupt::watch(move || stop.request()).context("failed to install signal handlers")?
    };
    let all = schedule(&points, args.rounds as usize);
    let is_left = |(round, point): &(usize, &PlannedPoint)| store.n_rounds(point) <= *round;
    let todo: Vec<_> = all.iter().copied().filter(is_left).collect();
    let n_done = all.len() - todo.len();
    let mut progress = Progress::of_points(all.len() as u64, n_done as u64, args.quiet, args.json);
    for (round, point) in todo {
        if round == 0
            && let Some(reason) = plan.too_slow(point, &store.measured)
        {
            let omission = Omission { series: point.series.clone(), envs: point.envs, reason };
            progress.log(&omission.to_string());
            omissions.push(omission);
        }
        if omissions.iter().any(|other| (&other.series, other.envs) == (&point.series, point.envs)) {
            progress.skip(1);
            continue;
        }
        progress.status(&[format!("{}, {} envs", point.series.name(), point.envs)]);
        // The speed of a machine may drift, so the peak is measured every time.
        let cores = Cores::measure(&machine, plan.config.resources.n_threads(), true);
        let identity = &identities[&point.series.policy];
        let Some(measured) = measure(&plan, point, identity, cores, &mut progress, &stop)? else {
            break;
        };
        store.add(measured).context("failed to store a point").or_user()?;
        progress.tick();
    }
    progress.finish();
    let points = store.points();
    write_files(&mut output, &settings, &points, &omissions).or_user()?;
    if stop.is_requested() {
        let folder = args.output.display();
        print_message(&format!("interrupted; {folder}: run the same command to resume"));
        return Ok(ExitStatus::Interrupted);
    }
    if args.json {
        let all = std::fs::read_to_string(args.output.join("fps.json")).context("failed to read fps.json")?;
        print_out(&all)?;
    } else {
        print_out(&table(&points))?;
        print_message(&format!("wrote {}", args.output.join("fps.{json,svg}").display()));
    }
    let errors = store.measured.iter().any(|point| point.errors > 0);
    Ok(if errors { ExitStatus::EpisodeErrors } else { ExitStatus::Success })
}

/// Returns the rounds of all points with their indices: series by series, and round by round.
fn schedule(points: &[PlannedPoint], n_rounds: usize) -> Vec<(usize, &PlannedPoint)> {
    let series = points.chunk_by(|a, b| a.series == b.series);
    let rounds = series.flat_map(|own| (0..n_rounds).map(move |round| (round, own)));
    rounds.flat_map(|(round, own)| own.iter().map(move |point| (round, point))).collect()
}

fn speed_plan(args: &FpsArgs) -> Result<SpeedPlan, Failure> {
    let (rendering, inference) = (args.rendering, args.inference);
    let mut config = RunConfig { rendering, inference, ..RunConfig::default() };
    config.query.execute = Some(args.execute);
    config.protocol.clone_from(&args.protocol);
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
    let tasks = TaskSelector::select(&args.tasks);
    Ok(SpeedPlan { policies, modes, envs, tasks, seconds: args.seconds, config, device })
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

/// Resolves what the policies' checkpoints decide for all points, and returns the policies' identities by
/// name. Also checks that they can be loaded.
fn resolve_policies(plan: &mut SpeedPlan) -> Result<BTreeMap<String, Identity>, Failure> {
    let mut all = plan.run_plan(plan.policies.clone(), plan.modes[0], plan.envs[0]);
    let identities = resolve(&mut all, plan.device.as_deref())?;
    plan.config.results.protocol = all.config.results.protocol;
    Ok(all.policies.into_iter().map(|policy| policy.name).zip(identities).collect())
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
        tasks: plan.tasks.iter().map(|task| task.name().to_owned()).collect(),
        seconds: args.seconds,
        policies: json!(identities),
        options: json!({
            "execute": args.execute,
            "threads": plan.config.resources.n_threads(),
            "policy_device": plan.config.inference.policy_device,
            "renderer": rendering.renderer,
            "samples": rendering.samples,
            "protocol": plan.config.results.protocol,
        }),
        machine: json!(machine),
    }
}
