//! Cache of instruction tokens: each distinct instruction is encoded once.

use super::architecture::TokenProjection;
use super::leading::LeadingTokens;
use crate::text::TextEncoder;

/// Maximum number of cached instructions. The oldest entry is evicted first.
const CAPACITY: usize = 256;

/// Cache from instruction to token `[d]`.
#[derive(Debug)]
pub(crate) struct TokenCache {
    encoder: Option<TextEncoder>,
    entries: Vec<(String, Vec<f32>)>,
    /// Index of the entry to overwrite next.
    next: usize,
}

impl TokenCache {
    /// Creates an empty cache. `encoder` is `None` for a network without instruction input.
    pub(crate) fn new(encoder: Option<TextEncoder>) -> Self {
        Self { encoder, entries: Vec::new(), next: 0 }
    }

    /// Returns the token of an instruction. Returns `None` if the network has no instruction input, or if the
    /// instruction is empty and the benchmark's network omits the token (docs/benchmark.md, "Policies and
    /// evaluation").
    pub(crate) fn get(&mut self, instruction: &str, leading: &LeadingTokens) -> Option<&[f32]> {
        let input = leading.instruction_input()?;
        if instruction.is_empty() && input.projection == TokenProjection::Mlp {
            return None;
        }
        let cached = self.entries.iter().position(|(key, _)| key == instruction);
        let idx = match cached {
            Some(idx) => idx,
            None => {
                let embedding = self.encoder.as_ref()?.encode(instruction);
                self.insert((instruction.to_owned(), leading.instruction_token(&embedding)?))
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
