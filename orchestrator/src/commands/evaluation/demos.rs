//! `hypogeum demos`: successful episodes of the experts as LeRobot datasets.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, anyhow};
use clap::Args;
use ipc_types::{ControlMode, Morphology};
use run_config::allotment::n_cores;
use run_config::{Profile, ProtocolOptions, Strength};
use sim::perturb::{Composition, Language};

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::interrupt;
use crate::selection::condition::Condition;
use crate::selection::names::{NameParser, UnknownName, pick};
use crate::selection::selectors::{PERTURBATION_PARSER, TaskSelector};
use crate::store::build_identity;
use crate::store::demos::{DatasetSettings, DemoPlan, ImageFormat};

/// Arguments of `demos`.
#[derive(Debug, Args)]
pub(crate) struct DemosArgs {
    /// Folder to write to; it receives one dataset each in single/ and bimanual/
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Tasks, comma-separated: names, all, single or bimanual
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "all",
        value_parser = TaskSelector::PARSER, hide_possible_values = true)]
    pub(crate) tasks: Vec<TaskSelector>,
    /// Successful episodes per task
    #[arg(long, value_name = "N", default_value_t = 100,
        value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(crate) episodes: u32,
    /// Suite seed; use another one than for evaluation, where the default is 0
    #[arg(long, value_name = "S", default_value_t = 1000)]
    pub(crate) seed: u64,
    /// Perturbation, or several joined by +
    #[arg(long, value_name = "NAME", default_value = "None", value_parser = PERTURBATION_PARSER,
        hide_possible_values = true)]
    pub(crate) perturbation: Composition,
    /// Strength of the perturbation, from 0.001 to 1
    #[arg(long, value_name = "X", default_value_t = Strength::FULL)]
    pub(crate) strength: Strength,
    /// Reading of the benchmark where its paper and its released code disagree
    #[arg(long, value_enum, ignore_case = true, default_value_t = Profile::Strict)]
    pub(crate) profile: Profile,
    /// Control mode in which single-arm episodes are recorded
    #[arg(long, value_name = "MODE", default_value = "pd_ee_delta_pose", value_parser = DEMO_MODE_PARSER)]
    pub(crate) control_mode: ControlMode,
    #[command(flatten)]
    pub(crate) protocol: ProtocolOptions,
    #[command(flatten)]
    pub(crate) stored_images: StoredImageArgs,
    /// Worker threads [default: one per core]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) threads: Option<u32>,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Arguments on the images in a dataset.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct StoredImageArgs {
    /// File format of the images
    #[arg(long, value_name = "FORMAT", value_enum, ignore_case = true, default_value_t = ImageFormat::Jpeg)]
    pub(crate) images: ImageFormat,
    /// Factor by which images are downscaled before they are stored, for policies that read smaller ones
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub(crate) shrink: u8,
}

/// Control modes in which an expert's episode can be recorded.
const DEMO_MODES: [ControlMode; 2] = [ControlMode::EeDeltaPose, ControlMode::JointPos];

const DEMO_MODE_PARSER: NameParser<ControlMode, UnknownName> = NameParser {
    parse: |typed| pick("control mode", typed, &DEMO_MODES, ControlMode::name),
    names: || DEMO_MODES.map(ControlMode::name).to_vec(),
};

/// Records demonstrations until each task has as many as requested.
pub(crate) fn demos(args: &DemosArgs) -> Result<ExitStatus, Failure> {
    let &DemosArgs { perturbation, strength, profile, control_mode, seed, stored_images, .. } = args;
    let StoredImageArgs { images, shrink } = stored_images;
    let tasks = TaskSelector::select(&args.tasks);
    for &task in &tasks {
        Condition::new(task, perturbation).or_user()?;
    }
    if args.protocol.end.is_some() {
        return Err(anyhow!("--end: demonstrations end with the expert's plan; omit it")).or_user();
    }
    let protocol = args.protocol.resolve(None);
    let language = Language::read(&protocol.instructions, None).or_user()?;
    tasks.iter().try_for_each(|task| language.require(task.task(), profile)).or_user()?;
    let morphology = Morphology::Single;
    let single_arm = DatasetSettings {
        code: build_identity::CODE.to_owned(),
        morphology,
        control_mode,
        perturbation,
        strength,
        profile,
        seed,
        images,
        shrink: usize::from(shrink),
        protocol,
    };
    let n_threads = args.threads.unwrap_or_else(n_cores) as usize;
    let plan = DemoPlan { tasks, episodes: args.episodes, single_arm, language, n_threads };
    let stopped = Arc::new(AtomicBool::new(false));
    let stop = Arc::clone(&stopped);
    let _watch = interrupt::watch(move || stop.store(true, Ordering::Relaxed))
        .context("failed to install signal handlers")?;
    plan.run(&args.output, args.quiet, &stopped).or_user()
}
