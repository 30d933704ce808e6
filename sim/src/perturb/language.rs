//! The sentences of a run: those that stand for the tasks, and paraphrases from a file in place of the
//! built-in ones.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::PathBuf;

use ipc_types::layout::INSTRUCTION_BYTES;
use run_config::{Instructions, LanguageFile, LanguageFileError};
use saphyr::{LoadableYamlNode, Yaml};
use thiserror::Error;

use crate::task::Task;
use crate::task::profile::{Profile, ProfileRules};
use crate::tasks::TaskId;
use scene::{InstructionSource, SceneSpec};

/// The sentences of a run, as its options choose them.
#[derive(Clone, Debug, Default)]
pub struct Language {
    training: TrainingSentences,
    paraphrases: Option<Sentences>,
}

/// The sentence that stands for each task.
#[derive(Clone, Debug, Default)]
enum TrainingSentences {
    #[default]
    Act,
    Lerobot,
    File(Sentences),
}

/// Sentences of a file, per env id.
#[derive(Clone, Debug)]
struct Sentences {
    path: PathBuf,
    by_env_id: BTreeMap<String, Vec<String>>,
}

/// Form of an entry in a file of sentences.
#[derive(Clone, Copy, Debug, PartialEq)]
enum SentenceForm {
    /// A list of sentences.
    List,
    /// A single sentence.
    Single,
}

/// Errors that can occur while reading sentences.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the variants")]
pub enum SentencesError {
    #[error(transparent)]
    File(#[from] LanguageFileError),
    #[error("{} is not valid YAML", path.display())]
    Yaml { path: PathBuf, source: saphyr::ScanError },
    #[error("{} is {found}, expected a single mapping from env ids to {expected}", path.display())]
    NotMapping { path: PathBuf, expected: &'static str, found: &'static str },
    #[error("{}: `{env_id}` is {found}, expected {expected}", path.display())]
    NotSentences { path: PathBuf, env_id: String, expected: &'static str, found: &'static str },
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

impl Language {
    /// Reads the files that the options name, and checks them: the sentences of the tasks, and paraphrases.
    ///
    /// # Errors
    /// The first thing that is not as expected.
    pub fn read(
        instructions: &Instructions,
        paraphrases: Option<&LanguageFile>,
    ) -> Result<Self, SentencesError> {
        let training = match instructions {
            Instructions::Act => TrainingSentences::Act,
            Instructions::Lerobot => TrainingSentences::Lerobot,
            Instructions::File(file) => TrainingSentences::File(Sentences::read(file, SentenceForm::Single)?),
        };
        let paraphrases = paraphrases.map(|file| Sentences::read(file, SentenceForm::List));
        Ok(Self { training, paraphrases: paraphrases.transpose()? })
    }

    /// Checks that there are sentences for a task.
    ///
    /// # Errors
    /// If there are none, with the env ids that have some, or if all paraphrases are the training sentence,
    /// which the profile may not repeat.
    pub fn require(&self, task: &Task, profile: Profile) -> Result<(), SentencesError> {
        if let TrainingSentences::File(sentences) = &self.training {
            sentences.require(task)?;
        }
        let Some(sentences) = &self.paraphrases else { return Ok(()) };
        sentences.require(task)?;
        match self.paraphrases(sentences, task, profile).next() {
            Some(_) => Ok(()),
            None => Err(SentencesError::NoParaphrase { path: sentences.path.clone(), env_id: task.env_id }),
        }
    }

    /// Replaces the sentences in a task's scene distribution by those of the run.
    ///
    /// # Panics
    /// If a file has no sentences for the task; see [`Self::require`].
    pub fn apply(&self, task: &Task, profile: Profile, spec: &mut SceneSpec) {
        let training = self.training_sentence(task).expect("the task has a sentence").to_owned();
        match &mut spec.instruction.replacement {
            Some((InstructionSource::Paraphrase(paraphrases), _)) => {
                if let Some(sentences) = &self.paraphrases {
                    *paraphrases = self.paraphrases(sentences, task, profile).cloned().collect();
                }
            }
            Some((InstructionSource::OtherTask(sentences), _)) => {
                *sentences = self.sentences_of_other_tasks(task);
            }
            Some((InstructionSource::Empty | InstructionSource::RandomWords, _)) | None => {}
        }
        spec.instruction.training = Cow::Owned(training);
    }

    /// Returns the sentence that stands for a task, if the file has one.
    fn training_sentence<'a>(&'a self, task: &Task) -> Option<&'a str> {
        match &self.training {
            TrainingSentences::Act => Some(task.instruction),
            TrainingSentences::Lerobot => Some(task.lerobot_instruction),
            TrainingSentences::File(sentences) => Some(&sentences.by_env_id.get(task.env_id)?[0]),
        }
    }

    /// Returns the distinct sentences of the other tasks of the same morphology.
    pub(crate) fn sentences_of_other_tasks(&self, task: &Task) -> Vec<String> {
        let own = self.training_sentence(task);
        let mut sentences: Vec<String> = Vec::new();
        for other in TaskId::ALL.iter().map(|id| id.task()) {
            let sentence = self.training_sentence(other).filter(|_| other.morphology == task.morphology);
            if let Some(sentence) = sentence
                && Some(sentence) != own
                && !sentences.iter().any(|known| known == sentence)
            {
                sentences.push(sentence.to_owned());
            }
        }
        sentences
    }

    /// Iterates over the paraphrases of a task that may replace its training sentence.
    fn paraphrases<'a>(
        &self,
        sentences: &'a Sentences,
        task: &Task,
        profile: Profile,
    ) -> impl Iterator<Item = &'a String> {
        let own = self.training_sentence(task).map(str::to_owned);
        let is_allowed = move |text: &&String| {
            profile.repeats_training_sentence() || Some(text.as_str()) != own.as_deref()
        };
        sentences.by_env_id[task.env_id].iter().filter(is_allowed)
    }
}

impl SentenceForm {
    fn name(self) -> &'static str {
        match self {
            Self::List => "a list of sentences",
            Self::Single => "a sentence",
        }
    }
}

impl Sentences {
    /// Reads and checks a file.
    fn read(file: &LanguageFile, form: SentenceForm) -> Result<Self, SentencesError> {
        let path = || file.path().to_path_buf();
        let not_mapping = |found| SentencesError::NotMapping { path: path(), expected: form.name(), found };
        let documents = Yaml::load_from_str(&file.text()?)
            .map_err(|source| SentencesError::Yaml { path: path(), source })?;
        let mapping = match documents.as_slice() {
            [Yaml::Mapping(mapping)] => mapping,
            [] => return Err(not_mapping("empty")),
            [other] => return Err(not_mapping(kind(other))),
            _ => return Err(not_mapping("several documents")),
        };
        let mut by_env_id = BTreeMap::new();
        for (key, value) in mapping {
            let env_id = key.as_str().ok_or_else(|| not_mapping("a mapping with other keys"))?;
            let values = match form {
                SentenceForm::List => value.as_sequence().map(Vec::as_slice),
                SentenceForm::Single => value.as_str().map(|_| std::slice::from_ref(value)),
            };
            let values = values.filter(|values| !values.is_empty()).ok_or_else(|| {
                let (env_id, expected) = (env_id.to_owned(), form.name());
                SentencesError::NotSentences { path: path(), env_id, expected, found: kind(value) }
            })?;
            let sentence = |(i, value): (usize, &Yaml<'_>)| {
                sentence(value).map_err(|found| SentencesError::NotSentence {
                    path: path(),
                    env_id: env_id.to_owned(),
                    n: i + 1,
                    found,
                })
            };
            let sentences = values.iter().enumerate().map(sentence).collect::<Result<Vec<_>, _>>()?;
            by_env_id.insert(env_id.to_owned(), sentences);
        }
        Ok(Self { path: path(), by_env_id })
    }

    fn require(&self, task: &Task) -> Result<(), SentencesError> {
        if self.by_env_id.contains_key(task.env_id) {
            return Ok(());
        }
        let keys = self.by_env_id.keys().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(", ");
        Err(SentencesError::Missing { path: self.path.clone(), env_id: task.env_id, keys })
    }
}

/// Returns a sentence, or a description of what is there instead.
fn sentence(value: &Yaml<'_>) -> Result<String, String> {
    match value.as_str() {
        Some(text) if text.len() <= INSTRUCTION_BYTES && !text.trim().is_empty() => Ok(text.to_owned()),
        Some(text) if text.trim().is_empty() && !text.is_empty() => Err("blank".to_owned()),
        Some(text) => Err(format!("{} bytes", text.len())),
        None => Err(kind(value).to_owned()),
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

    /// Reads paraphrases.
    fn read(text: &str) -> Result<Language, String> {
        read_as(text, |file| Language::read(&Instructions::Act, Some(&file)))
    }

    /// Reads training sentences.
    fn read_training(text: &str) -> Result<Language, String> {
        read_as(text, |file| Language::read(&Instructions::File(file), None))
    }

    fn read_as(
        text: &str,
        read: fn(LanguageFile) -> Result<Language, SentencesError>,
    ) -> Result<Language, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sentences.yaml");
        std::fs::write(&path, text).unwrap();
        let shown = |error: &dyn std::error::Error| {
            run_config::error_chain(error).replace(&format!("{}/", folder.path().display()), "")
        };
        let file = LanguageFile::open(&path).map_err(|error| shown(&error))?;
        read(file).map_err(|error| shown(&error))
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
    fn draw(sentences: &Language, profile: Profile, perturbation: Perturbation, seed: u64) -> String {
        let task = TaskId::RaiseCube.task();
        sentences.require(task, profile).unwrap();
        let mut spec = Composition::from(perturbation).spec(task, profile, Strength::FULL);
        sentences.apply(task, profile, &mut spec);
        spec.draw(seed).instruction
    }

    #[test]
    fn training_sentences_are_the_protocols_or_a_files() {
        let lerobot = Language::read(&Instructions::Lerobot, None).unwrap();
        let task = TaskId::RaiseCube.task();
        let drawn =
            |language: &Language, perturbation, seed| draw(language, Profile::Strict, perturbation, seed);
        assert_eq!(drawn(&lerobot, Perturbation::None, 0), "Raise the cube up from the table");
        let others = (0..50).map(|seed| drawn(&lerobot, Perturbation::LanguageOtherTask, seed));
        for other in others {
            let of_other = |id: &&TaskId| id.task().lerobot_instruction == other;
            let id = TaskId::ALL.iter().find(of_other).expect("a sentence of the same protocol");
            assert!(*id != TaskId::RaiseCube && id.task().morphology == task.morphology, "{other}");
        }
        let own = read_training(&format!("{}: hoist it\nOther-v1: drop it\n", task.env_id)).unwrap();
        assert_eq!(drawn(&own, Perturbation::None, 0), "hoist it");
        let refused = read_training(&format!("{}: [hoist it]\n", task.env_id)).expect_err("refused");
        assert!(refused.contains("`RaiseCube-v1` is a list, expected a sentence"), "{refused}");
        let missing = own.require(TaskId::StackCube.task(), Profile::Strict).unwrap_err();
        assert!(missing.to_string().contains("no sentences for `StackCube"), "{missing}");
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
