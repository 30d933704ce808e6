//! Exit codes: the ways in which a command ends.

use std::fmt;
use std::process::ExitCode;

/// The end of a command that did its work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ExitStatus {
    /// The work is complete.
    Success,
    /// The work is complete, but some episodes ended with an error or a difference.
    EpisodeErrors,
    /// The user interrupted the work.
    Interrupted,
}

impl ExitStatus {
    /// Returns the exit code of the process.
    pub(crate) fn exit_code(self) -> ExitCode {
        ExitCode::from(match self {
            Self::Success => 0,
            Self::EpisodeErrors => 1,
            // Shells report this code for a program that SIGINT terminated.
            Self::Interrupted => 130,
        })
    }
}

/// An error that ended a command, classified by who can fix it.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The user can fix it: arguments, files, limits of the machine.
    User(anyhow::Error),
    /// The user cannot fix it: a bug, or a failure of the machine.
    Bug(anyhow::Error),
}

impl Failure {
    /// Returns the exit code of the process.
    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::User(_) => 2,
            Self::Bug(_) => 3,
        })
    }
}

impl fmt::Display for Failure {
    /// Writes the error followed by its chain of sources. No error message of the project repeats its source.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::User(error) | Self::Bug(error)) = self;
        f.write_str(format!("{error:#}").trim_end())
    }
}

/// Classifies an error as a bug. [`OrUser::or_user`] classifies it as the user's.
impl<E: Into<anyhow::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Bug(error.into())
    }
}

/// Classification of a result's error as one that the user can fix.
pub(crate) trait OrUser<T> {
    /// Turns the error into [`Failure::User`].
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
    fn failure_shows_each_source_once() {
        let error = anyhow!("no such file").context("failed to read x").context("policy `p`");
        assert_eq!(Failure::User(error).to_string(), "policy `p`: failed to read x: no such file");
        let error = anyhow!("no such file").context("failed to read x");
        assert_eq!(Failure::Bug(error).to_string(), "failed to read x: no such file");
    }
}
