//! `eval_info.json` as LeRobot 0.6 writes it: per task, per group and overall. A group is a perturbation,
//! and the reward of an episode is 1 if it succeeds.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use crate::study::analysis::{EvaluatedPolicy, Evaluation, Metric, RowIdx};

pub(crate) fn eval_info(evaluation: &Evaluation, policy: &EvaluatedPolicy, metric: Metric) -> Value {
    let successes_of = |rows: &[RowIdx]| -> Vec<bool> {
        let rows = rows.iter().map(|idx| evaluation.row(*idx)).filter(|row| row.error.is_none());
        rows.map(|row| metric.of(row)).collect()
    };
    let (mut per_task, mut groups): (Vec<Value>, BTreeMap<String, Vec<bool>>) = (Vec::new(), BTreeMap::new());
    for (condition, rows) in evaluation.conditions(policy) {
        let successes = successes_of(rows);
        let group = condition.perturbation.name();
        let rewards: Vec<f64> = successes.iter().map(|success| f64::from(u8::from(*success))).collect();
        per_task.push(json!({
            "task_group": group,
            "task_id": condition.task as usize,
            "task": condition.task.task().env_id,
            "metrics": {
                "sum_rewards": rewards,
                "max_rewards": rewards,
                "successes": successes,
                "video_paths": [],
                "predicted_video_paths": [],
            },
        }));
        groups.entry(group).or_default().extend(successes);
    }
    let all: Vec<bool> = groups.values().flatten().copied().collect();
    let per_group: Map<String, Value> =
        groups.iter().map(|(name, of)| (name.clone(), aggregate(of))).collect();
    let conditions = evaluation.conditions(policy);
    let rows = conditions.iter().flat_map(|(_, rows)| rows.iter().copied());
    let mut overall = aggregate(&all);
    if let Some(wall_s) = evaluation.wall_s(rows) {
        overall["eval_s"] = json!(wall_s);
        overall["eval_ep_s"] = json!(wall_s / all.len().max(1) as f64);
    }
    json!({ "per_task": per_task, "per_group": per_group, "overall": overall })
}

fn aggregate(successes: &[bool]) -> Value {
    let n = successes.len();
    let rate = successes.iter().filter(|success| **success).count() as f64 / n.max(1) as f64;
    json!({
        "avg_sum_reward": rate,
        "avg_max_reward": rate,
        "pc_success": 100.0 * rate,
        "n_episodes": n,
        "video_paths": [],
        "predicted_video_paths": [],
    })
}
