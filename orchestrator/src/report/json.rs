//! The object that `--json` prints.

use serde_json::{Value, json};

use super::{Cell, Fps};

/// `run` (the manifest), `cells`, `fps` and `ledger`, as DESIGN §9 names them.
pub(crate) fn json(run: &Value, cells: &[Cell], fps: &Fps) -> Value {
    let cells: Vec<Value> = cells.iter().map(cell).collect();
    json!({ "run": run, "cells": cells, "fps": fps, "ledger": fps.ledger })
}

fn cell(cell: &Cell) -> Value {
    json!({
        "policy": cell.policy,
        "task": cell.condition.task.name(),
        "perturbation": cell.condition.perturbation.name(),
        "n": cell.sums.n,
        "success_once": cell.success_once(),
        "success_at_end": cell.success_at_end(),
        "wilson95": cell.wilson95(),
        "errors": cell.sums.errors,
        "mean_steps": cell.mean_steps(),
    })
}
