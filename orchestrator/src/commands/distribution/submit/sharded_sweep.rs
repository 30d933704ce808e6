//! A sweep that is to run as shards: its arguments, checked here and now, and the commands of its tasks.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use clap::Args;
use serde_json::{Map, Value, json};

use crate::commands::evaluation::run::RunArgs;
use crate::console::exit::{Failure, OrUser};
use crate::plan::RunPlan;
use crate::plan::partition::{MAX_SHARDS, SweepShard};
use crate::plan::sweep::SweepArgs;
use crate::run::execution::{find_device, resolve};
use crate::run::sharding::{CuttingArgs, OPTIONS, partition, prepare};
use crate::store::results::Manifest;
use crate::store::shards::ShardsFolder;

/// Parses the arguments of `run`.
pub(crate) type ParseRun<'a> = &'a dyn Fn(&[String]) -> anyhow::Result<Box<RunArgs>>;

/// Arguments that name the sweep and its shards, for every engine.
#[derive(Args, Clone, Debug)]
pub(crate) struct ShardingArgs {
    /// Sweep file, as for `run`. Paths are relative to the current folder, in which the tasks run as well
    #[arg(value_name = "SWEEP.toml")]
    pub(crate) file: Option<String>,
    /// Number of shards: some minutes to hours of work each. The results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_SHARDS)))]
    pub(crate) shards: Option<u32>,
    #[command(flatten)]
    pub(crate) cutting: CuttingArgs,
    /// Folder on each machine's own disk for files in progress
    #[arg(long, value_name = "DIR")]
    pub(crate) scratch: Option<String>,
    /// Program that the tasks run [default: this one; with Kubernetes, the image's `hypogeum`]
    #[arg(long, value_name = "PATH")]
    pub(crate) program: Option<String>,
    /// Print what would be submitted, and create nothing
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// Options of `run` for all shards; they override those of the sweep file
    #[arg(last = true, value_name = "RUN OPTIONS")]
    pub(crate) run_options: Vec<String>,
}

/// Settings of a sweep that an engine decides.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct EngineDefaults {
    /// The program of tasks, if it is not this one.
    pub(crate) program: Option<&'static str>,
    /// The scratch folder of tasks.
    pub(crate) scratch: Option<&'static str>,
}

/// A checked sweep.
#[derive(Debug)]
pub(crate) struct ShardedSweep {
    /// Name of the sweep file without its folder and ending.
    pub(crate) name: String,
    /// Number of shards.
    pub(crate) shards: u32,
    /// Folder in which tasks run.
    pub(crate) working_folder: String,
    /// Folder of the shards, relative to that if the results file is.
    pub(crate) folder: ShardsFolder,
    /// Program of the tasks.
    pub(crate) program: String,
    /// Scratch folder of tasks, if one is named.
    pub(crate) scratch: Option<String>,
    /// The options of the run, as its file and the command line state them.
    pub(crate) options: SweepArgs,
    /// Arguments of a shard's task, except `--shard`.
    run_words: Vec<String>,
    /// The results file.
    db: String,
    plan: RunPlan,
    manifest: Manifest,
    pub(crate) cutting: CuttingArgs,
}

impl ShardedSweep {
    /// Checks the arguments: parses those of `run`, and resolves the plan and the policies. Creates nothing.
    pub(crate) fn resolve(
        args: &ShardingArgs,
        defaults: EngineDefaults,
        parse: ParseRun<'_>,
    ) -> Result<Self, Failure> {
        let (Some(file), Some(shards)) = (&args.file, args.shards) else {
            return Err(anyhow!("name the sweep file and the number of shards: SWEEP.toml --shards N"))
                .or_user();
        };
        let is_own = |word: &&String| OPTIONS.contains(&word.split('=').next().unwrap_or_default());
        if let Some(word) = args.run_options.iter().find(is_own) {
            let own = OPTIONS[1..].join(", ");
            return Err(anyhow!(
                "{word} is what `submit` tells the shards: name --shards, {own} before `--`"
            ))
            .or_user();
        }
        let mut run_words = vec!["run".to_owned(), file.clone()];
        run_words.extend(args.run_options.iter().cloned());
        let options = parse(&run_words[1..]).map_err(in_one_line).or_user()?.sweep;
        let mut plan = RunPlan::new(&options).or_user()?;
        let device = find_device(&plan.policies, &mut plan.config)?;
        let identities = resolve(&mut plan, device.as_deref())?;
        let manifest = Manifest::new(&plan, identities);
        partition(&plan, shards, &args.cutting)?;
        let scratch = args.scratch.clone().or(defaults.scratch.map(str::to_owned));
        let share = args.cutting.audit.map(|share| share.to_string());
        let costs = args.cutting.costs.as_deref().map(text).transpose()?;
        let own = [("--audit", &share), ("--costs", &costs), ("--scratch", &scratch)];
        for (option, value) in own {
            run_words.extend(value.iter().flat_map(|value| [option.to_owned(), value.clone()]));
        }
        let stem = Path::new(file).file_stem().and_then(|stem| stem.to_str());
        let working_folder =
            std::env::current_dir().context("failed to find the current folder").or_user()?;
        Ok(Self {
            name: stem.unwrap_or("sweep").to_owned(),
            shards,
            working_folder: text(&working_folder)?,
            folder: ShardsFolder::beside(&plan.db),
            program: program(args, defaults)?,
            scratch,
            options,
            run_words,
            db: text(&plan.db)?,
            plan,
            manifest,
            cutting: args.cutting.clone(),
        })
    }

    /// Creates the folder of the shards, with the file that says what they must agree on.
    pub(crate) fn prepare(&self) -> Result<(), Failure> {
        prepare(&self.plan, &self.manifest, self.shards, &self.cutting).map(drop)
    }

    /// Returns the arguments of the task of `shard`: one shard, or `auto/N`.
    pub(crate) fn run_words(&self, shard: &str) -> Vec<String> {
        let mut words = self.run_words.clone();
        words.extend(["--shard".to_owned(), shard.to_owned()]);
        words
    }

    /// Returns the arguments that merge the shards.
    pub(crate) fn merge_words(&self) -> Vec<String> {
        vec!["merge".to_owned(), self.db.clone(), self.folder_text()]
    }

    /// Returns the path of the folder of the shards.
    pub(crate) fn folder_text(&self) -> String {
        // Derived from the path of the results file, which is UTF-8.
        self.folder.path().to_string_lossy().into_owned()
    }

    /// Returns the path of the log of a shard's task.
    pub(crate) fn log(&self, index: u32) -> PathBuf {
        self.folder.state(SweepShard { index, count: self.shards }).with_extension("log")
    }

    /// Returns the command that shows the progress.
    pub(crate) fn status_command(&self) -> Result<String, Failure> {
        line(&["hypogeum".to_owned(), "status".to_owned(), self.folder_text(), "--watch".to_owned()])
    }

    /// Returns the name with characters that schedulers take.
    pub(crate) fn plain_name(&self) -> String {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
        self.name.chars().map(|c| if is_plain(c) { c } else { '-' }).take(100).collect()
    }

    /// Returns the variables that the templates of all engines know, in which commands are lines of a shell.
    pub(crate) fn variables(&self) -> Result<Map<String, Value>, Failure> {
        let task = |words: Vec<String>| [vec![self.program.clone()], words].concat();
        let run = task(self.run_words(&format!("auto/{}", self.shards)));
        let variables = json!({
            "name": self.plain_name(),
            "shards": self.shards,
            "last": self.shards - 1,
            "folder": self.working_folder,
            "shards_folder": self.folder_text(),
            "run": line(&run)?,
            "run_words": run,
            "merge": line(&task(self.merge_words()))?,
            "status": line(&task(vec!["status".to_owned(), self.folder_text()]))?,
        });
        let Value::Object(variables) = variables else { unreachable!("the macro was given an object") };
        Ok(variables)
    }
}

/// Returns the program of the tasks.
fn program(args: &ShardingArgs, defaults: EngineDefaults) -> Result<String, Failure> {
    match args.program.as_deref().or(defaults.program) {
        Some(program) => Ok(program.to_owned()),
        None => text(&std::env::current_exe().context("failed to find this program").or_user()?),
    }
}

/// Quotes words as one line of a shell.
pub(crate) fn line(words: &[String]) -> Result<String, Failure> {
    let line = shlex::try_join(words.iter().map(String::as_str));
    line.context("an argument cannot be passed to a shell").or_user()
}

/// Returns a path as text.
fn text(path: &Path) -> Result<String, Failure> {
    let text = path.to_str().map(str::to_owned);
    text.with_context(|| format!("the path {} is not UTF-8", path.display())).or_user()
}

/// Shortens an error of the command line to its first line, without the usage of `run`.
fn in_one_line(error: anyhow::Error) -> anyhow::Error {
    match error.downcast::<clap::Error>() {
        Ok(error) if error.use_stderr() => {
            let text = error.render().to_string();
            let reason = text.lines().next().unwrap_or_default();
            anyhow!("{}", reason.trim_start_matches("error: ").to_owned()).context("options of `run`")
        }
        Ok(_) => anyhow!("options of `run`: help and version are not for shards"),
        Err(error) => error,
    }
}
