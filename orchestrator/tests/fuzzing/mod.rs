//! Entry points of the fuzz targets (`tests/harness`): reading of sweeps, results files and tables without
//! starting a run. They are public for the package `tests` only; nothing else may call them.
//!
//! Each returns the error that a user would read, and panics where the program would report a bug.

use std::ffi::OsString;
use std::path::Path;
use std::rc::Rc;

use run_config::Execution;
use serde_json::Value;
use sim::Perturbation;
use sim::scene::stream::episode_seed;
use sim::serve::protocol::{EpisodeLedger, Outcome};

use crate::cli::evaluation_args::EvaluationArgs;
use crate::cli::{Cli, Command};
use crate::commands::results::compare;
use crate::console::exit::{Failure, OrUser};
use crate::console::output_files::{OutputFolder, Overwriting};
use crate::plan::RunPlan;
use crate::plan::partition::{EpisodeCosts, Partition, ShardPart, SweepShard};
use crate::plan::sweep::{DEFAULT_LEVELS, SweepArgs};
use crate::run::stopping::Stopping;
use crate::selection::policy::Identity;
use crate::selection::selectors::{PerturbationSelector, TaskSelector};
use crate::store::export::{ExportFormat, export};
use crate::store::merging::{Unwatched, merge};
use crate::store::results::{EpisodeKey, Manifest, RecordedEpisodes, Results, SHARD, StoredPlan};
use crate::study::analysis::{Comparison, ComparisonOptions, Evaluation, Metric, read_files};
use crate::study::page::{self, ExternalData, FpsTable, HardwareTable, PageOptions, ReportContent};
use crate::study::report;

/// A run whose arguments were accepted.
#[derive(Debug, PartialEq, Eq)]
pub struct ResolvedRun {
    /// The plan in debug format.
    pub plan: String,
    /// A sweep file that stands for the same plan.
    pub sweep: String,
}

/// Resolves the command line of `hypogeum run`, program name included.
///
/// # Errors
/// The message; of clap's, which add a hint, the first line.
///
/// # Panics
/// If the words are another command.
pub fn resolve_run(words: &[OsString]) -> Result<ResolvedRun, String> {
    let cli = Cli::parse_with_sweep_file(words).map_err(|error| match error.downcast::<clap::Error>() {
        Ok(error) => error.to_string().lines().next().unwrap_or_default().to_owned(),
        Err(error) => Failure::User(error).to_string(),
    })?;
    let Command::Run(args) = cli.command else { panic!("the command is `run`") };
    let plan = RunPlan::new(&args.sweep).or_user().map_err(|failure| failure.to_string())?;
    // The arguments are part of the plan in which they result.
    Ok(ResolvedRun { plan: format!("{plan:?}\n{:?}", args.sweep), sweep: sweep_file(&args.sweep) })
}

/// Writes arguments as a sweep file. Every value is a string, as on the command line.
fn sweep_file(args: &SweepArgs) -> String {
    let SweepArgs { policies, tasks, perturbations, episodes, db, until_decided, margin, alpha, config } =
        args;
    let text = |text: &dyn std::fmt::Display| toml::Value::String(text.to_string());
    let list = |texts: Vec<String>| toml::Value::Array(texts.into_iter().map(toml::Value::String).collect());
    let task = |selector: &TaskSelector| match selector {
        TaskSelector::All => "all".to_owned(),
        TaskSelector::Morphology(morphology) => morphology.name().to_owned(),
        TaskSelector::Task(task) => task.name().to_owned(),
    };
    let perturbation = |selector: &PerturbationSelector| match selector {
        PerturbationSelector::Applicable => "all".to_owned(),
        PerturbationSelector::Named(composition) => composition.name(),
    };
    let policies = policies.iter().map(|policy| format!("{}={}", policy.name, policy.spec)).collect();
    let mut table = toml::Table::from_iter([
        ("policies".to_owned(), list(policies)),
        ("tasks".to_owned(), list(tasks.iter().map(task).collect())),
        ("perturbations".to_owned(), list(perturbations.iter().map(perturbation).collect())),
        ("episodes".to_owned(), text(episodes)),
        ("db".to_owned(), text(&db.display())),
        ("until_decided".to_owned(), list(until_decided.clone())),
        ("margin".to_owned(), text(margin)),
        ("alpha".to_owned(), text(alpha)),
    ]);
    let object = |value| match value {
        Value::Object(object) => object,
        _ => unreachable!("a struct becomes an object"),
    };
    let mut groups = object(serde_json::json!(config));
    // It results from options of the same names.
    let resolved = object(serde_json::json!(config.results.protocol));
    groups["results"].as_object_mut().into_iter().for_each(|results| {
        results.retain(|key, _| !resolved.contains_key(key));
    });
    for (key, value) in groups.into_iter().filter_map(|(_, group)| group.as_object().cloned()).flatten() {
        let value = match value {
            Value::Null => continue,
            Value::Bool(is_set) => toml::Value::Boolean(is_set),
            Value::String(text) => toml::Value::String(text),
            // A file of paraphrases.
            Value::Object(file) => text(&file["path"].as_str().unwrap_or_default()),
            other => text(&other),
        };
        table.insert(key, value);
    }
    table.to_string()
}

/// Reads a results file in every way that commands do: merges, compares, reports, exports into the folder
/// `output`, loads recorded actions, and resumes. Returns the number of its episodes.
///
/// # Errors
/// The message that a user reads.
///
/// # Panics
/// If an error is not one that the user can fix.
pub fn read_results(path: &Path, output: &Path) -> Result<usize, String> {
    let message = |failure: Failure| match failure {
        Failure::User(_) => failure.to_string(),
        Failure::Bug(_) => panic!("reported as a bug: {failure}"),
    };
    let n_episodes = conclude(path, output).map_err(message)?;
    if let Ok(recorded) = RecordedEpisodes::open(path) {
        for idx in 0..recorded.episodes().len() {
            let actions = recorded.actions(idx);
            assert!(actions.is_err() || !recorded.episodes()[idx].name().is_empty());
        }
    }
    let merged = merge(&output.join("merged.db"), &[path.to_owned()], &mut Unwatched);
    let merged = merged.map_err(|error| message(Failure::User(error)))?;
    assert_eq!(merged.n_rows, n_episodes as u64, "merging loses no row");
    resume(path).map_err(message)?;
    Ok(n_episodes)
}

fn conclude(path: &Path, output: &Path) -> Result<usize, Failure> {
    let metric = Metric::default();
    let levels = DEFAULT_LEVELS;
    let files = vec![path.to_owned()];
    let args = EvaluationArgs { files, across: vec![], metric, margin: None, alpha: None };
    let evaluation = Evaluation::new(read_files(&args.files).or_user()?, &args.across).or_user()?;
    let options = ComparisonOptions { metric, levels, max_flips: usize::MAX };
    for first in &evaluation.policies {
        let mut comparisons =
            vec![Comparison::of_perturbations(&evaluation, &first.name, Perturbation::None.into(), options)];
        for second in &evaluation.policies {
            comparisons.push(Comparison::of_policies(&evaluation, [&first.name, &second.name], options));
        }
        for comparison in comparisons.iter().flatten() {
            let json = serde_json::to_string(comparison)?;
            assert!(!compare::text(comparison).is_empty() && !json.is_empty());
        }
    }
    draw_page(&evaluation, ExternalData::default())?;
    let formats = [
        ExportFormat::Csv,
        ExportFormat::Parquet,
        ExportFormat::Json,
        ExportFormat::Lerobot,
        ExportFormat::VlaEval,
    ];
    let mut folder = OutputFolder::open(output, Overwriting::default()).or_user()?;
    for format in formats {
        for path in export(&evaluation, (metric, DEFAULT_LEVELS.alpha), format, &mut folder).or_user()? {
            assert_eq!(path.parent(), Some(output), "exports stay in their folder");
        }
    }
    Ok(evaluation.files.iter().map(|file| file.rows.len()).sum())
}

fn draw_page(evaluation: &Evaluation, external: ExternalData) -> Result<(), Failure> {
    let levels = DEFAULT_LEVELS;
    let title = "results".to_owned();
    let options = PageOptions { title, metric: Metric::default(), levels, pairs: Vec::new() };
    let report = ReportContent::new(evaluation, &options, external).or_user()?;
    let html = page::html(&report, &[])?;
    let data = serde_json::to_vec(&report)?;
    assert!(html.contains("</html>") && !data.is_empty(), "the page is complete");
    Ok(())
}

/// Makes the decisions of a run that continues the file, and its report.
fn resume(path: &Path) -> Result<(), Failure> {
    let (plan, manifest) = sample_run();
    let results = Results::open(path, &manifest).or_user()?;
    assert!(results.finished(&plan)?.len() <= plan.n_episodes());
    let stopping = Stopping::new(plan.stopping.as_ref().expect("the plan has a rule"), &plan, &results);
    let conclusions = stopping.or_user()?.conclusions();
    crate::run::live::RunningSuccess::new(&plan, &results).or_user()?.parts(None);
    results.renderer().or_user()?;
    let table = report::table(&plan, &report::cells(&plan, &results).or_user()?, &conclusions);
    assert!(!table.is_empty());
    Ok(())
}

/// Writes the results file that the fuzz target mutates: three policies under several conditions, some
/// episodes with errors or recorded actions.
///
/// # Panics
/// If it cannot be written.
pub fn write_results(path: &Path) {
    let (plan, manifest) = sample_run();
    let mut results = Results::open(path, &manifest).expect("the file is new");
    results
        .set_metadata(crate::store::results::ENVIRONMENT, &serde_json::json!({ "machine": { "cores": 2 } }))
        .expect("it is writable");
    results.set_renderer("cpu").expect("it is writable");
    results.add_plan(&plan).expect("it is writable");
    let pair = plan.stopping.as_ref().map(|rule| &rule.policies);
    let costs = EpisodeCosts::new(&plan, None);
    let partition = Rc::new(Partition::new(&StoredPlan::new(&plan), pair, &costs, 2, 0.5));
    let part = ShardPart::new(partition, SweepShard { index: 0, count: 2 });
    let shard = serde_json::json!(part.stored(vec!["n1 (CPU)".to_owned()], vec!["run".to_owned()]));
    results.set_metadata(SHARD, &shard).expect("it is writable");
    for (policy_idx, policy) in plan.policies.iter().enumerate() {
        for (cell_idx, &condition) in plan.conditions.iter().enumerate() {
            for episode in 0..plan.episodes {
                let seed = episode_seed(0, condition.task.name(), episode);
                let success = (episode as usize * 7 + cell_idx * 3) % 5 < policy_idx * 2;
                let outcome = outcome(success, episode + cell_idx as u32);
                let key = EpisodeKey { policy: &policy.name, condition, episode };
                results.record(key, seed, &outcome).expect("it is writable");
            }
        }
    }
}

/// Writes the checksums of a results file anew, after a test has changed rows.
///
/// # Panics
/// If the file cannot be read or written.
pub fn seal_results(path: &Path) {
    crate::store::results::sealing::seal(path).expect("the file has the tables of a run");
}

/// Returns the run to which the sample of [`write_results`] belongs.
fn sample_run() -> (RunPlan, Manifest) {
    let words = "hypogeum run --policy floor=idle --policy random --policy expert --until-decided floor,expert \
        --tasks RaiseCube,StackCube --perturbations None,MO-Color,Camera-Pose+MO-Color --episodes 8";
    let words: Vec<OsString> = words.split_whitespace().map(OsString::from).collect();
    let cli = Cli::parse_with_sweep_file(&words).expect("the arguments are valid");
    let Command::Run(args) = cli.command else { unreachable!("the command is `run`") };
    let plan = RunPlan::new(&args.sweep).expect("the arguments are valid");
    let identity = |spec: String| Identity {
        spec,
        checkpoint: None,
        device: None,
        execution: Some(Execution::chunk(30)),
        notes: Vec::new(),
    };
    let identities = plan.policies.iter().map(|policy| identity(policy.spec.to_string())).collect();
    let manifest = Manifest::new(&plan, identities);
    (plan, manifest)
}

fn outcome(success: bool, number: u32) -> Outcome {
    let steps = 20 + number;
    Outcome {
        id: 0,
        steps,
        success_once: success,
        success_at_end: success && number.is_multiple_of(2),
        first_success_step: success.then_some(steps / 2),
        failed_predicate: (!success).then(|| "above".to_owned()),
        fingerprint: u64::from(number) << 40,
        actions: number.is_multiple_of(4).then(|| vec![0x3f80_0000; steps as usize * 7]),
        ledger: EpisodeLedger { physics_s: 0.1, render_s: 0.2, policy_s: 0.3, wait_s: 0.4 },
        error: (number == 6).then(|| "the physics state is not finite".to_owned()),
    }
}

/// Reads a table of success rates on hardware and one of frames per second, and draws them beside the results
/// of a valid file.
///
/// # Errors
/// The message that a user reads.
///
/// # Panics
/// If the page cannot be drawn.
pub fn read_tables(results: &Path, hardware: &Path, fps: &Path) -> Result<(), String> {
    let hardware = HardwareTable::read(hardware).or_user().map_err(|failure| failure.to_string())?;
    let fps = vec![FpsTable::read("fps", fps).or_user().map_err(|failure| failure.to_string())?];
    assert!(hardware.rows.iter().all(|row| (0.0..=100.0).contains(&row.success_percent)));
    let files = read_files(&[results.to_owned()]).expect("the results are valid");
    let evaluation = Evaluation::new(files, &[]).expect("the results are valid");
    let external = ExternalData { hardware: Some(hardware), fps };
    draw_page(&evaluation, external).unwrap_or_else(|failure| panic!("{failure}"));
    Ok(())
}
