//! Policy specifications, as users write them on the command line and in sweep files.

pub mod server;

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use self::server::{PolicyServer, ServerOption, ServerProtocol};
use crate::models::Family;
use crate::models::family::NetworkSource;
use crate::nn::Precision;

/// A policy as named on the command line: `idle`, `random`, `expert`, `FAMILY:PATH`, `FAMILY-int8:PATH`,
/// `attach:NAME` or `PROTOCOL:URL`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum PolicySpec {
    /// Holds the current position: a floor for success rates.
    Idle,
    /// Draws random actions.
    Random,
    /// The scripted expert, which runs inside the sim: a ceiling for success rates.
    Expert,
    /// A network of a family.
    Network(Family, NetworkSource),
    /// An external policy host with this name.
    Attach(String),
    /// A policy in a server, which a policy host in Python asks.
    Server(PolicyServer),
}

/// Errors that can occur while parsing a policy specification.
#[derive(Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum PolicySpecError {
    #[error("unknown policy `{found}`, expected one of {}", known())]
    Unknown { found: String },
    #[error("policy `{kind}` needs {argument} after a colon: {kind}:{argument}")]
    NoArgument { kind: String, argument: &'static str },
    #[error("policy `{kind}` takes nothing after it, found `{found}`")]
    Argument { kind: String, found: String },
    #[error("policy `{kind}` knows the option `?steps=N` with N from 1 to {max}, found `?{found}`")]
    Option { kind: String, max: u32, found: String },
    #[error(
        "policy `{kind}` knows the options {} (URL?mapping=FILE&…), found `{found}`",
        ServerOption::names()
    )]
    ServerOption { kind: String, found: String },
}

/// The policies that are named by one word.
const WORDS: [PolicySpec; 3] = [PolicySpec::Idle, PolicySpec::Random, PolicySpec::Expert];
/// The kind of an external host, and its argument.
const ATTACH: (&str, &str) = ("attach", "NAME");
/// The argument of a network.
const PATH: &str = "PATH";
/// The argument of a policy in a server.
const URL: &str = "URL";
/// The option of families that denoise actions in steps.
const STEPS: &str = "steps=";

impl PolicySpec {
    /// Returns the network in a checkpoint folder, with the checkpoint's own options.
    pub fn network(family: Family, precision: Precision, folder: impl Into<PathBuf>) -> Self {
        Self::Network(family, NetworkSource { folder: folder.into(), precision, n_steps: None })
    }

    /// Returns `true` if a policy-host child process runs this policy.
    #[must_use]
    pub fn hosted(&self) -> bool {
        !matches!(self, Self::Expert | Self::Attach(_))
    }

    /// Returns `true` if the policy needs images in its observations.
    #[must_use]
    pub fn needs_images(&self) -> bool {
        matches!(self, Self::Network(..)) || self.is_elsewhere()
    }

    /// Returns `true` if the policy computes outside the processes of a run, perhaps on another machine.
    #[must_use]
    pub fn is_elsewhere(&self) -> bool {
        matches!(self, Self::Attach(_) | Self::Server(_))
    }

    /// Returns the checkpoint folder, if the policy has one.
    #[must_use]
    pub fn checkpoint(&self) -> Option<&Path> {
        if let Self::Network(_, source) = self { Some(&source.folder) } else { None }
    }

    /// Returns the same policy with another checkpoint folder, if it has one.
    #[must_use]
    pub fn with_checkpoint(mut self, path: &Path) -> Self {
        if let Self::Network(_, source) = &mut self {
            path.clone_into(&mut source.folder);
        }
        self
    }

    /// Returns the same policy without paths on this machine, whose content identifies it.
    #[must_use]
    pub fn without_paths(self) -> Self {
        match self {
            Self::Server(server) => Self::Server(server.without_mapping()),
            other => other.with_checkpoint(Path::new("")),
        }
    }

    /// Returns the seconds that a batch may take, if it may take unusually long.
    #[must_use]
    pub fn answer_timeout_s(&self) -> Option<u32> {
        if let Self::Network(family, _) = self { family.definition().answer_timeout_s } else { None }
    }

    /// Returns the name of the policy's kind.
    #[must_use]
    pub fn kind(&self) -> String {
        match self {
            Self::Idle => "idle".to_owned(),
            Self::Random => "random".to_owned(),
            Self::Expert => "expert".to_owned(),
            Self::Network(family, source) => network_kind(*family, source.precision),
            Self::Attach(_) => ATTACH.0.to_owned(),
            Self::Server(server) => server.protocol.name().to_owned(),
        }
    }

    /// Returns the syntax of every kind, for help texts and errors.
    pub fn forms() -> impl Iterator<Item = String> {
        let words = WORDS.iter().map(Self::kind);
        let networks = networks().map(|(family, precision)| (network_kind(family, precision), PATH));
        let servers = ServerProtocol::ALL.map(|protocol| (protocol.name().to_owned(), URL));
        let with_argument = networks.chain([(ATTACH.0.to_owned(), ATTACH.1)]).chain(servers);
        words.chain(with_argument.map(|(kind, argument)| format!("{kind}:{argument}")))
    }
}

impl FromStr for PolicySpec {
    type Err = PolicySpecError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (name, given) = text.split_once(':').map_or((text, None), |(name, given)| (name, Some(given)));
        let kind = name.to_owned();
        if let Some(spec) = WORDS.into_iter().find(|spec| spec.kind() == name) {
            return match given {
                None => Ok(spec),
                Some(found) => Err(PolicySpecError::Argument { kind, found: found.to_owned() }),
            };
        }
        let network = networks().find(|(family, precision)| network_kind(*family, *precision) == name);
        let server = ServerProtocol::ALL.into_iter().find(|protocol| protocol.name() == name);
        let argument = match (network, server) {
            (Some(_), _) => PATH,
            (None, Some(_)) => URL,
            (None, None) if name == ATTACH.0 => ATTACH.1,
            (None, None) => return Err(PolicySpecError::Unknown { found: text.to_owned() }),
        };
        let given = given.filter(|given| !given.is_empty());
        let Some(given) = given else { return Err(PolicySpecError::NoArgument { kind, argument }) };
        match (network, server) {
            (Some((family, precision)), _) => parse_network(family, precision, given),
            (None, Some(protocol)) => PolicyServer::parse(protocol, given)
                .map(Self::Server)
                .map_err(|found| PolicySpecError::ServerOption { kind, found: found.to_owned() }),
            (None, None) => Ok(Self::Attach(given.to_owned())),
        }
    }
}

impl fmt::Display for PolicySpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.kind())?;
        match self {
            Self::Idle | Self::Random | Self::Expert => Ok(()),
            Self::Network(_, NetworkSource { folder, n_steps, .. }) => {
                write!(f, ":{}", folder.display())?;
                n_steps.map_or(Ok(()), |n_steps| write!(f, "?{STEPS}{n_steps}"))
            }
            Self::Attach(name) => write!(f, ":{name}"),
            Self::Server(server) => write!(f, ":{server}"),
        }
    }
}

/// Returns all families in all precisions.
fn networks() -> impl Iterator<Item = (Family, Precision)> {
    Family::ALL.iter().flat_map(|family| family.definition().precisions.iter().map(|it| (*family, *it)))
}

/// Returns the name of a family in a precision.
fn network_kind(family: Family, precision: Precision) -> String {
    let suffix = match precision {
        Precision::F32 => "",
        Precision::Int8 => "-int8",
    };
    format!("{}{suffix}", family.definition().name)
}

/// Parses the argument of a network: `PATH`, or `PATH?steps=N` if the family has that option.
fn parse_network(family: Family, precision: Precision, text: &str) -> Result<PolicySpec, PolicySpecError> {
    let split = family.definition().max_steps.and_then(|max| Some((max, text.rsplit_once('?')?)));
    let Some((max, (folder, option))) = split else {
        return Ok(PolicySpec::network(family, precision, text));
    };
    let n_steps = option.strip_prefix(STEPS).and_then(|n_steps| n_steps.parse().ok());
    match n_steps.filter(|n_steps: &std::num::NonZeroU32| n_steps.get() <= max) {
        Some(_) => {
            let folder = folder.into();
            Ok(PolicySpec::Network(family, NetworkSource { folder, precision, n_steps }))
        }
        None => {
            let kind = network_kind(family, precision);
            Err(PolicySpecError::Option { kind, max, found: option.to_owned() })
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
    fn every_form_round_trips_through_display() {
        for form in PolicySpec::forms() {
            let spec: PolicySpec = form.parse().unwrap();
            assert_eq!(spec.to_string(), form);
            assert!(form.starts_with(&spec.kind()));
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
             pi05:PATH, pi05-int8:PATH, attach:NAME, openpi:URL, vla-eval:URL, lerobot-async:URL"
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
