//! `hypogeum verify`: runs episodes of somebody's results again and compares every column.

mod findings;

use std::collections::HashMap;
use std::path::PathBuf;

use anyhow::{Context, anyhow, bail, ensure};
use clap::Args;
use policy_host::PolicySpec;
use policy_host::device;
use policy_host::device::DeviceRequest;
use run_config::{
    Amount, DeviceChoice, Execution, ImageOptions, Instructions, LanguageFile, MAX_ENVS, RendererChoice,
    ResultOptions, RunConfig, Samples,
};
use serde_json::{Value, json};
use sim::scene::stream::Stream;
use sim::serve::protocol::Outcome;

use self::findings::{Difference, Unverifiable, count_rows, differences, json_report, text_report};
use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::{print_message, print_out};
use crate::console::progress::Progress;
use crate::fleet::{FleetEvent, RunStatus};
use crate::plan::RunPlan;
use crate::plan::jobs::{Job, JobList, drivers};
use crate::run::execution::{execute, resolve};
use crate::selection::condition::Condition;
use crate::selection::policy::{Identity, NamedPolicy};
use crate::store::build_identity;
use crate::store::merging::{Unwatched, merge};
use crate::store::package::Package;
use crate::store::results::{ENVIRONMENT, EpisodeRow, ResultsFile, gap_lines, gaps};
use crate::store::shards::results_files;

/// Arguments of `verify`.
#[derive(Args, Clone, Debug)]
pub(crate) struct VerifyArgs {
    /// Results file of `run`, package of `pack`, or the shards of a sweep: their files or folder
    #[arg(value_name = "RESULTS.db|FILE.zip|DIR", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Run a random sample of this many episodes [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) sample: Option<u32>,
    /// Seed of the sample
    #[arg(long, value_name = "S", default_value_t = 0, requires = "sample")]
    pub(crate) seed: u64,
    /// Place of a policy's checkpoint, if it is not where it was (repeatable)
    #[arg(long = "checkpoint", value_name = "NAME=PATH", value_parser = parse_checkpoint)]
    pub(crate) checkpoints: Vec<(String, PathBuf)>,
    /// The paraphrases with which the results were made, if not the built-in ones
    #[arg(long, value_name = "FILE")]
    pub(crate) language: Option<LanguageFile>,
    /// File of --instructions with which the results were made, if it was one
    #[arg(long, value_name = "FILE")]
    pub(crate) instructions: Option<LanguageFile>,
    /// Episodes in progress at a time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_ENVS)), default_value_t = 16)]
    pub(crate) envs: u32,
    /// Worker threads of the sim and of each policy host; by default one per core
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) threads: Option<u32>,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub(crate) json: bool,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Runs a sample of the episodes again and compares them with their rows.
pub(crate) fn verify(args: &VerifyArgs) -> Result<ExitStatus, Failure> {
    let paths = results_files(&args.files).or_user()?;
    let [path] = paths.as_slice() else { return verify_file(&read_merged(&paths).or_user()?, args) };
    let Some(package) = Package::unpack(path).or_user()? else {
        return verify_file(&ResultsFile::read(path).or_user()?, args);
    };
    let file = package.read_results().or_user()?;
    let names = file.policies.keys().filter(|name| args.checkpoints.iter().all(|(given, _)| given != *name));
    let packed = names.filter_map(|name| Some((name.clone(), package.checkpoint(name)?)));
    let checkpoints = args.checkpoints.iter().cloned().chain(packed).collect();
    verify_file(&file, &VerifyArgs { checkpoints, ..args.clone() })
}

/// Reads several files as one.
fn read_merged(paths: &[PathBuf]) -> anyhow::Result<ResultsFile> {
    let folder = tempfile::tempdir().context("failed to create a temporary folder")?;
    let merged = folder.path().join("merged.db");
    let outcome = merge(&merged, paths, &mut Unwatched)?;
    if let Some(it) = outcome.contradictions.first() {
        let ([policy, task, perturbation], [a, b]) = (&*it.names, &it.files);
        bail!(
            "episode {} of {policy} on {task} under {perturbation} differs between {} and {} in {}; verify each file alone",
            it.episode,
            a.0.display(),
            b.0.display(),
            it.column
        );
    }
    // Messages and relative paths of checkpoints refer to the first file.
    Ok(ResultsFile { path: paths[0].clone(), ..ResultsFile::read(&merged)? })
}

fn verify_file(file: &ResultsFile, args: &VerifyArgs) -> Result<ExitStatus, Failure> {
    let mut config = config(file, args).or_user()?;
    check_checkpoint_names(file, args).or_user()?;
    let gaps = gaps(file).or_user()?;
    let mut unverifiable = Unverifiable::new();
    let mut policies = available_policies(file, args, &mut unverifiable);
    let device = choose_device(file, &mut policies, &mut unverifiable);
    (config.inference.policy_device, config.resources.gpu) = (device.choice, device.index);
    let rows = select(file, args, &policies, &mut unverifiable);
    let mut plan = plan(file, &config, policies, &rows);
    let stored = plan.executions.clone();
    // Checks that the checkpoints can be loaded. Their chunks are used as in the file.
    let identities = resolve(&mut plan, None)?;
    plan.executions = stored;
    let outcomes = run(&plan, &identities, file, &rows, args)?;
    let Some(outcomes) = outcomes else { return Ok(ExitStatus::Interrupted) };
    let differences: Vec<Difference<'_>> = rows
        .iter()
        .zip(&outcomes)
        .flat_map(|(row, outcome)| differences(file, row, outcome, config.results.seed))
        .collect();
    let n_differing = count_rows(&differences);
    if args.json {
        let report = json_report(file, rows.len(), &differences, &unverifiable, gaps.as_deref());
        print_out(&format!("{report:#}\n"))?;
    } else {
        print_out(&(text_report(file, &differences, &unverifiable) + &gap_lines(gaps.as_deref())))?;
    }
    if rows.is_empty() {
        print_message("no episode could be run again");
    } else {
        let n_agree = rows.len() - n_differing;
        // Of rows that were left out for another reason than chance, the others say nothing.
        let n_all = (args.sample.is_some() && unverifiable.is_empty()).then_some(file.rows.len());
        print_message(&agreement(n_agree, rows.len(), n_all));
    }
    let is_complete = gaps.is_some_and(|gaps| gaps.is_empty());
    let all_agree = n_differing == 0 && unverifiable.is_empty() && !rows.is_empty() && is_complete;
    Ok(if all_agree { ExitStatus::Success } else { ExitStatus::EpisodeErrors })
}

/// Formats how many episodes agree. If they are a random sample of `n_all` and show no difference, adds what
/// that says about the others.
fn agreement(n_agree: usize, n_run: usize, n_all: Option<usize>) -> String {
    let mut text = format!("{n_agree} of {n_run} episodes agree in every column");
    if let Some(n_all) = n_all.filter(|n_all| n_agree == n_run && n_run < *n_all) {
        // With this share of rows that reproduce, a sample without a difference has a probability of 5 %.
        let share = libm::pow(0.05, 1.0 / n_run as f64);
        text += &format!("; with 95 % confidence, so do at least {:.1} % of all {n_all}", 100.0 * share);
    }
    text
}

/// Restores the configuration from the manifest.
fn config(file: &ResultsFile, args: &VerifyArgs) -> anyhow::Result<RunConfig> {
    let path = file.path.display();
    let version = file.manifest.get("version").and_then(Value::as_str).unwrap_or("unknown");
    let ours = build_identity::VERSION;
    ensure!(
        version == ours,
        "{path} was made by version {version} of the simulator and this is {ours}, whose episodes may differ; verify it \
         with version {version}"
    );
    let code = file.manifest.get("code").and_then(Value::as_str).unwrap_or("unknown");
    if code != build_identity::CODE {
        let commit =
            file.manifest.get(ENVIRONMENT).and_then(|circumstances| circumstances["commit"].as_str());
        print_message(&format!(
            "{path} was made by a different build (code {code}, commit {}; this one is code {}, commit {}), so its episodes may \
             differ",
            commit.unwrap_or("unknown"),
            build_identity::CODE,
            build_identity::COMMIT
        ));
    }
    let mut config = RunConfig::default();
    let Value::Object(mut options) = json!(config.results) else {
        unreachable!("a struct becomes an object")
    };
    for (key, value) in &mut options {
        let is_file = |stored: &&Value| key == "language" || key == "instructions" && !is_named(stored);
        if let Some(stored) = file.manifest.get(key).filter(|stored| !is_file(stored)) {
            *value = stored.clone();
        }
    }
    config.results = serde_json::from_value::<ResultOptions>(Value::Object(options))
        .with_context(|| format!("{path}: its manifest has an option with an invalid value"))?;
    let stored =
        |key: &str| file.manifest.get(key).filter(|stored| !is_named(stored)).and_then(Value::as_str);
    check_file(file, ("language", "built-in paraphrases"), stored("language"), args.language.as_ref())?;
    config.results.language.clone_from(&args.language);
    let own = args.instructions.as_ref();
    check_file(file, ("instructions", "sentences of a protocol"), stored("instructions"), own)?;
    if let Some(own) = own {
        config.results.protocol.instructions = Instructions::File(own.clone());
    }
    config.protocol = config.results.protocol.clone().into();
    if let Some(identity) = file.manifest.get("renderer").and_then(Value::as_str) {
        let choice = file.manifest.get(ENVIRONMENT).and_then(|environment| environment["renderer"].as_str());
        config.rendering = image_options(identity, choice);
    }
    config.resources.keep_actions = false;
    config.resources.envs = Amount::Fixed(args.envs);
    config.resources.threads = args.threads.map_or(config.resources.threads, Amount::Fixed);
    Ok(config)
}

/// Returns `true` if the stored value of `instructions` is a name and not the content hash of a file.
fn is_named(stored: &Value) -> bool {
    serde_json::from_value::<Instructions>(stored.clone()).is_ok()
}

/// Checks that the user names the file of sentences with which the results were made, whose content is
/// `stored`.
fn check_file(
    file: &ResultsFile,
    (option, default): (&str, &str),
    stored: Option<&str>,
    given: Option<&LanguageFile>,
) -> anyhow::Result<()> {
    let path = file.path.display();
    let given = json!(given);
    match (stored, given.get("fingerprint").and_then(Value::as_str)) {
        (Some(stored), Some(given)) => {
            ensure!(
                stored == given,
                "--{option} has content {given}, but {path} was made with content {stored}"
            );
        }
        (Some(stored), None) => {
            bail!("{path} was made with the sentences of a file; name it with --{option} (content {stored})");
        }
        (None, Some(_)) => bail!("{path} was made with the {default}; omit --{option}"),
        (None, None) => {}
    }
    Ok(())
}

/// Returns the options that lead to a renderer with this identity, which was opened by `choice`, if the
/// machine has one.
fn image_options(identity: &str, choice: Option<&str>) -> ImageOptions {
    let samples = if identity.ends_with("with 4 samples per pixel") { Samples::Four } else { Samples::One };
    let renderer = match choice {
        _ if identity.starts_with("cpu") => RendererChoice::Cpu,
        Some("software") => RendererChoice::Software,
        _ => RendererChoice::Gpu,
    };
    ImageOptions { renderer, samples }
}

/// Checks that `--checkpoint` names policies of the file.
fn check_checkpoint_names(file: &ResultsFile, args: &VerifyArgs) -> anyhow::Result<()> {
    let unknown = args.checkpoints.iter().find(|(name, _)| !file.policies.contains_key(name));
    if let Some((name, _)) = unknown {
        let known: Vec<&str> = file.policies.keys().map(String::as_str).collect();
        let (path, known) = (file.path.display(), known.join(", "));
        return Err(anyhow!("--checkpoint names the policy `{name}`, but {path} has {known}"));
    }
    Ok(())
}

/// Returns the policies that can be run again, and notes the others.
fn available_policies(
    file: &ResultsFile,
    args: &VerifyArgs,
    unverifiable: &mut Unverifiable,
) -> Vec<NamedPolicy> {
    let mut available = Vec::new();
    for (name, stored) in &file.policies {
        match available_policy(file, name, stored, args) {
            Ok(policy) => available.push(policy),
            Err(reason) => {
                unverifiable.insert(name.clone(), (format!("{reason:#}"), 0));
            }
        }
    }
    available
}

/// Returns the device of the first policy that may have computed on a GPU. Drops those of other devices,
/// which take another run.
fn choose_device(
    file: &ResultsFile,
    policies: &mut Vec<NamedPolicy>,
    unverifiable: &mut Unverifiable,
) -> DeviceRequest {
    let request = |policy: &NamedPolicy| {
        let stored = file.policies.get(&policy.name).filter(|_| device::supports_gpu(&policy.spec))?;
        Some(device::request_of(stored.device.as_deref()))
    };
    let chosen = policies.iter().find_map(request).unwrap_or(DeviceChoice::Cpu.into());
    policies.retain(|policy| {
        let is_same = request(policy).is_none_or(|request| request == chosen);
        if !is_same {
            let reason = "it computed on another device than the policies before it".to_owned();
            unverifiable.insert(policy.name.clone(), (reason, 0));
        }
        is_same
    });
    chosen
}

fn available_policy(
    file: &ResultsFile,
    name: &str,
    stored: &Identity,
    args: &VerifyArgs,
) -> anyhow::Result<NamedPolicy> {
    let given = args.checkpoints.iter().find(|(policy, _)| policy == name).map(|(_, path)| path.clone());
    let spec = match (stored.spec_beside(&file.path)?, given) {
        (PolicySpec::Attach(host), _) => {
            return Err(anyhow!("it ran in a foreign host, `{host}`, whose code is not known"));
        }
        (PolicySpec::Server(server), _) => {
            return Err(anyhow!("it ran in the server {server}, whose policy is not known"));
        }
        (spec, Some(path)) => spec.with_checkpoint(&path),
        (spec, _) => spec,
    };
    let policy = NamedPolicy { name: name.to_owned(), spec };
    let found = device::find(&[&policy.spec], device::request_of(stored.device.as_deref()))?;
    let located =
        policy.located().with_context(|| format!("name its checkpoint with --checkpoint {name}=PATH"))?;
    let found = located
        .identity(found.identity.as_deref(), stored.execution.unwrap_or(Execution::ENSEMBLE))
        .with_context(|| format!("name its checkpoint with --checkpoint {name}=PATH"))?;
    ensure!(found.matches(stored), "it was {stored}, but now it would be {found}");
    Ok(policy)
}

/// Chooses the rows to run again, in the order of the file. Rows of other policies are counted.
fn select<'a>(
    file: &'a ResultsFile,
    args: &VerifyArgs,
    policies: &[NamedPolicy],
    unverifiable: &mut Unverifiable,
) -> Vec<&'a EpisodeRow> {
    let mut rows: Vec<&EpisodeRow> = file.rows.iter().collect();
    if let Some(n) = args.sample {
        let mut stream = Stream::new(args.seed, "verify");
        let n_drawn = (n as usize).min(rows.len());
        // The drawn rows move to the front.
        for idx in 0..n_drawn {
            let left = rows.len() - idx;
            rows.swap(idx, idx + (stream.unit() * left as f64) as usize);
        }
        rows.truncate(n_drawn);
        rows.sort_by_key(|row| (row.policy, row.condition.task, row.condition.perturbation, row.episode));
    }
    rows.retain(|row| {
        let name = file.policy(row);
        if let Some(error) = row.error {
            let reason = format!("they ended with an error, for example: {}", file.text(error));
            unverifiable.entry(format!("errors of {name}")).or_insert((reason, 0)).1 += 1;
            return false;
        }
        if let Some((_, n)) = unverifiable.get_mut(name) {
            *n += 1;
        }
        policies.iter().any(|policy| policy.name == name)
    });
    unverifiable.retain(|_, (_, n)| *n > 0);
    rows
}

/// Makes a plan that has the policies and conditions of the rows.
fn plan(file: &ResultsFile, config: &RunConfig, policies: Vec<NamedPolicy>, rows: &[&EpisodeRow]) -> RunPlan {
    let mut conditions: Vec<Condition> = rows.iter().map(|row| row.condition).collect();
    conditions.sort_by_key(|condition| (condition.task, condition.perturbation));
    conditions.dedup();
    let is_used = |policy: &NamedPolicy| rows.iter().any(|row| file.policy(row) == policy.name);
    let policies: Vec<_> = policies.into_iter().filter(is_used).collect();
    let execution = |policy: &NamedPolicy| file.policies[&policy.name].execution;
    RunPlan {
        executions: policies.iter().map(|policy| execution(policy).unwrap_or(Execution::ENSEMBLE)).collect(),
        policies,
        conditions,
        episodes: rows.len() as u32,
        config: config.clone(),
        db: file.path.clone(),
        stopping: None,
    }
}

/// Runs the episodes of the rows. Returns their outcomes in the same order; `None` if the user interrupted.
fn run(
    plan: &RunPlan,
    identities: &[Identity],
    file: &ResultsFile,
    rows: &[&EpisodeRow],
    args: &VerifyArgs,
) -> Result<Option<Vec<Outcome>>, Failure> {
    let drivers = drivers(plan);
    let job = |row: &&EpisodeRow| {
        let policy_idx = plan.policies.iter().position(|policy| policy.name == file.policy(row))?;
        let (driver, EpisodeRow { condition, episode, seed, .. }) = (drivers[policy_idx], **row);
        Some(Job { policy_idx, condition, episode, seed, driver })
    };
    let jobs: Vec<Job> = rows.iter().filter_map(job).collect();
    let renderer = file.manifest.get("renderer").and_then(Value::as_str);
    let renderer = renderer.filter(|_| plan.needs_images());
    let key = |job: &Job| (job.policy_idx, job.condition, job.episode);
    let positions: HashMap<_, usize> = jobs.iter().enumerate().map(|(idx, job)| (key(job), idx)).collect();
    let mut outcomes: Vec<Option<Outcome>> = jobs.iter().map(|_| None).collect();
    let mut progress = Progress::of_replays(jobs.len() as u64, args.quiet);
    let mut observer = |event: &FleetEvent<'_>| {
        match event {
            FleetEvent::EpisodeFinished(job, outcome) => {
                if let Some(&idx) = positions.get(&key(job)) {
                    outcomes[idx] = Some((*outcome).clone());
                }
                progress.tick();
            }
            FleetEvent::Counters(counters) => progress.counters(counters),
            FleetEvent::Log(line) => progress.log(line),
            FleetEvent::RendererReady(_) | FleetEvent::Spans(..) => {}
        }
        Ok(())
    };
    let status = execute(plan, identities, JobList::of(jobs), renderer, &mut observer);
    progress.finish();
    let (status, _totals) = status?;
    if status == RunStatus::Stopped {
        print_message("interrupted; nothing was changed");
        return Ok(None);
    }
    let outcomes = outcomes.into_iter().collect::<Option<Vec<_>>>();
    outcomes.map(Some).ok_or_else(|| Failure::Bug(anyhow!("an episode ended without an outcome")))
}

fn parse_checkpoint(typed: &str) -> Result<(String, PathBuf), String> {
    match typed.split_once('=') {
        Some((name, path)) if !name.is_empty() && !path.is_empty() => Ok((name.to_owned(), path.into())),
        _ => Err("expected NAME=PATH".to_owned()),
    }
}
