//! The options of a run, and what every process of it needs apart from messages: files that a user names,
//! texts of errors, limits of the machine, records of what threads do, and the end of a child whose parent is
//! gone.

pub mod allotment;
mod amount;
mod choices;
mod error_chain;
pub mod input;
mod language_file;
mod lifeline;
mod options;
mod query;
mod strength;
pub mod trace;

pub use amount::{Amount, AmountError};
pub use choices::{DeviceChoice, Profile, QueryMode, RendererChoice, Samples};
pub use error_chain::{error_chain, one_line, printable, shorten};
pub use language_file::{LanguageFile, LanguageFileError};
pub use lifeline::Lifeline;
pub use options::{
    ImageOptions, InferenceOptions, MAX_ENVS, MAX_THREADS, ResourceOptions, ResultOptions, RunConfig,
};
pub use query::{Execution, QueryOptions};
pub use strength::{Strength, StrengthError};
