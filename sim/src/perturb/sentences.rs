//! Paraphrases read from a file, in place of the built-in ones.

use std::collections::BTreeMap;
use std::path::PathBuf;

use ipc_types::layout::INSTRUCTION_BYTES;
use run_config::{LanguageFile, LanguageFileError};
use saphyr::{LoadableYamlNode, Yaml};
use thiserror::Error;

use crate::task::Task;
use crate::task::profile::{Profile, ProfileRules};
use scene::{InstructionSource, SceneSpec};

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
        "{}: sentence {n} of `{env_id}` is {found}, expected text of 1 to {INSTRUCTION_BYTES} bytes, not only of blanks",
        path.display()
    )]
    NotSentence { path: PathBuf, env_id: String, n: usize, found: String },
    #[error(
        "{}: all sentences of `{env_id}` are the training sentence; add others, or use --profile paper",
        path.display()
    )]
    NoParaphrase { path: PathBuf, env_id: &'static str },
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
                Some(text) if text.len() <= INSTRUCTION_BYTES && !text.trim().is_empty() => {
                    Ok(text.to_owned())
                }
                other => Err(SentencesError::NotSentence {
                    path: path(),
                    env_id: env_id.to_owned(),
                    n: i + 1,
                    found: match other {
                        Some(text) if text.trim().is_empty() && !text.is_empty() => "blank".to_owned(),
                        Some(text) => format!("{} bytes", text.len()),
                        None => kind(value).to_owned(),
                    },
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
    /// If there are none, with the env ids that have some, or if all are the training sentence, which the
    /// profile may not repeat.
    pub fn require(&self, task: &Task, profile: Profile) -> Result<(), SentencesError> {
        if self.by_env_id.contains_key(task.env_id) {
            return if self.paraphrases(task, profile).next().is_some() {
                Ok(())
            } else {
                Err(SentencesError::NoParaphrase { path: self.path.clone(), env_id: task.env_id })
            };
        }
        let keys = self.by_env_id.keys().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(", ");
        Err(SentencesError::Missing { path: self.path.clone(), env_id: task.env_id, keys })
    }

    /// Replaces the built-in paraphrases of a task in its scene distribution, if it uses them.
    ///
    /// # Panics
    /// If it uses them and there are no sentences for the task; see [`Self::require`].
    pub fn replace(&self, task: &Task, profile: Profile, spec: &mut SceneSpec) {
        if let Some((source @ InstructionSource::Paraphrase(_), _)) = &mut spec.instruction.replacement {
            *source = InstructionSource::Paraphrase(self.paraphrases(task, profile).cloned().collect());
        }
    }

    /// Iterates over the sentences of a task that may replace its training sentence.
    fn paraphrases(&self, task: &Task, profile: Profile) -> impl Iterator<Item = &String> {
        let is_allowed =
            move |text: &&String| profile.repeats_training_sentence() || *text != task.instruction;
        self.by_env_id[task.env_id].iter().filter(is_allowed)
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
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;
    use crate::perturb::{Composition, Strength};
    use crate::{Perturbation, TaskId};

    fn read(text: &str) -> Result<Sentences, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sentences.yaml");
        std::fs::write(&path, text).unwrap();
        let shown = |error: &dyn std::error::Error| {
            run_config::error_chain(error).replace(&format!("{}/", folder.path().display()), "")
        };
        let file = LanguageFile::open(&path).map_err(|error| shown(&error))?;
        Sentences::read(&file).map_err(|error| shown(&error))
    }

    #[test]
    fn sentences_of_a_file_replace_paraphrases_only() {
        let task = TaskId::RaiseCube.task();
        let sentences = read(&format!("{}:\n- hoist the block\n- 'lift it: now'\n", task.env_id)).unwrap();
        let instruction = |perturbation, seed| draw(&sentences, Profile::Strict, perturbation, seed);
        let drawn: BTreeSet<String> =
            (0..20).map(|seed| instruction(Perturbation::LanguageParaphrase, seed)).collect();
        assert_eq!(drawn.into_iter().collect::<Vec<_>>(), ["hoist the block", "lift it: now"]);
        assert_eq!(instruction(Perturbation::None, 0), task.instruction);
        assert_eq!(instruction(Perturbation::LanguageNone, 0), "");
    }

    /// Draws an instruction of RaiseCube.
    fn draw(sentences: &Sentences, profile: Profile, perturbation: Perturbation, seed: u64) -> String {
        let task = TaskId::RaiseCube.task();
        sentences.require(task, profile).unwrap();
        let mut spec = Composition::from(perturbation).spec(task, profile, Strength::FULL);
        sentences.replace(task, profile, &mut spec);
        spec.draw(seed).instruction
    }

    #[test]
    fn only_paper_profile_draws_the_training_sentence() {
        let task = TaskId::RaiseCube.task();
        let own = task.instruction;
        let sentences = read(&format!("{}:\n- {own}\n- hoist the block\n", task.env_id)).unwrap();
        let drawn = |profile| -> BTreeSet<String> {
            let paraphrase = Perturbation::LanguageParaphrase;
            (0..20).map(|seed| draw(&sentences, profile, paraphrase, seed)).collect()
        };
        assert_eq!(drawn(Profile::Strict), BTreeSet::from(["hoist the block".to_owned()]));
        assert_eq!(drawn(Profile::Paper), ["hoist the block", own].map(str::to_owned).into());
        let nothing_else = read(&format!("{}: [{own}]\n", task.env_id)).unwrap();
        assert!(nothing_else.require(task, Profile::Paper).is_ok());
        let error = nothing_else.require(task, Profile::Strict).unwrap_err().to_string();
        assert!(error.contains("all sentences of `RaiseCube-v1` are the training sentence"), "{error}");
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
        let missing =
            read("a: [x]\nb: [y]\n").unwrap().require(TaskId::RaiseCube.task(), Profile::Strict).unwrap_err();
        assert!(missing.to_string().ends_with("its keys are `a`, `b`"), "{missing}");
        let absent = LanguageFile::open(Path::new("/nonexistent/sentences.yaml")).unwrap_err();
        assert!(run_config::error_chain(&absent).contains("failed to read /nonexistent/sentences.yaml: "));
    }
}
