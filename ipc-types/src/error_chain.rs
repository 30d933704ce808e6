//! Display of an error together with its causes.

use std::error::Error;

/// Returns the messages of `error` and of every [`Error::source`] below it, joined by `: `.
///
/// An error of this project either prints its cause or returns it from `source()`, never both, so that the
/// joined text names each cause exactly once. Some errors of other crates do both: what they repeat is left
/// out. Use this wherever an error leaves the process as text.
#[must_use]
pub fn error_chain(error: &dyn Error) -> String {
    let causes = std::iter::successors(error.source(), |cause| (*cause).source());
    causes.fold(error.to_string(), |text, cause| {
        let cause = cause.to_string();
        if text.ends_with(&cause) { text } else { format!("{text}: {cause}") }
    })
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

    #[derive(Debug)]
    struct Repeats(std::io::Error);

    impl std::fmt::Display for Repeats {
        fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            write!(f, "I/O error: {}", self.0)
        }
    }

    impl Error for Repeats {
        fn source(&self) -> Option<&(dyn Error + 'static)> {
            Some(&self.0)
        }
    }

    #[test]
    fn repeated_cause_is_left_out() {
        let error = Repeats(std::io::Error::other("disk on fire"));
        assert_eq!(error_chain(&error), "I/O error: disk on fire");
    }
}
