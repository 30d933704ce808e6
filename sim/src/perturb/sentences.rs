//! Paraphrases read from a file, in place of the built-in ones.

use std::collections::BTreeMap;
use std::path::PathBuf;

use ipc_types::layout::INSTRUCTION_BYTES;
use ipc_types::run_config::{LanguageFile, LanguageFileError};
use saphyr::{LoadableYamlNode, Yaml};
use thiserror::Error;

use crate::scene::{InstructionSource, SceneSpec};
use crate::task::Task;

/// Sentences for the perturbation Language-Paraphrase, per env id.
#[derive(Clone, Debug)]
pub struct Sentences {
    path: PathBuf,
    by_env_id: BTreeMap<String, Vec<String>>,
}

/// Errors that can occur while reading sentences.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the variants")]
pub enum SentencesError {
    #[error(transparent)]
    File(#[from] LanguageFileError),
    #[error("{} is not valid YAML", path.display())]
    Yaml { path: PathBuf, source: saphyr::ScanError },
    #[error("{} is {found}, expected a single mapping from env ids to lists of sentences", path.display())]
    NotMapping { path: PathBuf, found: &'static str },
    #[error("{}: `{env_id}` is {found}, expected a list of sentences", path.display())]
    NotList { path: PathBuf, env_id: String, found: &'static str },
    #[error(
        "{}: sentence {n} of `{env_id}` is {found}, expected text of 1 to {INSTRUCTION_BYTES} bytes",
        path.display()
    )]
    NotSentence { path: PathBuf, env_id: String, n: usize, found: String },
    #[error("{} has no sentences for `{env_id}`; its keys are {keys}", path.display())]
    Missing { path: PathBuf, env_id: &'static str, keys: String },
}

impl Sentences {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// The first thing that is not as expected.
    pub fn read(file: &LanguageFile) -> Result<Self, SentencesError> {
        let path = || file.path().to_path_buf();
        let documents = Yaml::load_from_str(&file.text()?)
            .map_err(|source| SentencesError::Yaml { path: path(), source })?;
        let mapping = match documents.as_slice() {
            [Yaml::Mapping(mapping)] => mapping,
            [] => return Err(SentencesError::NotMapping { path: path(), found: "empty" }),
            [other] => return Err(SentencesError::NotMapping { path: path(), found: kind(other) }),
            _ => return Err(SentencesError::NotMapping { path: path(), found: "several documents" }),
        };
        let mut by_env_id = BTreeMap::new();
        for (key, value) in mapping {
            let Some(env_id) = key.as_str() else {
                return Err(SentencesError::NotMapping { path: path(), found: "a mapping with other keys" });
            };
            let list = value.as_sequence().filter(|list| !list.is_empty()).ok_or_else(|| {
                SentencesError::NotList { path: path(), env_id: env_id.to_owned(), found: kind(value) }
            })?;
            let sentence = |(i, value): (usize, &Yaml<'_>)| match value.as_str() {
                Some(text) if (1..=INSTRUCTION_BYTES).contains(&text.len()) => Ok(text.to_owned()),
                other => Err(SentencesError::NotSentence {
                    path: path(),
                    env_id: env_id.to_owned(),
                    n: i + 1,
                    found: other.map_or_else(|| kind(value).to_owned(), |t| format!("{} bytes", t.len())),
                }),
            };
            let sentences = list.iter().enumerate().map(sentence).collect::<Result<Vec<_>, _>>()?;
            by_env_id.insert(env_id.to_owned(), sentences);
        }
        Ok(Self { path: path(), by_env_id })
    }

    /// Checks that there are sentences for a task.
    ///
    /// # Errors
    /// If there are none, with the env ids that have some.
    pub fn require(&self, task: &Task) -> Result<(), SentencesError> {
        if self.by_env_id.contains_key(task.env_id) {
            return Ok(());
        }
        let keys = self.by_env_id.keys().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(", ");
        Err(SentencesError::Missing { path: self.path.clone(), env_id: task.env_id, keys })
    }

    /// Replaces the built-in paraphrases of a task in its scene distribution, if it uses them.
    ///
    /// # Panics
    /// If it uses them and there are no sentences for the task; see [`Self::require`].
    pub fn replace(&self, task: &Task, spec: &mut SceneSpec) {
        if let Some((source @ InstructionSource::Paraphrase(_), _)) = &mut spec.instruction.replacement {
            *source = InstructionSource::Paraphrase(self.by_env_id[task.env_id].clone());
        }
    }
}

/// Returns a description of a value's type.
fn kind(value: &Yaml<'_>) -> &'static str {
    match value {
        Yaml::Mapping(_) => "a mapping",
        Yaml::Sequence(list) if list.is_empty() => "an empty list",
        Yaml::Sequence(_) => "a list",
        value if value.as_str().is_some() => "text",
        value if value.is_null() => "empty",
        _ => "a number or the like",
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::perturb::{Composition, Strength};
    use crate::{Perturbation, Profile, TaskId};

    fn read(text: &str) -> Result<Sentences, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sentences.yaml");
        std::fs::write(&path, text).unwrap();
        let shown = |error: &dyn std::error::Error| {
            ipc_types::error_chain(error).replace(&format!("{}/", folder.path().display()), "")
        };
        let file = LanguageFile::open(&path).map_err(|error| shown(&error))?;
        Sentences::read(&file).map_err(|error| shown(&error))
    }

    #[test]
    fn sentences_of_a_file_replace_paraphrases_only() {
        let task = TaskId::RaiseCube.task();
        let sentences = read(&format!("{}:\n- hoist the block\n- 'lift it: now'\n", task.env_id)).unwrap();
        sentences.require(task).unwrap();
        let instruction = |perturbation: Perturbation, seed| {
            let composition = Composition::from(perturbation);
            let mut spec = composition.spec(task, Profile::Strict, Strength::FULL);
            sentences.replace(task, &mut spec);
            spec.draw(seed).instruction
        };
        let drawn: std::collections::BTreeSet<String> =
            (0..20).map(|seed| instruction(Perturbation::LanguageParaphrase, seed)).collect();
        assert_eq!(drawn.into_iter().collect::<Vec<_>>(), ["hoist the block", "lift it: now"]);
        assert_eq!(instruction(Perturbation::None, 0), task.instruction);
        assert_eq!(instruction(Perturbation::LanguageNone, 0), "");
    }

    #[test]
    fn bad_files_are_refused_by_name() {
        let refused = |text: &str| read(text).expect_err("refused");
        assert!(refused("- a\n- b\n").contains("sentences.yaml is a list, expected a single mapping"));
        assert!(refused("").contains("is empty, expected a single mapping"));
        assert!(refused("a: text\n").contains("`a` is text, expected a list"));
        assert!(refused("a: []\n").contains("`a` is an empty list"));
        assert!(refused("a: [x, 3]\n").contains("sentence 2 of `a` is a number"));
        let long = "x".repeat(INSTRUCTION_BYTES + 1);
        assert!(refused(&format!("a: [{long}]\n")).contains("sentence 1 of `a` is"));
        assert!(refused("a: [b\n").contains("is not valid YAML: "));
        let missing = read("a: [x]\nb: [y]\n").unwrap().require(TaskId::RaiseCube.task()).unwrap_err();
        assert!(missing.to_string().ends_with("its keys are `a`, `b`"), "{missing}");
        let absent = LanguageFile::open(Path::new("/nonexistent/sentences.yaml")).unwrap_err();
        assert!(ipc_types::error_chain(&absent).contains("failed to read /nonexistent/sentences.yaml: "));
    }
}
