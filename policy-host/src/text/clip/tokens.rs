//! CLIP's tokenizer: OpenAI's byte-pair vocabulary.

use instant_clip_tokenizer::{Token, Tokenizer};

/// Maximum number of tokens of a text, start and end markers included.
pub const MAX_TOKENS: usize = 77;
/// Size of the vocabulary, start and end markers included.
pub const VOCABULARY: usize = 49408;

/// CLIP's tokenizer with its vocabulary loaded.
pub struct ClipTokenizer {
    inner: Tokenizer,
}

impl ClipTokenizer {
    /// Loads the vocabulary, which takes a few milliseconds.
    #[must_use]
    #[expect(clippy::new_without_default, reason = "construction is expensive and must be explicit")]
    pub fn new() -> Self {
        Self { inner: Tokenizer::new() }
    }

    /// Returns the token ids of a text including the start and end markers. A longer text is truncated to
    /// [`MAX_TOKENS`] by dropping tokens before the end marker.
    ///
    /// The original tokenizer also repairs mis-decoded text, resolves HTML entities and composes accents.
    /// This one only replaces typographic quotation marks.
    #[must_use]
    pub fn encode(&self, text: &str) -> Vec<u16> {
        let (start, end) = (self.inner.start_of_text(), self.inner.end_of_text());
        let mut tokens = vec![start];
        self.inner.encode(&text.chars().map(ascii_quote).collect::<String>(), &mut tokens);
        let n_before_end = tokens.iter().position(|&token| token == end).unwrap_or(tokens.len());
        tokens.truncate(n_before_end.min(MAX_TOKENS - 1));
        tokens.push(end);
        tokens.into_iter().map(Token::to_u16).collect()
    }
}

impl std::fmt::Debug for ClipTokenizer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ClipTokenizer").finish_non_exhaustive()
    }
}

/// Replaces a typographic quotation mark by its ASCII equivalent.
fn ascii_quote(c: char) -> char {
    match c {
        '\u{2bc}' | '\u{2018}'..='\u{201b}' => '\'',
        '\u{201c}'..='\u{201f}' => '"',
        _ => c,
    }
}
