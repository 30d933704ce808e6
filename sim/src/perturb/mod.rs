//! Perturbations of a task's scene distribution.
//!
//! Each perturbation edits only the fields of the [`SceneSpec`](scene::SceneSpec) that it owns.
//! Nothing in this module is random.

mod apply;
mod composition;
mod language;
mod perturbation;

pub use composition::{Composition, CompositionError};
pub use language::{Language, SentencesError};
pub use perturbation::{Modality, NotApplicable, Perturbation};
pub use run_config::{Strength, StrengthError};
