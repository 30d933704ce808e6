//! How a command ends, and the exit code that says so.

use std::fmt;
use std::process::ExitCode;

/// How a command that did its work ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ending {
    /// All is done.
    Done,
    /// All is done, but some episodes ended with an error.
    WithErrors,
    /// The user interrupted it.
    Interrupted,
}

impl Ending {
    pub(crate) fn exit_code(self) -> ExitCode {
        ExitCode::from(match self {
            Self::Done => 0,
            Self::WithErrors => 1,
            // What a shell reports for a program that SIGINT ended.
            Self::Interrupted => 130,
        })
    }
}

/// Why a command could not do its work, sorted by whose turn it is to act.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The user can mend it: arguments, files, the machine's limits.
    User(anyhow::Error),
    /// The user cannot: a bug, or the machine failed us.
    Bug(anyhow::Error),
}

impl Failure {
    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::User(_) => 2,
            Self::Bug(_) => 3,
        })
    }
}

impl fmt::Display for Failure {
    /// The error and its causes, each once: many errors repeat their cause in their own message.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::User(error) | Self::Bug(error)) = self;
        let mut text = String::new();
        for cause in error.chain().map(ToString::to_string) {
            if text.is_empty() {
                text = cause;
            } else if !text.contains(cause.trim_end()) {
                text = format!("{text}: {cause}");
            }
        }
        f.write_str(text.trim_end())
    }
}

/// An error is taken for a bug unless [`OrUser::or_user`] says otherwise.
impl<E: Into<anyhow::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Bug(error.into())
    }
}

/// Marks the errors of a result as the user's to mend.
pub(crate) trait OrUser<T> {
    fn or_user(self) -> Result<T, Failure>;
}

impl<T, E: Into<anyhow::Error>> OrUser<T> for Result<T, E> {
    fn or_user(self) -> Result<T, Failure> {
        self.map_err(|error| Failure::User(error.into()))
    }
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::*;

    #[test]
    fn a_cause_is_said_once() {
        let repeated =
            anyhow!("no such file").context("failed to read x: no such file").context("policy `p`");
        assert_eq!(Failure::User(repeated).to_string(), "policy `p`: failed to read x: no such file");
        let plain = anyhow!("no such file").context("failed to read x");
        assert_eq!(Failure::Bug(plain).to_string(), "failed to read x: no such file");
    }
}
