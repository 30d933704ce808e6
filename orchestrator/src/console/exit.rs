//! Exit codes: the ways in which a command ends.

use std::error::Error;
use std::fmt;
use std::process::ExitCode;

use ipc_types::link::LinkError;
use ipc_types::{is_refusal, remedy};
use run_config::error_chain;

use crate::console::output::OutputError;
use crate::store::results::StoreError;

/// Exit code of a child that could not use the run's shared memory, for which it is not to blame.
pub(crate) const LINK_FAILED: u8 = 4;

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
            Self::Bug(error) if link_error(error).is_some() => LINK_FAILED,
            Self::Bug(_) => 3,
        })
    }
}

impl fmt::Display for Failure {
    /// Writes the error, its causes, and advice if the operating system has refused something.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::User(error) | Self::Bug(error)) = self;
        f.write_str(&error_chain(error.as_ref()))?;
        remedy(error.as_ref()).map_or(Ok(()), |remedy| write!(f, "; {remedy}"))
    }
}

/// Classifies an error by its causes. [`OrUser::or_user`] classifies any error as the user's.
impl<E: Into<anyhow::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        let error = error.into();
        if is_user_error(&error) { Self::User(error) } else { Self::Bug(error) }
    }
}

/// Returns `true` if the user can fix what is wrong with a file or the machine.
pub(crate) fn is_user_error(error: &anyhow::Error) -> bool {
    // A missing segment, for example, is not for the user to restore.
    if let Some(link) = link_error(error) {
        return link.is_user_error();
    }
    let is_cause = |cause: &(dyn Error + 'static)| cause.is::<StoreError>() || cause.is::<OutputError>();
    is_refusal(error.as_ref()) || error.chain().any(is_cause)
}

/// Returns the error of shared memory among the causes.
fn link_error(error: &anyhow::Error) -> Option<&LinkError> {
    error.chain().find_map(|cause| cause.downcast_ref())
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
    fn failure_is_one_line() {
        let failure = Failure::User(anyhow!("found `\u{1b}[2J`").context("line 1\nof x"));
        assert_eq!(failure.to_string(), r"line 1\nof x: found `\u{1b}[2J`");
    }

    #[test]
    fn failure_shows_each_source_once() {
        let error = anyhow!("no such file").context("failed to read x").context("policy `p`");
        assert_eq!(Failure::User(error).to_string(), "policy `p`: failed to read x: no such file");
        let error = anyhow!("no such file").context("failed to read x");
        assert_eq!(Failure::Bug(error).to_string(), "failed to read x: no such file");
    }

    #[test]
    fn refusal_by_the_system_is_a_user_error() {
        let refused = |errno: rustix::io::Errno| {
            Failure::from(anyhow::Error::from(std::io::Error::from(errno)).context("failed to start"))
        };
        let Failure::User(_) = refused(rustix::io::Errno::MFILE) else { panic!("a limit is no bug") };
        let text = refused(rustix::io::Errno::MFILE).to_string();
        assert!(text.ends_with("(os error 24); raise the limit of open files: `ulimit -n 1024`"), "{text}");
        let Failure::Bug(_) = refused(rustix::io::Errno::PIPE) else { panic!("nobody reads") };
    }
}
