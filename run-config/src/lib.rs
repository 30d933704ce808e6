//! The options of a run, and what every process of it needs apart from messages: files that a user names,
//! texts of errors, limits of the machine, records of what threads do, and the end of a child whose parent is
//! gone.

pub mod allotment;
mod amount;
mod error_chain;
pub mod input;
mod language_file;
mod lifeline;
mod options;
pub mod trace;

pub use amount::{Amount, AmountError};
pub use error_chain::{error_chain, one_line, printable, shorten};
pub use language_file::{LanguageFile, LanguageFileError};
pub use lifeline::Lifeline;
pub use options::{
    DeviceChoice, EpisodeEnd, Execution, ImageOptions, InferenceOptions, Instructions, MAX_ENVS, MAX_THREADS,
    Profile, Protocol, ProtocolName, ProtocolOptions, QueryMode, QueryOptions, RendererChoice,
    ResourceOptions, ResultOptions, RunConfig, Samples, Strength, StrengthError,
};
