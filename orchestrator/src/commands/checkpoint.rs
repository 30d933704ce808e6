//! `hypogeum checkpoint`: a randomly initialised ACT checkpoint for both morphologies, for measuring speed.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use ipc_types::Morphology;
use policy_host::checkpoint::colosseum::ActConfig;
use policy_host::synthetic;

use crate::exit::{ExitStatus, Failure, OrUser};
use crate::output::print_message;

/// Arguments of `checkpoint`.
#[derive(Debug, Args)]
pub(crate) struct CheckpointArgs {
    /// Folder to write to; created if absent
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Size of the network
    #[arg(long, value_enum, ignore_case = true, default_value_t = NetworkSize::Full)]
    pub(crate) size: NetworkSize,
    /// Seed of the weights
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}

/// The size of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum NetworkSize {
    /// The size that the benchmark trains
    Full,
    /// A small network for tests
    Tiny,
}

/// Writes the checkpoint: one folder per morphology.
pub(crate) fn checkpoint(args: &CheckpointArgs) -> Result<ExitStatus, Failure> {
    for morphology in Morphology::ALL {
        let folder = args.output.join(morphology.name());
        let config = match args.size {
            NetworkSize::Full => ActConfig::full_size(morphology),
            NetworkSize::Tiny => ActConfig::tiny(morphology),
        };
        synthetic::write_checkpoint(&folder, &config, args.seed).or_user()?;
    }
    print_message(&format!("wrote {0}; evaluate it with --policy act:{0}", args.output.display()));
    Ok(ExitStatus::Success)
}
