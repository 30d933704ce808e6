//! Display of an error together with its causes.

use std::error::Error;

/// Returns the messages of `error` and of every [`Error::source`] below it, joined by `: `.
///
/// An error of this project either prints its cause or returns it from `source()`, never both, so that the
/// joined text names each cause exactly once. Use this wherever an error leaves the process as text.
#[must_use]
pub fn error_chain(error: &dyn Error) -> String {
    let causes = std::iter::successors(error.source(), |cause| (*cause).source());
    causes.fold(error.to_string(), |text, cause| format!("{text}: {cause}"))
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::link::{BudgetError, LinkError};

    #[test]
    fn every_cause_appears_once_in_order() {
        let source = std::io::Error::other("disk on fire");
        let error = LinkError::from(BudgetError::Unknown { path: PathBuf::from("/dev/shm"), source });
        assert_eq!(error_chain(&error), "failed to query the free space of /dev/shm: disk on fire");
    }
}
