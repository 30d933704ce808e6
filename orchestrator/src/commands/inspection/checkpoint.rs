//! `hypogeum checkpoint`: a checkpoint with random weights, for measuring speed.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use ipc_types::Morphology;
use policy_host::models::act::checkpoint::colosseum::ActConfig;
use policy_host::models::pi05::architecture::Pi05Architecture;
use policy_host::models::synthetic;

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::print_message;
use crate::console::output_files::{OutputFolder, Overwriting};
use crate::console::progress::Progress;

/// Arguments of `checkpoint`.
#[derive(Debug, Args)]
pub(crate) struct CheckpointArgs {
    /// Folder to write to; created if absent
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Kind of the policy
    #[arg(long, value_enum, ignore_case = true, default_value_t = NetworkKind::Act)]
    pub(crate) kind: NetworkKind,
    /// Size of the network
    #[arg(long, value_enum, ignore_case = true, default_value_t = NetworkSize::Full)]
    pub(crate) size: NetworkSize,
    /// Robot of a π0.5 network, single or bimanual; an ACT checkpoint has a network for each
    #[arg(long, ignore_case = true, default_value = "single")]
    pub(crate) morphology: MorphologyName,
    #[command(flatten)]
    pub(crate) overwriting: Overwriting,
    /// Seed of the weights
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}

/// The kind of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum NetworkKind {
    /// The action chunking transformer
    Act,
    /// The vision-language-action model π0.5; 6.7 GB in full size
    Pi05,
}

/// The size of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum NetworkSize {
    /// The size that the benchmark trains
    Full,
    /// A small network for tests
    Tiny,
}

/// The robot of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum MorphologyName {
    /// One arm
    Single,
    /// Two arms
    Bimanual,
}

/// Writes the checkpoint.
pub(crate) fn checkpoint(args: &CheckpointArgs) -> Result<ExitStatus, Failure> {
    OutputFolder::claim(&args.output, args.overwriting).or_user()?;
    match args.kind {
        NetworkKind::Act => write_act(args)?,
        NetworkKind::Pi05 => write_pi05(args)?,
    }
    let kind = match args.kind {
        NetworkKind::Act => "act",
        NetworkKind::Pi05 => "pi05",
    };
    let folder = args.output.display();
    print_message(&format!("wrote {folder}; evaluate it with --policy {kind}:{folder}"));
    Ok(ExitStatus::Success)
}

/// Writes one folder per morphology.
fn write_act(args: &CheckpointArgs) -> Result<(), Failure> {
    for morphology in Morphology::ALL {
        let folder = args.output.join(morphology.name());
        let config = match args.size {
            NetworkSize::Full => ActConfig::full_size(morphology),
            NetworkSize::Tiny => ActConfig::tiny(morphology),
        };
        synthetic::write_checkpoint(&folder, &config, args.seed).or_user()?;
    }
    Ok(())
}

fn write_pi05(args: &CheckpointArgs) -> Result<(), Failure> {
    let architecture = match args.size {
        NetworkSize::Full => Pi05Architecture::FULL,
        NetworkSize::Tiny => Pi05Architecture::TINY,
    };
    let morphology = match args.morphology {
        MorphologyName::Single => Morphology::Single,
        MorphologyName::Bimanual => Morphology::Bimanual,
    };
    let mut progress = Progress::of_mebibytes(synthetic::pi05_bytes(&architecture) >> 20);
    let mut written = 0;
    let count = |bytes: u64| {
        let before = written >> 20;
        written += bytes;
        progress.advance((written >> 20) - before);
    };
    synthetic::write_pi05_checkpoint(&args.output, &architecture, morphology, args.seed, count).or_user()?;
    progress.finish();
    Ok(())
}
