//! Policy specifications, as users write them on the command line and in sweep files.

use std::fmt;
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A policy as named on the command line: `idle`, `random`, `expert`, `act:PATH`, `act-int8:PATH`,
/// `pi05:PATH`, `pi05-int8:PATH` or `attach:NAME`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum PolicySpec {
    /// Holds the current position: a floor for success rates.
    Idle,
    /// Draws random actions.
    Random,
    /// The scripted expert, which runs inside the sim: a ceiling for success rates.
    Expert,
    /// An ACT checkpoint folder.
    Act(PathBuf),
    /// An ACT checkpoint folder, evaluated mostly with 8-bit integers ([`crate::nn::Precision`]).
    ActInt8(PathBuf),
    /// A π0.5 checkpoint folder, with weights as stored.
    Pi05(Pi05Source),
    /// A π0.5 checkpoint folder, evaluated mostly with 8-bit integers.
    Pi05Int8(Pi05Source),
    /// An external policy host with this name.
    Attach(String),
}

/// A π0.5 checkpoint and its options: `PATH`, or `PATH?steps=N`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Pi05Source {
    /// Checkpoint folder.
    pub folder: PathBuf,
    /// Number of Euler steps from noise to actions, if not the checkpoint's own.
    pub n_steps: Option<NonZeroU32>,
}

/// Errors that can occur while parsing a policy specification.
#[derive(Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum PolicySpecError {
    #[error("unknown policy `{found}`, expected one of {}", known())]
    Unknown { found: String },
    #[error("policy `{kind}` needs {argument} after a colon: {kind}:{argument}")]
    NoArgument { kind: &'static str, argument: &'static str },
    #[error("policy `{kind}` takes nothing after it, found `{found}`")]
    Argument { kind: &'static str, found: String },
    #[error("policy `{kind}` knows the option `?steps=N` with N from 1 to {MAX_STEPS}, found `?{found}`")]
    Option { kind: &'static str, found: String },
}

/// Maximum number of Euler steps.
pub(crate) const MAX_STEPS: u32 = 1000;

/// A kind of policy: its name and the parser of its argument.
struct PolicyKind {
    name: &'static str,
    parser: ArgumentParser,
}

enum ArgumentParser {
    NoArgument(PolicySpec),
    Argument { name: &'static str, parse: fn(&str) -> Result<PolicySpec, PolicySpecError> },
}

/// All kinds, in the order in which help texts list them.
const KINDS: [PolicyKind; 8] = [
    PolicyKind { name: "idle", parser: ArgumentParser::NoArgument(PolicySpec::Idle) },
    PolicyKind { name: "random", parser: ArgumentParser::NoArgument(PolicySpec::Random) },
    PolicyKind { name: "expert", parser: ArgumentParser::NoArgument(PolicySpec::Expert) },
    PolicyKind {
        name: "act",
        parser: ArgumentParser::Argument {
            name: "PATH",
            parse: |path| Ok(PolicySpec::Act(PathBuf::from(path))),
        },
    },
    PolicyKind {
        name: "act-int8",
        parser: ArgumentParser::Argument {
            name: "PATH",
            parse: |path| Ok(PolicySpec::ActInt8(PathBuf::from(path))),
        },
    },
    PolicyKind {
        name: "pi05",
        parser: ArgumentParser::Argument {
            name: "PATH",
            parse: |text| pi05_source("pi05", text).map(PolicySpec::Pi05),
        },
    },
    PolicyKind {
        name: "pi05-int8",
        parser: ArgumentParser::Argument {
            name: "PATH",
            parse: |text| pi05_source("pi05-int8", text).map(PolicySpec::Pi05Int8),
        },
    },
    PolicyKind {
        name: "attach",
        parser: ArgumentParser::Argument {
            name: "NAME",
            parse: |name| Ok(PolicySpec::Attach(name.to_owned())),
        },
    },
];

impl PolicySpec {
    /// Returns `true` if a policy-host child process runs this policy.
    #[must_use]
    pub fn hosted(&self) -> bool {
        !matches!(self, Self::Expert | Self::Attach(_))
    }

    /// Returns `true` if the policy needs images in its observations.
    #[must_use]
    pub fn needs_images(&self) -> bool {
        !matches!(self, Self::Idle | Self::Random | Self::Expert)
    }

    /// Returns the checkpoint folder, if the policy has one.
    #[must_use]
    pub fn checkpoint(&self) -> Option<&Path> {
        match self {
            Self::Idle | Self::Random | Self::Expert | Self::Attach(_) => None,
            Self::Act(folder) | Self::ActInt8(folder) => Some(folder),
            Self::Pi05(source) | Self::Pi05Int8(source) => Some(&source.folder),
        }
    }

    /// Returns the same policy with another checkpoint folder, if it has one.
    #[must_use]
    pub fn with_checkpoint(mut self, path: &Path) -> Self {
        match &mut self {
            Self::Idle | Self::Random | Self::Expert | Self::Attach(_) => {}
            Self::Act(folder) | Self::ActInt8(folder) => path.clone_into(folder),
            Self::Pi05(source) | Self::Pi05Int8(source) => path.clone_into(&mut source.folder),
        }
        self
    }

    /// Returns the name of the policy's kind.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Random => "random",
            Self::Expert => "expert",
            Self::Act(_) => "act",
            Self::ActInt8(_) => "act-int8",
            Self::Pi05(_) => "pi05",
            Self::Pi05Int8(_) => "pi05-int8",
            Self::Attach(_) => "attach",
        }
    }

    /// Returns the syntax of every kind, for help texts and errors.
    pub fn forms() -> impl Iterator<Item = String> {
        KINDS.iter().map(|kind| match kind.parser {
            ArgumentParser::NoArgument(_) => kind.name.to_owned(),
            ArgumentParser::Argument { name, .. } => format!("{}:{name}", kind.name),
        })
    }
}

impl FromStr for PolicySpec {
    type Err = PolicySpecError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (name, given) = text.split_once(':').map_or((text, None), |(name, given)| (name, Some(given)));
        let kind = KINDS.iter().find(|kind| kind.name == name);
        let kind = kind.ok_or_else(|| PolicySpecError::Unknown { found: text.to_owned() })?;
        match (&kind.parser, given) {
            (ArgumentParser::NoArgument(spec), None) => Ok(spec.clone()),
            (ArgumentParser::NoArgument(_), Some(found)) => {
                Err(PolicySpecError::Argument { kind: kind.name, found: found.to_owned() })
            }
            (ArgumentParser::Argument { name: argument, .. }, None | Some("")) => {
                Err(PolicySpecError::NoArgument { kind: kind.name, argument })
            }
            (ArgumentParser::Argument { parse, .. }, Some(given)) => parse(given),
        }
    }
}

impl fmt::Display for PolicySpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Idle | Self::Random | Self::Expert => f.write_str(self.kind()),
            Self::Act(path) | Self::ActInt8(path) => write!(f, "{}:{}", self.kind(), path.display()),
            Self::Pi05(source) | Self::Pi05Int8(source) => {
                write!(f, "{}:{}", self.kind(), source.folder.display())?;
                source.n_steps.map_or(Ok(()), |steps| write!(f, "?steps={steps}"))
            }
            Self::Attach(name) => write!(f, "attach:{name}"),
        }
    }
}

/// Parses the argument of a π0.5 policy.
fn pi05_source(kind: &'static str, text: &str) -> Result<Pi05Source, PolicySpecError> {
    let Some((folder, option)) = text.rsplit_once('?') else {
        return Ok(Pi05Source { folder: PathBuf::from(text), n_steps: None });
    };
    let steps = option.strip_prefix("steps=").and_then(|steps| steps.parse::<NonZeroU32>().ok());
    match steps.filter(|steps| steps.get() <= MAX_STEPS) {
        Some(steps) => Ok(Pi05Source { folder: PathBuf::from(folder), n_steps: Some(steps) }),
        None => Err(PolicySpecError::Option { kind, found: option.to_owned() }),
    }
}

fn known() -> String {
    PolicySpec::forms().collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_round_trips_through_display() {
        for form in PolicySpec::forms() {
            let spec: PolicySpec = form.parse().unwrap();
            assert_eq!(spec.to_string(), form);
            assert!(form.starts_with(spec.kind()));
        }
        let spec: PolicySpec = "pi05:here?steps=5".parse().unwrap();
        assert_eq!(spec.to_string(), "pi05:here?steps=5");
    }

    #[test]
    fn errors_list_the_known_policies() {
        let error = "acts:here".parse::<PolicySpec>().unwrap_err().to_string();
        assert_eq!(
            error,
            "unknown policy `acts:here`, expected one of idle, random, expert, act:PATH, act-int8:PATH, \
             pi05:PATH, pi05-int8:PATH, attach:NAME"
        );
        let error = "act".parse::<PolicySpec>().unwrap_err().to_string();
        assert_eq!(error, "policy `act` needs PATH after a colon: act:PATH");
        let error = "idle:5".parse::<PolicySpec>().unwrap_err().to_string();
        assert_eq!(error, "policy `idle` takes nothing after it, found `5`");
        let error = "pi05:here?steps=0".parse::<PolicySpec>().unwrap_err().to_string();
        assert_eq!(
            error,
            "policy `pi05` knows the option `?steps=N` with N from 1 to 1000, found `?steps=0`"
        );
    }
}
