//! The JSON object that `--json` prints.

use serde_json::{Value, json};

use crate::store::results::Column;
use crate::study::analysis::Effect;
use crate::study::report::Fps;
use crate::study::report::cell::{Cell, effects};

/// Makes the object with the keys `run` (the manifest), `cells`, `changes`, `fps` and `ledger`. Cells of the
/// policies in `stopped` ended early: they have no changes, and their intervals are elsewhere.
pub(crate) fn json(run: &Value, cells: &[Cell], stopped: &[String], fps: &Fps) -> Value {
    let changes: Vec<Value> = effects(cells, stopped).iter().map(change).collect();
    let cell = |one: &Cell| {
        let mut object = cell(one);
        if stopped.contains(&one.policy) {
            object["wilson95"] = Value::Null;
        }
        object
    };
    let cells: Vec<Value> = cells.iter().map(cell).collect();
    json!({ "run": run, "cells": cells, "changes": changes, "fps": fps, "ledger": fps.ledger })
}

fn change(effect: &Effect) -> Value {
    json!({
        "policy": effect.policy,
        "morphology": effect.morphology,
        "perturbation": effect.perturbation.name(),
        (Column::SuccessOnce.name()): effect.success,
        "n_tasks": effect.n_tasks,
        "change": effect.change,
        "relative_change": effect.relative_change,
    })
}

fn cell(cell: &Cell) -> Value {
    json!({
        "policy": cell.policy,
        "task": cell.condition.task.name(),
        "perturbation": cell.condition.perturbation.name(),
        "n": cell.sums.n,
        (Column::SuccessOnce.name()): cell.success_once(),
        (Column::SuccessAtEnd.name()): cell.success_at_end(),
        "wilson95": cell.wilson95(),
        "errors": cell.sums.errors,
        "mean_steps": cell.mean_steps(),
    })
}
