//! Vocabularies in both of their formats, and prompts that are longer than a network reads.

use std::path::Path;

use ipc_types::Morphology;
use policy_host::models::Family;
use policy_host::nn::Precision;
use policy_host::text::paligemma::PaliGemmaTokenizer;
use policy_host::{PolicySpec, long_prompts};

use super::copy_of;
use crate::data;

/// Entries of the embedding of the test checkpoints.
const VOCABULARY: usize = 512;

fn tokens(folder: &Path, text: &str) -> Vec<u32> {
    PaliGemmaTokenizer::load(folder, VOCABULARY, 1000).unwrap().tokens(text).unwrap()
}

#[test]
fn both_formats_give_the_same_tokens() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(data("pi05/tokenizer.json"), folder.path().join("tokenizer.json")).unwrap();
    for text in ["", " x", "Task: raise the  red cube, State: 12 255 -1;\nAction: ", "Größe 立方体"] {
        assert_eq!(tokens(folder.path(), text), tokens(&data("pi05/robot"), text), "{text}");
    }
    std::fs::write(folder.path().join("tokenizer.json"), "{}").unwrap();
    let error = PaliGemmaTokenizer::load(folder.path(), VOCABULARY, 10).unwrap_err().to_string();
    assert!(error.contains("tokenizer.json") && error.lines().count() == 1, "{error}");
}

#[test]
fn prompts_that_are_cut_off_are_counted() {
    let folder = copy_of("robot");
    let spec = PolicySpec::network(Family::Pi05, Precision::F32, folder.path());
    let instruction = |text: &str| (Morphology::Single, text.to_owned());
    let short = [instruction("raise the cube"), (Morphology::Bimanual, "x".repeat(500))];
    assert_eq!(long_prompts(&spec, &short).unwrap(), [""; 0]);
    let long = [instruction("raise the cube"), instruction(&"x".repeat(300))];
    let notes = long_prompts(&spec, &long).unwrap();
    assert_eq!(notes.len(), 1);
    assert!(notes[0].starts_with("1 of 2 instructions") && notes[0].contains("reads 160"), "{notes:?}");
}
