//! Instruction tokens, computed once for each distinct instruction.

use super::architecture::Projection;
use super::model::ActModel;
use crate::text::TextEncoder;

/// Most instructions remembered; the oldest is forgotten first.
const CAPACITY: usize = 256;

/// Tokens of the instructions met so far.
#[derive(Debug)]
pub(super) struct TokenCache {
    encoder: Option<TextEncoder>,
    entries: Vec<(String, Vec<f32>)>,
    next: usize,
}

impl TokenCache {
    /// For a network trained with this encoder's embeddings, if it sees instructions.
    pub(super) fn new(encoder: Option<TextEncoder>) -> Self {
        Self { encoder, entries: Vec::new(), next: 0 }
    }

    /// The token of an instruction, or `None` if the network has none for it: because it sees no instructions, or because
    /// the instruction is empty and the benchmark's network omits it (spec/eval.md §1.2).
    pub(super) fn get(&mut self, instruction: &str, model: &ActModel) -> Option<&[f32]> {
        let input = model.architecture().instruction?;
        if instruction.is_empty() && input.projection == Projection::Mlp {
            return None;
        }
        let known = self.entries.iter().position(|(known, _)| known == instruction);
        let idx = match known {
            Some(idx) => idx,
            None => {
                let embedding = self.encoder.as_ref()?.encode(instruction);
                self.insert((instruction.to_owned(), model.instruction_token(&embedding)?))
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
