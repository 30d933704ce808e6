//! `hypogeum record`: the writer of datasets behind `hypogeum.record` of the Python package.

use std::io;
use std::path::PathBuf;

use clap::Args;
use ipc_types::Morphology;
use run_config::{ResultOptions, RunConfig};
use sim::perturb::Composition;

use super::demos::StoredImageArgs;
use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::selection::selectors::PERTURBATION_PARSER;
use crate::store::build_identity;
use crate::store::demos::{DatasetSettings, append};

/// Arguments of `record`.
#[derive(Debug, Args)]
pub(crate) struct RecordArgs {
    /// Folder of the dataset
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// The tasks need two arms
    #[arg(long)]
    bimanual: bool,
    /// Perturbation of all episodes, or several joined by +
    #[arg(long, value_name = "NAME", default_value = "None", value_parser = PERTURBATION_PARSER,
        hide_possible_values = true)]
    perturbation: Composition,
    #[command(flatten)]
    stored_images: StoredImageArgs,
    #[command(flatten)]
    config: RunConfig,
}

/// Appends the episodes on stdin to a dataset.
pub(crate) fn record(args: &RecordArgs) -> Result<ExitStatus, Failure> {
    let &RecordArgs { bimanual, perturbation, stored_images, .. } = args;
    let StoredImageArgs { images, shrink } = stored_images;
    let &ResultOptions { seed, profile, strength, control_mode, .. } = &args.config.results;
    let morphology = if bimanual { Morphology::Bimanual } else { Morphology::Single };
    let settings = DatasetSettings {
        code: build_identity::CODE.to_owned(),
        morphology,
        control_mode: morphology.control_mode(control_mode),
        perturbation,
        strength,
        profile,
        seed,
        images,
        shrink: usize::from(shrink),
        protocol: args.config.protocol.resolve(None),
    };
    let n_threads = args.config.resources.n_threads() as usize;
    append(&args.output, &settings, io::stdin().lock(), io::stdout(), n_threads).or_user()?;
    Ok(ExitStatus::Success)
}
