//! The terminal and the process itself: output, progress, tables, files that a user asked for, signals, exit
//! codes. It knows nothing of runs and results.

pub(crate) mod exit;
pub(crate) mod interrupt;
pub(crate) mod output;
pub(crate) mod output_files;
pub(crate) mod progress;
pub(crate) mod surroundings;
pub(crate) mod table;
pub(crate) mod threads;
