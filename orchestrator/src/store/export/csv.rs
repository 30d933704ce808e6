//! The original's result files: one row per cell, in its columns and spelling, one file per policy and
//! morphology, because its readers expect the morphology in the file's name.

use std::path::PathBuf;

use ipc_types::Morphology;
use serde_json::Value;
use sim::Perturbation;
use sim::perturb::Composition;

use crate::console::output_files::OutputFolder;
use crate::selection::condition::Condition;
use crate::store::results::ENVIRONMENT;
use crate::study::analysis::{CellSummary, EvaluatedPolicy, Evaluation, Metric, RowIdx};

/// The columns, as `examples/baselines/act_clip` of the original writes them.
const HEADER: [&str; 14] = [
    "checkpoint_path",
    "pc_hostname",
    "now",
    "t_final",
    "duration_sec",
    "perturbation_set",
    "env_id",
    "control_mode",
    "include_depth",
    "num_eval_episodes",
    "max_episode_steps",
    "message",
    "num_sucessful_episodes",
    "success_percent",
];

/// Writes the files and returns them.
pub(crate) fn write(
    evaluation: &Evaluation,
    (metric, alpha): (Metric, f64),
    folder: &mut OutputFolder,
) -> anyhow::Result<Vec<PathBuf>> {
    let mut paths = Vec::new();
    for policy in &evaluation.policies {
        let conditions = evaluation.conditions(policy);
        let cells = CellSummary::of_policy(evaluation, policy, metric, alpha);
        for morphology in Morphology::ALL {
            let own = cells.iter().filter(|cell| cell.condition.task.task().morphology == morphology);
            let mut rows = own.map(|cell| row(evaluation, (policy, &conditions), cell)).peekable();
            if rows.peek().is_some() {
                let name = match morphology {
                    Morphology::Single => "single_arm",
                    Morphology::Bimanual => "bimanual",
                };
                let file = format!("{}.{name}.csv", policy.file_name());
                let mut writer = csv::Writer::from_writer(Vec::new());
                writer.write_record(HEADER)?;
                rows.try_for_each(|row| writer.write_record(row.map(plain_text)))?;
                paths.push(folder.write(&file, &writer.into_inner()?)?);
            }
        }
    }
    Ok(paths)
}

fn row(
    evaluation: &Evaluation,
    (policy, conditions): (&EvaluatedPolicy, &[(Condition, &[RowIdx])]),
    cell: &CellSummary,
) -> [String; 14] {
    let task = cell.condition.task.task();
    let control_mode = match (policy.identity.spec.as_str(), task.morphology) {
        ("expert", _) | (_, Morphology::Bimanual) => "pd_joint_pos",
        _ => evaluation.entry("control_mode").and_then(Value::as_str).unwrap_or("pd_ee_delta_pose"),
    };
    let percent = cell.rate.fraction().map_or(-1.0, |fraction| 100.0 * fraction);
    let rows = conditions.iter().find(|(condition, _)| *condition == cell.condition);
    let wall_s = rows.and_then(|(_, rows)| evaluation.wall_s(rows.iter().copied()));
    let date = evaluation.entry(ENVIRONMENT).and_then(|circumstances| circumstances["date"].as_str());
    let perturbation = original_name(cell.condition.perturbation);
    let message = match cell.errors {
        // The word by which the evaluation through LeRobot finds the cells that are complete.
        0 if evaluation.entry("protocol").and_then(Value::as_str) == Some("lerobot") => {
            "results_df".to_owned()
        }
        0 => String::new(),
        errors => format!("{errors} errors"),
    };
    [
        policy.identity.spec.clone(),
        String::new(),
        date.unwrap_or_default().to_owned(),
        String::new(),
        wall_s.map_or_else(String::new, |wall_s| format!("{wall_s:.3}")),
        perturbation,
        task.env_id.to_owned(),
        control_mode.to_owned(),
        "False".to_owned(),
        cell.rate.n.to_string(),
        task.max_steps.to_string(),
        message,
        cell.rate.successes.to_string(),
        format!("{percent:.2}"),
    ]
}

/// Returns a field that no spreadsheet takes for a formula.
fn plain_text(field: String) -> String {
    let is_number = field.parse::<f64>().is_ok();
    if !is_number && field.starts_with(['=', '+', '-', '@', '\t', '\r']) {
        format!("'{field}")
    } else {
        field
    }
}

/// Returns the name of a perturbation in the original's result files, whose readers drop columns that they do
/// not know. Compositions and the language perturbations that the original does not have keep ours.
fn original_name(composition: Composition) -> String {
    match composition {
        one if one == Perturbation::DistractorObjects.into() => "distractor_object".to_owned(),
        one if one == Perturbation::LanguageParaphrase.into() => "language".to_owned(),
        other => other.name().to_lowercase().replace('-', "_"),
    }
}
