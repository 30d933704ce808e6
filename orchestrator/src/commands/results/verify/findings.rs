//! Findings of a verification: differing columns, episodes that could not be run again, and missing ones.

use std::collections::BTreeMap;

use serde_json::{Value as Json, json};
use sim::scene::stream::episode_seed;
use sim::serve::protocol::Outcome;

use crate::console::table::{Align, TextTable};
use crate::store::results::{Column, EpisodeKey, EpisodeRow, Gap, ResultsFile, Value};

/// A column that differs between a row and its repetition.
pub(crate) struct Difference<'a> {
    row: &'a EpisodeRow,
    column: &'static str,
    stored: String,
    found: String,
}

/// Episodes that cannot be run again, with the reason, by policy.
pub(crate) type Unverifiable = BTreeMap<String, (String, usize)>;

/// Compares a row with its repetition. Times are left out: they are never the same.
pub(crate) fn differences<'a>(
    file: &ResultsFile,
    row: &'a EpisodeRow,
    outcome: &Outcome,
    suite_seed: u64,
) -> Vec<Difference<'a>> {
    let seed = episode_seed(suite_seed, row.condition.task.name(), row.episode);
    let key = EpisodeKey { policy: file.policy(row), condition: row.condition, episode: row.episode };
    let differ = |column: Column| {
        let (stored, found) = (file.value(row, column), column.of_outcome(&key, seed, outcome));
        (stored != found).then(|| Difference {
            row,
            column: column.name(),
            stored: shown(&stored),
            found: shown(&found),
        })
    };
    Column::reproducible().filter_map(differ).collect()
}

fn shown(value: &Value) -> String {
    match value {
        Value::Null => "none".to_owned(),
        Value::Integer(number) => number.to_string(),
        Value::Real(number) => number.to_string(),
        Value::Text(text) => text.clone(),
        Value::Blob(_) => "bytes".to_owned(),
    }
}

/// Counts the rows with a difference. Differences of one row follow each other.
pub(crate) fn count_rows(differences: &[Difference<'_>]) -> usize {
    differences.chunk_by(|a, b| std::ptr::eq(a.row, b.row)).count()
}

pub(crate) fn text_report(
    file: &ResultsFile,
    differences: &[Difference<'_>],
    unverifiable: &Unverifiable,
) -> String {
    use Align::{Left, Right};
    let mut text = String::new();
    if !differences.is_empty() {
        let columns = ["policy", "task", "perturbation"].map(|name| (name, Left));
        let more = [("episode", Right), ("column", Left), ("stored", Left), ("run again", Left)];
        let mut table = TextTable::new(&[&columns[..], &more[..]].concat());
        for Difference { row, column, stored, found } in differences {
            table.row(vec![
                file.policy(row).to_owned(),
                row.condition.task.name().to_owned(),
                row.condition.perturbation.name(),
                row.episode.to_string(),
                (*column).to_owned(),
                stored.clone(),
                found.clone(),
            ]);
        }
        text += &table.to_string();
    }
    for (name, (reason, n)) in unverifiable {
        text += &format!("not verified: {n} episodes of {name}: {reason}\n");
    }
    text
}

pub(crate) fn json_report(
    file: &ResultsFile,
    n_run: usize,
    differences: &[Difference<'_>],
    unverifiable: &Unverifiable,
    gaps: Option<&[Gap]>,
) -> Json {
    let difference = |Difference { row, column, stored, found }: &Difference<'_>| {
        json!({
            "policy": file.policy(row),
            "task": row.condition.task.name(),
            "perturbation": row.condition.perturbation.name(),
            "episode": row.episode,
            "column": column,
            "stored": stored,
            "found": found,
        })
    };
    let not_verified =
        |(name, (reason, n)): (&String, &(String, usize))| json!({ "what": name, "n": n, "reason": reason });
    json!({
        "run": n_run,
        "agree": n_run - count_rows(differences),
        "differences": differences.iter().map(difference).collect::<Vec<_>>(),
        "not_verified": unverifiable.iter().map(not_verified).collect::<Vec<_>>(),
        "missing": gaps,
    })
}
