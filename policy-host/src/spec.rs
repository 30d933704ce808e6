//! What a user may write for a policy.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A policy as named on the command line: `idle`, `random`, `expert`, `act:PATH`, `act-int8:PATH` or
/// `attach:NAME`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum PolicySpec {
    /// Holds still: the floor.
    Idle,
    /// Random actions.
    Random,
    /// The scripted expert, which runs inside the sim: the ceiling.
    Expert,
    /// An ACT checkpoint folder.
    Act(PathBuf),
    /// An ACT checkpoint folder, most of whose products are made in eight bits ([`crate::nn::Precision`]).
    ActInt8(PathBuf),
    /// A foreign host of this name.
    Attach(String),
}

/// A text that names no policy.
#[derive(Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum PolicySpecError {
    #[error("unknown policy `{found}`, expected one of {}", known())]
    Unknown { found: String },
    #[error("policy `{kind}` needs {argument} after a colon: {kind}:{argument}")]
    NoArgument { kind: &'static str, argument: &'static str },
    #[error("policy `{kind}` takes nothing after it, found `{found}`")]
    Argument { kind: &'static str, found: String },
}

/// One kind of policy: its name, what follows the colon, and how to make it.
struct PolicyKind {
    name: &'static str,
    make: Make,
}

enum Make {
    Plain(PolicySpec),
    With { argument: &'static str, make: fn(&str) -> PolicySpec },
}

/// All kinds, in the order they are listed to users.
const KINDS: [PolicyKind; 6] = [
    PolicyKind { name: "idle", make: Make::Plain(PolicySpec::Idle) },
    PolicyKind { name: "random", make: Make::Plain(PolicySpec::Random) },
    PolicyKind { name: "expert", make: Make::Plain(PolicySpec::Expert) },
    PolicyKind {
        name: "act",
        make: Make::With { argument: "PATH", make: |path| PolicySpec::Act(PathBuf::from(path)) },
    },
    PolicyKind {
        name: "act-int8",
        make: Make::With { argument: "PATH", make: |path| PolicySpec::ActInt8(PathBuf::from(path)) },
    },
    PolicyKind {
        name: "attach",
        make: Make::With { argument: "NAME", make: |name| PolicySpec::Attach(name.to_owned()) },
    },
];

impl PolicySpec {
    /// Whether a child process of ours runs it.
    #[must_use]
    pub fn hosted(&self) -> bool {
        matches!(self, Self::Idle | Self::Random | Self::Act(_) | Self::ActInt8(_))
    }

    /// Whether it looks at images.
    #[must_use]
    pub fn needs_images(&self) -> bool {
        matches!(self, Self::Act(_) | Self::ActInt8(_) | Self::Attach(_))
    }

    /// Name of its kind.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Random => "random",
            Self::Expert => "expert",
            Self::Act(_) => "act",
            Self::ActInt8(_) => "act-int8",
            Self::Attach(_) => "attach",
        }
    }

    /// The ways to write a policy, as shown to users.
    pub fn forms() -> impl Iterator<Item = String> {
        KINDS.iter().map(|kind| match kind.make {
            Make::Plain(_) => kind.name.to_owned(),
            Make::With { argument, .. } => format!("{}:{argument}", kind.name),
        })
    }
}

impl FromStr for PolicySpec {
    type Err = PolicySpecError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (name, given) = text.split_once(':').map_or((text, None), |(name, given)| (name, Some(given)));
        let kind = KINDS.iter().find(|kind| kind.name == name);
        let kind = kind.ok_or_else(|| PolicySpecError::Unknown { found: text.to_owned() })?;
        match (&kind.make, given) {
            (Make::Plain(spec), None) => Ok(spec.clone()),
            (Make::Plain(_), Some(found)) => {
                Err(PolicySpecError::Argument { kind: kind.name, found: found.to_owned() })
            }
            (Make::With { argument, .. }, None | Some("")) => {
                Err(PolicySpecError::NoArgument { kind: kind.name, argument })
            }
            (Make::With { make, .. }, Some(given)) => Ok(make(given)),
        }
    }
}

impl fmt::Display for PolicySpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Idle | Self::Random | Self::Expert => f.write_str(self.kind()),
            Self::Act(path) | Self::ActInt8(path) => write!(f, "{}:{}", self.kind(), path.display()),
            Self::Attach(name) => write!(f, "attach:{name}"),
        }
    }
}

fn known() -> String {
    PolicySpec::forms().collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_reads_back_as_it_is_shown() {
        for form in PolicySpec::forms() {
            let spec: PolicySpec = form.parse().unwrap();
            assert_eq!(spec.to_string(), form);
            assert!(form.starts_with(spec.kind()));
        }
    }

    #[test]
    fn errors_say_what_is_known() {
        let error = "acts:here".parse::<PolicySpec>().unwrap_err().to_string();
        assert_eq!(
            error,
            "unknown policy `acts:here`, expected one of idle, random, expert, act:PATH, act-int8:PATH, attach:NAME"
        );
        let error = "act".parse::<PolicySpec>().unwrap_err().to_string();
        assert_eq!(error, "policy `act` needs PATH after a colon: act:PATH");
        let error = "idle:5".parse::<PolicySpec>().unwrap_err().to_string();
        assert_eq!(error, "policy `idle` takes nothing after it, found `5`");
    }
}
