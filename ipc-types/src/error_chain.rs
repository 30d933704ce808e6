//! Display of an error together with its causes.

use std::error::Error;

/// Returns the messages of `error` and of every [`Error::source`] below it, joined by `: `.
///
/// An error of this project either prints its cause or returns it from `source()`, never both, so that the
/// joined text names each cause exactly once. Some errors of other crates do both: what they repeat is left
/// out. Use this wherever an error leaves the process as text.
///
/// Errors quote files and arguments, which may contain line breaks or commands for a terminal. The text is
/// one line, with control characters written as in a Rust string.
#[must_use]
pub fn error_chain(error: &dyn Error) -> String {
    let causes = std::iter::successors(error.source(), |cause| (*cause).source());
    let text = causes.fold(error.to_string(), |text, cause| {
        let cause = cause.to_string();
        if text.ends_with(&cause) { text } else { format!("{text}: {cause}") }
    });
    let escaped = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    text.trim_end().chars().map(escaped).collect()
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

    #[test]
    fn control_characters_are_escaped() {
        let error = std::io::Error::other("unknown key `\u{1b}[2J\né`\n");
        assert_eq!(error_chain(&error), r"unknown key `\u{1b}[2J\né`");
    }
}
