//! The table of a comparison that ended cells early.

use serde_json::{Value, json};

use crate::console::table::{Align, TextTable, interval, p_value, points};
use crate::run::stopping::{SequentialCell, StoppingRule};
use crate::statistics::Decision;

/// Formats the conclusions for people.
pub(crate) fn table(rule: &StoppingRule, cells: &[SequentialCell]) -> String {
    use Align::{Left, Right};
    let [a, b] = [&rule.policies[0], &rule.policies[1]].map(String::as_str);
    let confidence = format!("{:.0} % conf. sequence", 100.0 * (1.0 - rule.levels.alpha));
    let mut table = TextTable::new(&[
        ("task", Left),
        ("perturbation", Left),
        ("n", Right),
        (&format!("only {a}"), Right),
        (&format!("only {b}"), Right),
        ("difference", Right),
        (&confidence, Right),
        ("adjusted p", Right),
        ("verdict", Left),
    ]);
    for cell in cells {
        let pairs = cell.sequence.pairs();
        table.row(vec![
            cell.condition.task.name().to_owned(),
            cell.condition.perturbation.name(),
            pairs.n().to_string(),
            pairs.only_a.to_string(),
            pairs.only_b.to_string(),
            pairs.difference().map_or_else(|| "–".to_owned(), points),
            interval(cell.sequence.interval()),
            p_value(cell.adjusted_p),
            cell.verdict.text([a, b], rule.levels.margin),
        ]);
    }
    let n_undecided = cells.iter().filter(|cell| cell.verdict.decision == Decision::Undecided).count();
    format!(
        "\n{a} against {b}, each cell until decided (level {}, margin {:.1} pp, {} of {} cells decided):\n{table}\
         valid whenever the run stopped: e-values of discordant pairs, adjusted by Holm's method, and betting confidence \
         sequences\n",
        rule.levels.alpha,
        100.0 * rule.levels.margin,
        cells.len() - n_undecided,
        cells.len(),
    )
}

/// Makes the JSON form of the conclusions.
pub(crate) fn json(rule: &StoppingRule, cells: &[SequentialCell]) -> Value {
    let cell = |cell: &SequentialCell| {
        json!({
            "task": cell.condition.task.name(),
            "perturbation": cell.condition.perturbation.name(),
            "pairs": cell.sequence.pairs(),
            "difference": cell.sequence.pairs().difference(),
            "confidence_sequence": cell.sequence.interval(),
            "rates": cell.rates,
            "adjusted_p": cell.adjusted_p,
            "verdict": cell.verdict,
        })
    };
    json!({ "rule": rule, "cells": cells.iter().map(cell).collect::<Vec<_>>() })
}
