//! `hypogeum pack`: a results file with its checkpoints in one file, which a colleague verifies with one
//! command.

use std::fs::File;
use std::path::PathBuf;

use anyhow::{Context, ensure};
use clap::Args;
use policy_host::formats::content::CheckpointContent;

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::print_message;
use crate::selection::policy::{Identity, NamedPolicy};
use crate::store::package::{PackageWriter, RESULTS};
use crate::store::results::{ResultsFile, copy_snapshot, copy_without_times};

/// Arguments of `pack`.
#[derive(Args, Debug)]
pub(crate) struct PackArgs {
    /// Results file of `run`
    #[arg(value_name = "RESULTS.db")]
    pub(crate) file: PathBuf,
    /// Package to write
    #[arg(short, long, value_name = "FILE.zip")]
    pub(crate) output: PathBuf,
    /// Leave the checkpoints out: the package then says only what their content must be
    #[arg(long)]
    pub(crate) without_checkpoints: bool,
    /// Leave out times and the circumstances of the runs, so that equal results give equal bytes
    #[arg(long)]
    pub(crate) without_times: bool,
}

/// Writes the package.
pub(crate) fn pack(args: &PackArgs) -> Result<ExitStatus, Failure> {
    let file = ResultsFile::read(&args.file).or_user()?;
    let output = args.output.display();
    let n_checkpoints = write(args, &file).or_user()?;
    print_message(&format!(
        "wrote {output}: {} episodes, {n_checkpoints} checkpoints; `hypogeum verify {output}` runs them again",
        file.rows.len(),
    ));
    Ok(ExitStatus::Success)
}

/// Returns the number of checkpoints in the package.
fn write(args: &PackArgs, file: &ResultsFile) -> anyhow::Result<usize> {
    let output = args.output.display();
    ensure!(!args.output.exists(), "{output} exists; remove it, or choose another name with -o");
    // What is missing is noticed before anything is written.
    let mut checkpoints = Vec::new();
    for (name, identity) in file.policies.iter().filter(|_| !args.without_checkpoints) {
        checkpoints.extend(checkpoint(file, name, identity)?.map(|content| (name, content)));
    }
    let folder = tempfile::tempdir().context("failed to create a temporary folder")?;
    let mut copy = folder.path().join(RESULTS);
    copy_snapshot(&args.file, &copy)?;
    if args.without_times {
        let whole = std::mem::replace(&mut copy, folder.path().join("reproducible.db"));
        copy_without_times(&whole, &copy)?;
    }
    let failed = || format!("failed to write {output}");
    // No half-written package has the final name, and the next command replaces what a killed one leaves.
    let mut partial = args.output.clone().into_os_string();
    partial.push(".part");
    let mut package = PackageWriter::new(File::create(&partial).with_context(failed)?);
    // Removed on drop, unless it gets its final name.
    let partial = tempfile::TempPath::try_from_path(partial).with_context(failed)?;
    package.file(RESULTS, &copy).with_context(failed)?;
    for (name, content) in &checkpoints {
        package.checkpoint(name, content).with_context(failed)?;
    }
    package.finish().with_context(failed)?;
    partial.persist_noclobber(&args.output).with_context(failed)?;
    Ok(checkpoints.len())
}

/// Reads the checkpoint of a policy, which must be the one of the results; `None` if it has none.
fn checkpoint(
    file: &ResultsFile,
    name: &str,
    stored: &Identity,
) -> anyhow::Result<Option<CheckpointContent>> {
    let Some(expected) = &stored.checkpoint else { return Ok(None) };
    let policy = NamedPolicy { name: name.to_owned(), spec: stored.spec_beside(&file.path)? };
    let hint =
        || format!("the checkpoint of `{name}` cannot be packed (--without-checkpoints leaves them out)");
    let located = policy.located().with_context(hint)?;
    let Some(folder) = located.spec.checkpoint() else { return Ok(None) };
    let content = CheckpointContent::read(folder).with_context(hint)?;
    let (found, folder) = (content.hash(), folder.display());
    ensure!(
        found == *expected,
        "{}: {folder} has content {found}, but the results were made with {expected}",
        hint()
    );
    Ok(Some(content))
}
