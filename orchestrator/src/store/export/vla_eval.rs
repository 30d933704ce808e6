//! The result file of vla-eval 0.8: a benchmark with tasks and episodes. A task is a task of ours under a
//! perturbation; an episode that could not be run has a `failure_reason` and counts as a failure there.

use serde_json::{Value, json};

use crate::store::build_identity;
use crate::store::results::EpisodeRow;
use crate::study::analysis::{EvaluatedPolicy, Evaluation, Metric, RowIdx};

pub(crate) fn benchmark_result(evaluation: &Evaluation, policy: &EvaluatedPolicy, metric: Metric) -> Value {
    let mut tasks = Vec::new();
    let (mut n_successes, mut n_episodes, mut n_errors) = (0, 0, 0);
    for (condition, rows) in evaluation.conditions(policy) {
        let episodes: Vec<Value> = rows.iter().map(|idx| episode(evaluation, *idx, metric)).collect();
        let all = || rows.iter().map(|idx| evaluation.row(*idx));
        let succeeds = |row: &&EpisodeRow| row.error.is_none() && metric.of(row);
        let (successes, errors) =
            (all().filter(succeeds).count(), all().filter(|row| row.error.is_some()).count());
        let steps: f64 = all().map(|row| f64::from(row.steps)).sum();
        let n = rows.len();
        tasks.push(json!({
            "task": format!("{}/{}", condition.task.task().env_id, condition.perturbation.name()),
            "episodes": episodes,
            "num_episodes": n,
            "num_errors": errors,
            "avg_steps": steps / n as f64,
            "mean_success": rounded(successes, n),
        }));
        n_successes += successes;
        n_episodes += n;
        n_errors += errors;
    }
    let options = &evaluation.files[0].manifest;
    json!({
        "benchmark": "COLOSSEUM V2",
        "mode": "sync",
        "harness_version": format!("hypogeum {}", build_identity::VERSION),
        "created_at": "",
        "tasks": tasks,
        "config": { "policy": policy.identity, "params": options },
        "num_errors": n_errors,
        "seed": options.get("seed"),
        "metric_keys": { "success": "mean" },
        "mean_success": rounded(n_successes, n_episodes),
    })
}

fn episode(evaluation: &Evaluation, idx: RowIdx, metric: Metric) -> Value {
    let row = evaluation.row(idx);
    let file = &evaluation.files[idx.file_idx as usize];
    let mut episode = json!({
        "episode_id": row.episode,
        "metrics": { "success": row.error.is_none() && metric.of(row) },
        "steps": row.steps,
        "elapsed_sec": row.seconds(),
    });
    if let Some(error) = row.error {
        episode["failure_reason"] = json!("error");
        episode["failure_detail"] = json!(file.text(error));
    }
    episode
}

/// Rounds a share to four digits, as vla-eval does.
fn rounded(part: usize, whole: usize) -> f64 {
    (1e4 * part as f64 / whole.max(1) as f64).round() / 1e4
}
