//! SentencePiece models of π0.5 checkpoints.

use std::sync::LazyLock;

use policy_host::models::pi05::processor::prompt;
use policy_host::text::paligemma::{PaliGemmaTokenizer, TOKENIZER_FILE};
use run_config::error_chain;

use super::edits::Edits;
use super::{refused, repository};

static MODEL: LazyLock<Vec<u8>> = LazyLock::new(|| {
    std::fs::read(repository("policy-host/tests/data/pi05/robot").join(TOKENIZER_FILE)).unwrap()
});
/// Entries of the embedding of the network to which [`MODEL`] belongs.
const VOCABULARY: usize = 512;
const MAX_TOKENS: usize = 200;

/// Loads a model and splits a prompt.
///
/// # Panics
/// If an error is unclear, or a token is not in the vocabulary.
pub fn run(data: &[u8]) -> bool {
    let mut edits = Edits::new(data);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(TOKENIZER_FILE);
    let instruction = edits.text("lift the cube");
    let mut model = MODEL.clone();
    edits.bytes(&mut model);
    std::fs::write(&path, model).unwrap();
    let tokenizer = match PaliGemmaTokenizer::load(folder.path(), VOCABULARY, MAX_TOKENS) {
        Ok(tokenizer) => tokenizer,
        Err(error) => return refused(&error_chain(&error), &path),
    };
    match tokenizer.tokens(&prompt(&instruction, &[0.5, f32::NAN, -3.0])) {
        Ok(tokens) => {
            assert!((1..=MAX_TOKENS).contains(&tokens.len()));
            assert!(tokens.iter().all(|token| (*token as usize) < VOCABULARY), "{tokens:?}");
            true
        }
        Err(error) => refused(&error_chain(&error), &path),
    }
}
