//! Conclusions from results files: merged evaluations, comparisons of matched episodes, and their verdicts.
//!
//! It reads the rows of one or several files, refuses to mix what must not be mixed, and computes; it
//! prints and writes nothing. `docs/conclusions.md` defines every quantity.

mod cells;
mod comparison;
mod effects;
mod evaluation;
mod flips;
mod groups;
mod matching;

pub(crate) use self::cells::{CellSummary, Rate};
pub(crate) use self::comparison::{
    ComparedCell, ComparedGroup, Comparison, ComparisonKind, ComparisonOptions, TestKind,
};
pub(crate) use self::effects::{
    CellRate, Effect, EmbodimentDifference, MODALITIES, ModalityEffect, effects, embodiment_differences,
    mean, modality_effects, modality_name, morphology_name,
};
pub(crate) use self::evaluation::{EvaluatedPolicy, Evaluation, RowIdx, read_files};
pub(crate) use self::flips::{Flip, FlipSide};
pub(crate) use self::matching::Metric;

#[cfg(test)]
mod tests;
