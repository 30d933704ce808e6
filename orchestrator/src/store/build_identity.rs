//! The identity of this program.

/// Version of the program.
pub(crate) const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Hash of the code that results depend on (`build.rs`): simulator, policies and libraries.
pub(crate) const CODE: &str = env!("HYPOGEUM_CODE");

/// Commit that was checked out when the program was built, or "unknown".
pub(crate) const COMMIT: &str = env!("HYPOGEUM_COMMIT");
