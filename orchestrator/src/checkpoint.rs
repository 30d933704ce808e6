//! `hypogeum checkpoint`: a randomly initialised ACT checkpoint for both morphologies, to measure speed with.

use std::path::PathBuf;

use clap::ValueEnum;
use ipc_types::Morphology;
use policy_host::checkpoint::colosseum::ActConfig;
use policy_host::synthetic;

use crate::cli::CheckpointArgs;
use crate::failure::{Ending, Failure, OrUser};
use crate::progress::print;

/// How large a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Size {
    /// The size that the benchmark trains
    Full,
    /// For tests
    Tiny,
}

impl Size {
    fn config(self, morphology: Morphology) -> ActConfig {
        match self {
            Self::Full => ActConfig::full_size(morphology),
            Self::Tiny => ActConfig::tiny(morphology),
        }
    }
}

/// Writes it: one folder per morphology.
pub(crate) fn write(args: &CheckpointArgs) -> Result<Ending, Failure> {
    for morphology in Morphology::ALL {
        let folder: PathBuf = args.output.join(morphology.name());
        synthetic::write_checkpoint(&folder, &args.size.config(morphology), args.seed)
            .map_err(|error| anyhow::anyhow!("failed to {error}"))
            .or_user()?;
    }
    print(&format!("wrote {0}; evaluate it with --policy act:{0}", args.output.display()));
    Ok(Ending::Done)
}
