//! The policies of a run: their names in the results, their specs and their identities.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use policy_host::device::supports_gpu;
use policy_host::formats::content::{CheckpointContent, ReadContentError};
use policy_host::formats::{CheckpointFolderError, resolve};
use policy_host::{PolicySpec, PolicySpecError};
use run_config::{Execution, QueryMode};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::selection::names::UnknownName;

/// Maximum length of a policy name.
const MAX_NAME: usize = 64;

/// A policy with the name that the user chose.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NamedPolicy {
    /// Name in the results.
    pub(crate) name: String,
    /// Kind and checkpoint or attachment.
    pub(crate) spec: PolicySpec,
}

/// The properties of a policy that its results depend on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Identity {
    /// The spec, as on the command line.
    pub(crate) spec: String,
    /// Hash of the content of its checkpoint, or of the mapping of its requests to a server.
    pub(crate) checkpoint: Option<String>,
    /// Device on which it computes ([`policy_host::device`]), if that is not the CPU.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) device: Option<String>,
    /// Use of its chunks; `None` for the expert, which has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) execution: Option<Execution>,
    /// Sentences about settings of the checkpoint, for readers of the results, which do not depend on them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) notes: Vec<String>,
}

/// Errors that can occur while parsing a policy.
#[derive(Debug, Error, PartialEq, Eq)]
pub(crate) enum PolicyArgError {
    #[error("policy name `{name}` is invalid, expected 1 to {MAX_NAME} letters, digits, `.`, `_` or `-`")]
    Name { name: String },
    #[error(transparent)]
    Unknown(#[from] UnknownName),
    #[error(transparent)]
    Spec(#[from] PolicySpecError),
}

impl FromStr for NamedPolicy {
    type Err = PolicyArgError;

    /// Parses `NAME=SPEC`, or a spec alone, whose kind is then its name.
    fn from_str(typed: &str) -> Result<Self, PolicyArgError> {
        // With a colon before it, the equals sign belongs to the path of a spec.
        let (name, text) = match typed.split_once('=') {
            Some((name, text)) if !name.contains(':') => (Some(name), text),
            _ => (None, typed),
        };
        let spec = text.parse::<PolicySpec>().map_err(|error| match error {
            PolicySpecError::Unknown { .. } => PolicyArgError::Unknown(unknown_kind(text)),
            other => PolicyArgError::Spec(other),
        })?;
        let name = name.map_or_else(|| spec.kind(), str::to_owned);
        // Both kinds of names become file names.
        if let PolicySpec::Attach(foreign) = &spec
            && !is_plain(foreign)
        {
            return Err(PolicyArgError::Name { name: foreign.clone() });
        }
        if is_plain(&name) { Ok(Self { name, spec }) } else { Err(PolicyArgError::Name { name }) }
    }
}

impl NamedPolicy {
    /// Returns `true` if the sim itself runs the policy, with privileged state. Any other policy has a lane.
    pub(crate) fn runs_in_sim(&self) -> bool {
        self.spec == PolicySpec::Expert
    }

    /// Returns the policy with the folder that the user means by the path of its checkpoint.
    ///
    /// # Errors
    /// If there is no checkpoint.
    pub(crate) fn located(&self) -> Result<Self, CheckpointFolderError> {
        let Some(typed) = self.spec.checkpoint() else { return Ok(self.clone()) };
        let folder = resolve(&expand_home(typed))?;
        Ok(Self { name: self.name.clone(), spec: self.spec.clone().with_checkpoint(&folder) })
    }

    /// Returns the identity of the policy on the device of a run, without notes. Reads all files of its
    /// checkpoint.
    ///
    /// # Errors
    /// If the checkpoint cannot be read.
    pub(crate) fn identity(
        &self,
        device: Option<&str>,
        execution: Execution,
    ) -> Result<Identity, ReadContentError> {
        let content = match &self.spec {
            PolicySpec::Server(server) => server.mapping().map(CheckpointContent::read_file),
            spec => spec.checkpoint().map(CheckpointContent::read),
        };
        let checkpoint = content.transpose()?.map(|content| content.hash());
        let device = device.filter(|_| supports_gpu(&self.spec)).map(str::to_owned);
        let execution = (!self.runs_in_sim()).then_some(execution);
        Ok(Identity { spec: self.spec.to_string(), checkpoint, device, execution, notes: Vec::new() })
    }
}

impl Identity {
    /// Returns the spec of a policy in a results file. A relative path of a checkpoint that leads nowhere is
    /// looked for beside the file.
    ///
    /// # Errors
    /// If the spec is invalid.
    pub(crate) fn spec_beside(&self, results: &Path) -> Result<PolicySpec, <PolicySpec as FromStr>::Err> {
        let spec: PolicySpec = self.spec.parse()?;
        let beside = spec.checkpoint().filter(|path| path.is_relative() && !path.exists());
        let beside = beside.and_then(|path| Some(results.parent()?.join(path))).filter(|path| path.exists());
        Ok(match beside {
            Some(path) => spec.with_checkpoint(&path),
            None => spec,
        })
    }

    /// Returns `true` if both are the same policy. Checkpoints are compared by content, not by path.
    pub(crate) fn matches(&self, other: &Self) -> bool {
        // Everything but the path: the kind and its options.
        let rest = |identity: &Self| {
            let spec = identity.spec.parse::<PolicySpec>().ok()?;
            Some(spec.without_paths())
        };
        let same_device = self.device == other.device;
        if self.execution != other.execution {
            return false;
        }
        match (&self.checkpoint, &other.checkpoint) {
            (Some(ours), Some(theirs)) => ours == theirs && rest(self) == rest(other) && same_device,
            (None, None) => self.spec == other.spec,
            _ => false,
        }
    }
}

impl std::fmt::Display for Identity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.checkpoint {
            Some(checkpoint) => write!(f, "{} (checkpoint {checkpoint})", self.spec)?,
            None => f.write_str(&self.spec)?,
        }
        match self.execution {
            None => {}
            Some(Execution { mode: QueryMode::Chunk, execute }) => write!(f, ", {execute} rows per query")?,
            Some(Execution { mode: QueryMode::Ensemble, .. }) => f.write_str(", ensemble mode")?,
        }
        self.device.as_ref().map_or(Ok(()), |device| write!(f, " on {device}"))
    }
}

/// Replaces a leading `~` by the home folder, which a shell does not do after a colon.
fn expand_home(typed: &Path) -> PathBuf {
    match (typed.strip_prefix("~"), std::env::home_dir()) {
        (Ok(rest), Some(home)) => home.join(rest),
        _ => typed.to_owned(),
    }
}

/// Returns `true` for a text that can be the name of a policy, which becomes part of file names.
pub(crate) fn is_plain(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-');
    (1..=MAX_NAME).contains(&name.len()) && name.chars().all(allowed) && !name.starts_with('.')
}

fn unknown_kind(text: &str) -> UnknownName {
    let forms: Vec<String> = PolicySpec::forms().collect();
    let known: Vec<&str> = forms.iter().map(String::as_str).collect();
    UnknownName::new("policy", text, &known)
}

#[cfg(test)]
mod tests {
    use policy_host::models::Family;
    use policy_host::nn::Precision;

    use super::*;

    fn parse(typed: &str) -> (String, String) {
        let policy: NamedPolicy = typed.parse().unwrap();
        (policy.name, policy.spec.to_string())
    }

    #[test]
    fn spec_without_name_is_named_by_kind() {
        let pair = |name: &str, spec: &str| (name.to_owned(), spec.to_owned());
        assert_eq!(parse("idle"), pair("idle", "idle"));
        assert_eq!(parse("floor=idle"), pair("floor", "idle"));
        assert_eq!(parse("act:runs/lr=3"), pair("act", "act:runs/lr=3"));
        assert_eq!(parse("mine=act:runs/lr=3"), pair("mine", "act:runs/lr=3"));
    }

    #[test]
    fn checkpoint_identity_depends_on_content_only() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, weights: &[u8]| {
            let sub = folder.path().join(name).join("single");
            std::fs::create_dir_all(&sub).unwrap();
            std::fs::write(sub.join("config.json"), "{}").unwrap();
            std::fs::write(sub.join("model.safetensors"), weights).unwrap();
            std::fs::write(sub.join("notes.md"), name).unwrap();
            let spec = PolicySpec::network(Family::Act, Precision::F32, folder.path().join(name));
            NamedPolicy { name: "mine".to_owned(), spec }.identity(None, Execution::chunk(30)).unwrap()
        };
        let (first, moved, trained) = (write("first", b"w1"), write("moved", b"w1"), write("trained", b"w2"));
        assert!(first.matches(&moved));
        assert!(!first.matches(&trained));
        let idle = "idle".parse::<NamedPolicy>().unwrap().identity(None, Execution::chunk(30)).unwrap();
        assert!(idle.matches(&idle) && !idle.matches(&first));
    }
}
