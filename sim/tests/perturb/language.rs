//! Language instructions under the language perturbations.

use std::collections::{BTreeMap, BTreeSet};

use ipc_types::layout::INSTRUCTION_BYTES;
use sim::{Perturbation, TaskId};

use crate::common::{perturbed, seeds};

const N_PARAPHRASES: usize = 20;

fn instructions(task: TaskId, perturbation: Perturbation, n: u32) -> Vec<String> {
    let spec = perturbed(task, perturbation);
    seeds(task, n).map(|seed| spec.draw(seed).instruction).collect()
}

#[test]
fn every_task_has_twenty_distinct_paraphrases() {
    let mut all = BTreeSet::new();
    for task in TaskId::ALL {
        let sentences: Vec<&str> = task.task().paraphrases.lines().collect();
        assert_eq!(sentences.len(), N_PARAPHRASES, "{}", task.name());
        for sentence in sentences {
            let words = sentence.split_whitespace().count();
            assert!((3..=30).contains(&words), "{}: {sentence}", task.name());
            assert_eq!(sentence, sentence.trim(), "{}", task.name());
            assert_eq!(sentence, sentence.to_lowercase(), "{}: paraphrases are lower case", task.name());
            assert!(sentence.len() <= INSTRUCTION_BYTES);
            assert_ne!(sentence, task.task().instruction, "{}", task.name());
            assert!(all.insert(sentence), "{}: `{sentence}` occurs twice", task.name());
        }
    }
}

#[test]
fn every_paraphrase_of_the_task_occurs() {
    for &task in TaskId::ALL {
        let mut counts: BTreeMap<String, u32> = BTreeMap::new();
        for sentence in instructions(task, Perturbation::LanguageParaphrase, 1000) {
            *counts.entry(sentence).or_default() += 1;
        }
        let own: BTreeSet<&str> = task.task().paraphrases.lines().collect();
        assert_eq!(counts.keys().map(String::as_str).collect::<BTreeSet<_>>(), own, "{}", task.name());
        assert!(counts.values().all(|count| (20..=90).contains(count)), "{}: {counts:?}", task.name());
    }
}

#[test]
fn instruction_is_empty_under_language_none() {
    for &task in TaskId::ALL {
        assert_eq!(instructions(task, Perturbation::LanguageNone, 5), [""; 5], "{}", task.name());
    }
}

#[test]
fn random_sentences_have_five_to_twelve_words() {
    let sentences = instructions(TaskId::RaiseCube, Perturbation::LanguageRandom, 2000);
    let mut lengths = BTreeMap::new();
    let mut words = BTreeSet::new();
    for sentence in &sentences {
        assert!(sentence.len() <= INSTRUCTION_BYTES);
        *lengths.entry(sentence.split(' ').count()).or_insert(0) += 1;
        words.extend(sentence.split(' '));
    }
    assert_eq!(lengths.keys().copied().collect::<Vec<usize>>(), (5..=12).collect::<Vec<_>>());
    assert!(lengths.values().all(|n| (180..=320).contains(n)), "{lengths:?}");
    assert!(words.len() > 1400, "{} distinct words occur", words.len());
    assert!(
        words.iter().all(|word| word.bytes().all(|b| b.is_ascii_lowercase())),
        "the vocabulary has only letters"
    );
    assert_eq!(sentences.iter().collect::<BTreeSet<_>>().len(), sentences.len());
}

#[test]
fn other_task_instructions_share_the_morphology() {
    for &task in TaskId::ALL {
        let of_morphology = TaskId::ALL.iter().filter(|id| id.task().morphology == task.task().morphology);
        let mut others: BTreeSet<&str> = of_morphology.map(|id| id.task().instruction).collect();
        others.remove(task.task().instruction);
        let drawn = instructions(task, Perturbation::LanguageOtherTask, 500);
        let drawn: BTreeSet<&str> = drawn.iter().map(String::as_str).collect();
        assert_eq!(drawn, others, "{}", task.name());
    }
}

#[test]
fn instruction_is_drawn_per_episode() {
    let sentences = |perturbation| instructions(TaskId::RaiseCube, perturbation, 50);
    assert_eq!(
        sentences(Perturbation::LanguageParaphrase),
        sentences(Perturbation::All),
        "All uses the stream of Language-Paraphrase"
    );
    let sentences = sentences(Perturbation::LanguageParaphrase);
    assert!(sentences.iter().collect::<BTreeSet<_>>().len() > 10, "episodes share their instruction");
}
