//! `hypogeum merge`: joins the results files of shards, and compares rows that occur twice.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use clap::Args;
use serde_json::json;

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::interrupt;
use crate::console::output::{print_message, print_out};
use crate::console::progress::Progress;
use crate::console::table::{Align, TextTable};
use crate::run::sharding::OPTIONS;
use crate::store::merging::{MergeObserver, MergeOutcome, merge as merge_files};
use crate::store::results::gap_lines;
use crate::store::shards::results_files;

/// Arguments of `merge`.
#[derive(Args, Debug)]
pub(crate) struct MergeArgs {
    /// Results file to create, or to add rows to. None of its rows is lost or changed
    #[arg(value_name = "OUT.db")]
    pub(crate) out: PathBuf,
    /// Results files of shards or of any runs with the same settings, or folders of shards
    #[arg(value_name = "SHARD.db|DIR", required = true)]
    pub(crate) inputs: Vec<PathBuf>,
    /// Print one JSON object instead of sentences
    #[arg(long)]
    pub(crate) json: bool,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Merges the files, and says what is missing, what was compared and what differs.
pub(crate) fn merge(args: &MergeArgs) -> Result<ExitStatus, Failure> {
    let inputs = results_files(&args.inputs).or_user()?;
    raise_file_limit();
    let stop = Arc::new(AtomicBool::new(false));
    let stopper = Arc::clone(&stop);
    let _watch = interrupt::watch(move || stopper.store(true, Ordering::Relaxed))
        .context("failed to install signal handlers")?;
    let mut view = MergeView { progress: Progress::of_rows(0, true), quiet: args.quiet, stop };
    let outcome = merge_files(&args.out, &inputs, &mut view);
    view.progress.finish();
    let outcome = outcome.or_user()?;
    if outcome.is_stopped {
        print_message("interrupted; nothing was changed");
        return Ok(ExitStatus::Interrupted);
    }
    let text = if args.json {
        format!("{:#}\n", json_report(args, &outcome))
    } else {
        report(args, inputs.len(), &outcome)
    };
    print_out(&text)?;
    let is_complete = outcome.gaps.as_ref().is_none_or(Vec::is_empty) && outcome.n_errors == 0;
    let is_done = is_complete && outcome.n_contradictions == 0;
    Ok(if is_done { ExitStatus::Success } else { ExitStatus::EpisodeErrors })
}

/// Allows as many open files as the system lets this user have: each shard is one.
fn raise_file_limit() {
    use rustix::process::{Resource, getrlimit, setrlimit};
    let mut limit = getrlimit(Resource::Nofile);
    limit.current = limit.maximum;
    // What is possible without it is done.
    let _ = setrlimit(Resource::Nofile, limit);
}

/// The display of merging.
struct MergeView {
    progress: Progress,
    quiet: bool,
    stop: Arc<AtomicBool>,
}

impl MergeObserver for MergeView {
    fn begin(&mut self, n_rows: u64) {
        self.progress = Progress::of_rows(n_rows, self.quiet);
    }

    fn on_rows(&mut self, n: u64) {
        self.progress.advance(n);
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

fn report(args: &MergeArgs, n_files: usize, outcome: &MergeOutcome) -> String {
    let out = args.out.display();
    if outcome.n_contradictions > 0 {
        return contradictions(outcome)
            + &format!(
                "{} episodes that several files have differ: an episode must have the same row on every machine. \
                 Nothing was written; `hypogeum verify FILE` runs the episodes of a file again, and without the files of \
                 a machine that you distrust the others can be merged\n",
                outcome.n_contradictions
            );
    }
    let files = if n_files == 1 { "1 file".to_owned() } else { format!("{n_files} files") };
    let mut text = match outcome.n_new {
        0 => format!("{out}: nothing new in {files}, {} episodes\n", outcome.n_rows),
        n => format!("{out}: {} episodes, {n} of them new, from {files}\n", outcome.n_rows),
    };
    text += &audit(outcome);
    if outcome.n_errors > 0 {
        text += &format!("{} episodes could not be run\n", outcome.n_errors);
    }
    text += &gap_lines(outcome.gaps.as_deref());
    let n_missing: u64 = outcome.gaps.iter().flatten().map(|gap| u64::from(gap.n)).sum();
    if let Some(command) = outcome.command.as_ref().filter(|_| n_missing + outcome.n_errors > 0) {
        text += &format!("to run just what is missing: {}\n", completion(command, args));
    }
    text
}

/// Says how many episodes were compared.
fn audit(outcome: &MergeOutcome) -> String {
    if outcome.n_compared == 0 && outcome.n_audited == 0 {
        return String::new();
    }
    let of = if outcome.n_audited > 0 { format!(" of {} audited", outcome.n_audited) } else { String::new() };
    let machines = match machines(&outcome.machines) {
        named if outcome.n_compared == 0 || named.is_empty() => String::new(),
        named => format!("; machines: {named}"),
    };
    format!("{}{of} episodes were run by two tasks and agree in every column{machines}\n", outcome.n_compared)
}

/// Lists machines, those of one kind together: `n1, n2 (CPU; extensions)`.
fn machines(machines: &BTreeSet<String>) -> String {
    let mut kinds: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for machine in machines {
        let (name, kind) = machine.split_once(" (").unwrap_or((machine, ""));
        kinds.entry(kind).or_default().push(name);
    }
    let kind = |(kind, names): (&str, Vec<&str>)| match kind {
        "" => names.join(", "),
        kind => format!("{} ({kind}", names.join(", ")),
    };
    kinds.into_iter().map(kind).collect::<Vec<_>>().join("; ")
}

fn contradictions(outcome: &MergeOutcome) -> String {
    use Align::{Left, Right};
    let columns = ["policy", "task", "perturbation"].map(|name| (name, Left));
    let more = [("episode", Right), ("column", Left)];
    let sides = ["first", "second", "first file", "second file"].map(|name| (name, Left));
    let mut table = TextTable::new(&[&columns[..], &more[..], &sides[..]].concat());
    for contradiction in &outcome.contradictions {
        let file = |idx: usize| {
            let (path, machines) = &contradiction.files[idx];
            format!(
                "{} on {}",
                path.display(),
                if machines.is_empty() { "an unknown machine".to_owned() } else { machines.join(" or ") }
            )
        };
        let mut cells = contradiction.names.to_vec();
        cells.extend([contradiction.episode.to_string(), contradiction.column.to_owned()]);
        cells.extend(contradiction.values.iter().cloned());
        cells.extend([file(0), file(1)]);
        table.row(cells);
    }
    table.to_string()
}

/// Returns the command that runs what is missing in the merged file.
fn completion(command: &[String], args: &MergeArgs) -> String {
    let mut words = vec!["hypogeum".to_owned()];
    let mut left = command.iter();
    while let Some(word) = left.next() {
        let name = word.split('=').next().unwrap_or_default();
        match name == "--db" || OPTIONS.contains(&name) {
            true if word.contains('=') => {}
            true => drop(left.next()),
            false => words.push(word.clone()),
        }
    }
    words.extend(["--db".to_owned(), args.out.display().to_string()]);
    // Only a NUL byte cannot be quoted, and arguments have none.
    shlex::try_join(words.iter().map(String::as_str)).unwrap_or_default()
}

fn json_report(args: &MergeArgs, outcome: &MergeOutcome) -> serde_json::Value {
    let contradiction = |it: &crate::store::merging::Contradiction| {
        json!({
            "policy": it.names[0], "task": it.names[1], "perturbation": it.names[2], "episode": it.episode,
            "column": it.column, "values": it.values, "files": it.files,
        })
    };
    json!({
        "out": args.out,
        "episodes": outcome.n_rows,
        "new": outcome.n_new,
        "errors": outcome.n_errors,
        "compared": outcome.n_compared,
        "audited": outcome.n_audited,
        "machines": outcome.machines,
        "n_differing": outcome.n_contradictions,
        "differing": outcome.contradictions.iter().map(contradiction).collect::<Vec<_>>(),
        "missing": outcome.gaps,
        "command": outcome.command.as_ref().map(|command| completion(command, args)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn machines_of_one_kind_are_listed_together() {
        let named =
            ["n2 (CPU A; avx2)", "n1 (CPU A; avx2)", "n3 (CPU B; fma avx2)", "old"].map(str::to_owned);
        assert_eq!(machines(&BTreeSet::from(named)), "old; n1, n2 (CPU A; avx2); n3 (CPU B; fma avx2)");
    }

    #[test]
    fn completion_leaves_the_options_of_shards_out() {
        let words = "run sweep.toml --db=old.db --shard 3/16 --scratch /tmp --audit 1% --costs a.db --seed 2";
        let words: Vec<String> = words.split(' ').map(str::to_owned).collect();
        let args = MergeArgs { out: "my out.db".into(), inputs: Vec::new(), json: false, quiet: false };
        assert_eq!(completion(&words, &args), "hypogeum run sweep.toml --seed 2 --db 'my out.db'");
    }
}
