//! Instruction tokens, computed once for each distinct instruction.

use super::model::ActModel;
use crate::text::hashed_embedding;

/// Most instructions remembered; the oldest is forgotten first.
const CAPACITY: usize = 256;

/// Tokens of the instructions met so far.
#[derive(Debug, Default)]
pub(super) struct TokenCache {
    entries: Vec<(String, Vec<f32>)>,
    next: usize,
}

impl TokenCache {
    /// The token of an instruction, or `None` if the network has none for it: because it knows no language, or because
    /// the instruction is empty (spec/eval.md §1.2).
    pub(super) fn get(&mut self, instruction: &str, model: &ActModel) -> Option<&[f32]> {
        let language = model.config().language?;
        if instruction.is_empty() {
            return None;
        }
        let known = self.entries.iter().position(|(known, _)| known == instruction);
        let idx = match known {
            Some(idx) => idx,
            None => {
                let embedding = hashed_embedding(instruction, language.dim);
                self.insert((instruction.to_owned(), model.language_token(&embedding)?))
            }
        };
        Some(&self.entries[idx].1)
    }

    fn insert(&mut self, entry: (String, Vec<f32>)) -> usize {
        let idx = self.next;
        self.next = (idx + 1) % CAPACITY;
        if idx < self.entries.len() {
            self.entries[idx] = entry;
        } else {
            self.entries.push(entry);
        }
        idx
    }
}
