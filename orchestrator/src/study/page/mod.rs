//! The page of `hypogeum report`: one self-contained HTML file with figures and tables, and the same as data.
//!
//! It turns an evaluation into numbers (`computation`), draws them (`figures`) and fills the template. It
//! needs no network, and JavaScript only for sorting, filtering and highlighting.

mod content;
mod drawings;

use anyhow::Context;
use minijinja::Environment;
use serde::Serialize;

use self::content::HardwareFit;
pub(crate) use self::content::ReportContent;
pub(crate) use self::content::computation::PageOptions;
pub(crate) use self::content::external::{ExternalData, FpsTable, HardwareTable};
use self::drawings::canvas::Figure;
pub(crate) use self::drawings::figures::{Curve, fps_svgs};
use crate::statistics::Levels;
use crate::study::analysis::EmbodimentDifference;

const TEMPLATE: &str = include_str!("template.html");
const CSS: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("script.js");

/// A picture file beside the page.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Movie {
    /// File name, relative to the page.
    pub(crate) file: String,
    pub(crate) caption: String,
}

/// The variables of the template.
#[derive(Serialize)]
struct PageContext<'a> {
    style: &'a str,
    script: &'a str,
    title: &'a str,
    metric: &'static str,
    levels: Levels,
    warnings: &'a [String],
    /// The first screen.
    circumstances: String,
    command: Option<&'a str>,
    sentences: Vec<String>,
    bounds: Option<String>,
    averages: Vec<content::headlines::AverageRow>,
    modality_names: [&'static str; 3],
    embodiments: Vec<&'a EmbodimentDifference>,
    published: &'a [content::PublishedRow],
    hardware: &'a [HardwareFit],
    policies: &'a [content::PolicySummary],
    /// Confidence of intervals in percent, and margin of equality in points.
    confidence: String,
    margin: String,
    files: &'a [content::FileSummary],
    heat_maps: Vec<drawings::heat_map::HeatMap>,
    figures: Vec<Figure>,
    movies: &'a [Movie],
    comparisons: Vec<content::tables::ComparisonTable>,
    /// Options and circumstances of the run.
    run: Vec<(&'a str, String)>,
}

/// Fills the template.
///
/// # Errors
/// If the template is invalid.
pub(crate) fn html(report: &ReportContent, movies: &[Movie]) -> anyhow::Result<String> {
    let mut environment = Environment::new();
    environment.add_template("page.html", TEMPLATE).context("the template is invalid")?;
    let template = environment.get_template("page.html")?;
    let context = PageContext {
        style: CSS,
        script: SCRIPT,
        title: &report.title,
        metric: report.metric.name(),
        levels: report.levels,
        confidence: percent(1.0 - report.levels.alpha),
        margin: percent(report.levels.margin),
        warnings: &report.warnings,
        circumstances: content::headlines::circumstances(report),
        command: report.environment.get("command").and_then(serde_json::Value::as_str),
        sentences: content::headlines::sentences(report),
        bounds: content::headlines::bounds(report),
        averages: content::headlines::averages(report),
        modality_names: content::headlines::modality_names(),
        embodiments: report
            .embodiment_differences
            .iter()
            .filter(|one| report.under_test().any(|policy| policy.name == one.policy))
            .collect(),
        published: &report.published,
        hardware: &report.hardware,
        policies: &report.policies,
        files: &report.files,
        heat_maps: drawings::heat_map::heat_maps(report),
        figures: drawings::figures(report),
        movies,
        comparisons: content::tables::comparison_tables(report),
        run: run(report),
    };
    let context = minijinja::Value::from(minijinja::value::Serde(&context));
    template.render(context).context("failed to fill the template")
}

/// Returns percent with at most one decimal.
fn percent(fraction: f64) -> String {
    format!("{}", (1000.0 * fraction).round() / 10.0)
}

/// Returns the options and the circumstances of the run as texts.
fn run(report: &ReportContent) -> Vec<(&str, String)> {
    let text = |value: &serde_json::Value| match value {
        serde_json::Value::String(text) => text.clone(),
        serde_json::Value::Null => "–".to_owned(),
        other => other.to_string(),
    };
    let circumstances = report.environment.as_object();
    let all = report.options.iter().chain(circumstances.into_iter().flatten());
    all.map(|(key, value)| (key.as_str(), text(value))).collect()
}
