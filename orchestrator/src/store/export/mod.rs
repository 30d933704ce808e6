//! Results as data for other programs: the original's CSV, Parquet, JSON, and the result files of LeRobot and
//! vla-eval.

mod cells;
mod csv;
mod episodes;
mod lerobot;
mod vla_eval;

use std::path::PathBuf;

use clap::ValueEnum;
use serde_json::Value;

use crate::console::output_files::OutputFolder;
use crate::store::parquet_table::ParquetTable;
use crate::study::analysis::{CellSummary, EvaluatedPolicy, Evaluation, Metric};

/// A format of exported results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "kebab-case")]
pub(crate) enum ExportFormat {
    /// One row per cell, in the columns of the original's result files
    Csv,
    /// One table with a row per episode, and one with a row per cell
    Parquet,
    /// One object with all cells
    Json,
    /// One `eval_info.json` per policy, as LeRobot writes it
    Lerobot,
    /// One result file per policy, as vla-eval writes it
    VlaEval,
}

/// Writes the results in one format into `folder` and returns the files.
///
/// # Errors
/// If a file cannot be written.
pub(crate) fn export(
    evaluation: &Evaluation,
    (metric, alpha): (Metric, f64),
    format: ExportFormat,
    folder: &mut OutputFolder,
) -> anyhow::Result<Vec<PathBuf>> {
    let mut per_policy = |name: fn(&str) -> String, make: &dyn Fn(&EvaluatedPolicy) -> Value| {
        let write = |policy: &EvaluatedPolicy| write_json(folder, &name(&policy.file_name()), &make(policy));
        evaluation.policies.iter().map(write).collect::<anyhow::Result<Vec<PathBuf>>>()
    };
    let all_cells = || -> Vec<CellSummary> {
        let of_policy = |policy| CellSummary::of_policy(evaluation, policy, metric, alpha);
        evaluation.policies.iter().flat_map(of_policy).collect()
    };
    match format {
        ExportFormat::Csv => csv::write(evaluation, (metric, alpha), folder),
        ExportFormat::Parquet => {
            let episodes = folder.write_with("episodes.parquet", |path| episodes::write(evaluation, path))?;
            let columns = cells::columns(&all_cells());
            let cells =
                folder.write_with("cells.parquet", |path| ParquetTable::write(path, columns, None))?;
            Ok(vec![episodes, cells])
        }
        ExportFormat::Json => {
            let manifest = &evaluation.files[0].manifest;
            let all = serde_json::json!({ "run": manifest, "metric": metric, "cells": all_cells() });
            Ok(vec![write_json(folder, "cells.json", &all)?])
        }
        ExportFormat::Lerobot => per_policy(|policy| format!("{policy}.eval_info.json"), &|policy| {
            lerobot::eval_info(evaluation, policy, metric)
        }),
        ExportFormat::VlaEval => per_policy(|policy| format!("{policy}.vla-eval.json"), &|policy| {
            vla_eval::benchmark_result(evaluation, policy, metric)
        }),
    }
}

fn write_json(folder: &mut OutputFolder, name: &str, value: &Value) -> anyhow::Result<PathBuf> {
    folder.write(name, format!("{value:#}\n").as_bytes())
}
