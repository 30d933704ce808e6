//! `hypogeum report`: a page with figures, comparisons and warnings, and the results as data.

use std::path::PathBuf;

use anyhow::ensure;
use clap::Args;

use crate::cli::evaluation_args::EvaluationArgs;
use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::print_message;
use crate::console::output_files::{OutputFolder, Overwriting};
use crate::console::threads::start_threads;
use crate::run::playback::write_flip_movie;
use crate::store::export::{ExportFormat, export};
use crate::study::analysis::Flip;
use crate::study::page::{self, ExternalData, FpsTable, HardwareTable, Movie, PageOptions, ReportContent};

/// Arguments of `report`.
#[derive(Args, Debug)]
pub(crate) struct ReportArgs {
    #[command(flatten)]
    pub(crate) evaluation: EvaluationArgs,
    /// Folder to write: index.html, data.json, and files of --format
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Pair of policies to compare, the first as A (repeatable) [default: all pairs of up to four policies]
    #[arg(long = "compare", value_name = "A,B", value_parser = parse_pair)]
    pub(crate) pairs: Vec<[String; 2]>,
    /// Title of the page
    #[arg(long, default_value = "COLOSSEUM V2 evaluation")]
    pub(crate) title: String,
    /// Success rates on hardware: a CSV file with the columns task, perturbation and success_percent
    #[arg(long, value_name = "FILE.csv")]
    pub(crate) hardware: Option<PathBuf>,
    /// Frames per second: a CSV file with the columns batch_size and frames_per_second, and a name for the
    /// curve (repeatable) [default name: that of the file]
    #[arg(long, value_name = "[NAME=]FILE.csv", value_parser = parse_curve)]
    pub(crate) fps: Vec<(String, PathBuf)>,
    /// Number of flips to show as movies, both sides next to each other
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) movies: usize,
    /// Further formats of the results, comma-separated
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',')]
    pub(crate) format: Vec<ExportFormat>,
    #[command(flatten)]
    pub(crate) overwriting: Overwriting,
}

/// Writes the page and the data.
pub(crate) fn report(args: &ReportArgs) -> Result<ExitStatus, Failure> {
    start_threads()?;
    let evaluation = args.evaluation.read()?;
    let external = ExternalData {
        hardware: args.hardware.as_deref().map(HardwareTable::read).transpose().or_user()?,
        fps: args
            .fps
            .iter()
            .map(|(name, path)| FpsTable::read(name, path))
            .collect::<Result<_, _>>()
            .or_user()?,
    };
    let options = PageOptions {
        title: args.title.clone(),
        metric: args.evaluation.metric,
        levels: args.evaluation.levels(&evaluation)?,
        pairs: args.pairs.clone(),
    };
    let report = ReportContent::new(&evaluation, &options, external).or_user()?;
    // Nothing is written before everything has been computed.
    let mut output = OutputFolder::open(&args.output, args.overwriting).or_user()?;
    // Whether the page may be written is known before the movies are drawn.
    output.path("index.html").or_user()?;
    let movies = movies(&report, args.movies, &mut output).or_user()?;
    let html = page::html(&report, &movies)?;
    let data = serde_json::to_vec(&report)?;
    output.write("data.json", &data).or_user()?;
    for format in &args.format {
        export(&evaluation, (report.metric, report.levels.alpha), *format, &mut output).or_user()?;
    }
    // The page is written last: where it is, everything else is.
    let page = output.write("index.html", html.as_bytes()).or_user()?;
    for warning in &report.warnings {
        print_message(&format!("warning: {warning}"));
    }
    print_message(&format!("wrote {}", page.display()));
    Ok(ExitStatus::Success)
}

/// Writes movies of the first flips of each comparison whose both sides can be replayed.
fn movies(report: &ReportContent, n: usize, output: &mut OutputFolder) -> anyhow::Result<Vec<Movie>> {
    if n == 0 {
        return Ok(Vec::new());
    }
    let can_replay = |flip: &&Flip| flip.sides.iter().all(|side| side.has_actions);
    let flips: Vec<&Flip> =
        report.comparisons.iter().flat_map(|comparison| comparison.flips.iter().filter(can_replay)).collect();
    ensure!(
        !flips.is_empty(),
        "--movies needs flips with stored actions on both sides, but no flip has them: the files were made with \
         --keep-actions=false, or by an early version"
    );
    // Spread over all flips, so that not all are of one cell.
    let n = n.min(flips.len());
    let chosen = (0..n).map(|idx| flips[idx * flips.len() / n]);
    chosen.enumerate().map(|(idx, flip)| movie(flip, idx, output)).collect()
}

fn movie(flip: &Flip, idx: usize, output: &mut OutputFolder) -> anyhow::Result<Movie> {
    let file = format!("flip-{idx}.gif");
    write_flip_movie(flip, &output.path(&file)?)?;
    let [a, b] = [&flip.sides[0], &flip.sides[1]];
    let result = |side: usize| if flip.a_succeeds == (side == 0) { "succeeds" } else { "fails" };
    let of = |side: &crate::study::analysis::FlipSide| {
        format!("{} under {}", side.policy, side.condition.perturbation.name())
    };
    let caption = format!(
        "{}, episode {}: {} {} (left), {} {} (right)",
        a.condition.task.name(),
        flip.episode,
        of(a),
        result(0),
        of(b),
        result(1)
    );
    Ok(Movie { file, caption })
}

fn parse_curve(typed: &str) -> Result<(String, PathBuf), String> {
    match typed.split_once('=') {
        Some((name, path)) if !name.is_empty() && !path.is_empty() => Ok((name.to_owned(), path.into())),
        Some(_) => Err("expected FILE.csv or NAME=FILE.csv".to_owned()),
        None => {
            let path = PathBuf::from(typed);
            let name = path.file_stem().ok_or("expected the name of a file")?.to_string_lossy().into_owned();
            Ok((name, path))
        }
    }
}

fn parse_pair(typed: &str) -> Result<[String; 2], String> {
    match typed.split_once(',') {
        Some((a, b)) if !a.is_empty() && !b.is_empty() && a != b => Ok([a.to_owned(), b.to_owned()]),
        _ => Err("expected two different policies, separated by a comma".to_owned()),
    }
}
