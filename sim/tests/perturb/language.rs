//! What policies are told.

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
fn every_task_can_be_said_in_twenty_other_ways() {
    let mut all = BTreeSet::new();
    for task in TaskId::ALL {
        let sentences: Vec<&str> = task.task().paraphrases.lines().collect();
        assert_eq!(sentences.len(), N_PARAPHRASES, "{}", task.name());
        for sentence in sentences {
            let words = sentence.split_whitespace().count();
            assert!((3..=30).contains(&words), "{}: {sentence}", task.name());
            assert_eq!(sentence, sentence.trim(), "{}", task.name());
            assert_eq!(sentence, sentence.to_lowercase(), "{}: as the training sentences are", task.name());
            assert!(sentence.len() <= INSTRUCTION_BYTES);
            assert_ne!(sentence, task.task().instruction, "{}", task.name());
            assert!(all.insert(sentence), "{}: `{sentence}` is said twice", task.name());
        }
    }
}

#[test]
fn a_paraphrase_is_one_of_the_tasks_own_and_each_comes_up() {
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
fn nothing_is_said_under_language_none() {
    for &task in TaskId::ALL {
        assert_eq!(instructions(task, Perturbation::LanguageNone, 5), [""; 5], "{}", task.name());
    }
}

#[test]
fn random_words_are_five_to_twelve_and_seldom_the_same() {
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
    assert!(words.len() > 1400, "{} words come up", words.len());
    assert!(words.iter().all(|word| word.bytes().all(|b| b.is_ascii_lowercase())), "words are words");
    assert_eq!(sentences.iter().collect::<BTreeSet<_>>().len(), sentences.len());
}

#[test]
fn another_tasks_sentence_is_of_the_same_morphology() {
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
fn an_instruction_is_its_episodes_own() {
    let sentences = |perturbation| instructions(TaskId::RaiseCube, perturbation, 50);
    assert_eq!(
        sentences(Perturbation::LanguageParaphrase),
        sentences(Perturbation::All),
        "by the same stream"
    );
    let sentences = sentences(Perturbation::LanguageParaphrase);
    assert!(sentences.iter().collect::<BTreeSet<_>>().len() > 10, "it is drawn anew in each episode");
}
