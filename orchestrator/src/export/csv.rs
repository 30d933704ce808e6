//! The original's result files: one row per cell, in its columns and spelling, one file per policy and
//! morphology, because its readers expect the morphology in the file's name.

use std::path::{Path, PathBuf};

use ipc_types::Morphology;
use serde_json::Value;
use sim::Perturbation;
use sim::perturb::Composition;

use super::{file_name, write_file};
use crate::analysis::{CellSummary, EvaluatedPolicy, Evaluation, Metric};

/// The columns, as `examples/baselines/act_clip` of the original writes them.
const HEADER: &str = "checkpoint_path,pc_hostname,now,t_final,duration_sec,perturbation_set,env_id,control_mode,include_depth,\
    num_eval_episodes,max_episode_steps,message,num_sucessful_episodes,success_percent";

/// Writes the files and returns them.
pub(super) fn write(
    evaluation: &Evaluation,
    (metric, alpha): (Metric, f64),
    folder: &Path,
) -> anyhow::Result<Vec<PathBuf>> {
    let mut paths = Vec::new();
    for policy in &evaluation.policies {
        let cells = CellSummary::of_policy(evaluation, policy, metric, alpha);
        for morphology in Morphology::ALL {
            let own = cells.iter().filter(|cell| cell.condition.task.task().morphology == morphology);
            let rows: Vec<String> = own.map(|cell| row(evaluation, policy, cell)).collect();
            if !rows.is_empty() {
                let name = match morphology {
                    Morphology::Single => "single_arm",
                    Morphology::Bimanual => "bimanual",
                };
                let path = folder.join(format!("{}.{name}.csv", file_name(policy)));
                paths.push(write_file(&path, format!("{HEADER}\n{}\n", rows.join("\n")).as_bytes())?);
            }
        }
    }
    Ok(paths)
}

fn row(evaluation: &Evaluation, policy: &EvaluatedPolicy, cell: &CellSummary) -> String {
    let task = cell.condition.task.task();
    let control_mode = match (policy.identity.spec.as_str(), task.morphology) {
        ("expert", _) | (_, Morphology::Bimanual) => "pd_joint_pos",
        _ => evaluation.entry("control_mode").and_then(Value::as_str).unwrap_or("pd_ee_delta_pose"),
    };
    let percent = cell.rate.fraction().map_or(-1.0, |fraction| 100.0 * fraction);
    let duration: f64 = cell.times_s.iter().sum();
    // Times of day are not recorded.
    let perturbation = original_name(cell.condition.perturbation);
    let message = if cell.errors > 0 { format!("{} errors", cell.errors) } else { String::new() };
    let fields = [
        policy.identity.spec.clone(),
        String::new(),
        String::new(),
        String::new(),
        format!("{duration:.3}"),
        perturbation,
        task.env_id.to_owned(),
        control_mode.to_owned(),
        "False".to_owned(),
        cell.rate.n.to_string(),
        task.max_steps.to_string(),
        message,
        cell.rate.successes.to_string(),
        format!("{percent:.2}"),
    ];
    // A path may contain a comma; no other field can.
    fields
        .map(|field| if field.contains(',') { format!("\"{}\"", field.replace('"', "\"\"")) } else { field })
        .join(",")
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
