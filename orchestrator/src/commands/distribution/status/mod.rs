//! `hypogeum status`: the progress of the shards of a sweep, from the files in their folder.

mod overview;
mod shard_status;
mod totals;
mod watch;

use std::path::PathBuf;

use clap::Args;

use self::overview::MAX_AGE;
pub(crate) use self::overview::Overview;
pub(crate) use self::watch::StatusLines;
use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::print_out;
use crate::store::shards::ShardsFolder;

/// Arguments of `status`.
#[derive(Debug, Args)]
pub(crate) struct StatusArgs {
    /// Folder of the shards: results.shards for --db results.db
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Go on until all shards have finished, or some have failed and none is running or waiting
    #[arg(long)]
    watch: bool,
    /// Print one JSON object instead of a table
    #[arg(long, conflicts_with = "watch")]
    json: bool,
}

/// Prints the progress of all shards. The exit code is 1 if some have failed.
pub(crate) fn status(args: &StatusArgs) -> Result<ExitStatus, Failure> {
    let folder = ShardsFolder::at(&args.folder);
    if args.watch {
        return watch::watch(&folder);
    }
    let overview = Overview::read(&folder, Some(MAX_AGE)).or_user()?;
    let text = if args.json { format!("{:#}\n", overview.json()) } else { overview.text() };
    print_out(&text)?;
    Ok(overview.exit_status())
}
