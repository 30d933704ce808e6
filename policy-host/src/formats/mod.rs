//! File formats of checkpoint folders, as far as they depend on no network: what a user may name, LeRobot's
//! configuration and processors, `hypogeum.json`, and the hash of a folder's content.
//!
//! A network's own configuration is read in its folder under [`models`](crate::models), which builds on this.

pub mod content;
pub mod mapping;
pub mod scaling;

pub(crate) mod files;
pub(crate) mod folder;
pub(crate) mod lerobot;
pub(crate) mod settings;

mod error;

pub use self::error::CheckpointError;
pub use self::folder::{CheckpointFolderError, PolicyCheck, resolve};
pub use self::mapping::ObservationMapping;
