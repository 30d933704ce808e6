//! Text as CLIP reads it: pieces of words by OpenAI's byte-pair vocabulary.

use instant_clip_tokenizer::{Token, Tokenizer};

/// Most tokens of a text, marks of start and end included.
pub const MAX_TOKENS: usize = 77;
/// Words of the vocabulary, the two marks included.
pub const VOCABULARY: usize = 49408;

/// The vocabulary, ready to use.
pub struct ClipTokenizer {
    pieces: Tokenizer,
}

impl ClipTokenizer {
    /// Reads the vocabulary, which takes some milliseconds.
    #[must_use]
    #[expect(clippy::new_without_default, reason = "made on purpose: it is not cheap")]
    pub fn new() -> Self {
        Self { pieces: Tokenizer::new() }
    }

    /// The tokens of a text from the mark of its start to that of its end, at most [`MAX_TOKENS`]: of a longer text, the
    /// first pieces and the end.
    ///
    /// The original first mends text that went through a wrong encoding, resolves HTML entities and composes accents; of
    /// all that, only typographic quotation marks become plain here.
    #[must_use]
    pub fn encode(&self, text: &str) -> Vec<u16> {
        let (start, end) = (self.pieces.start_of_text(), self.pieces.end_of_text());
        let mut tokens = vec![start];
        self.pieces.encode(&text.chars().map(plain).collect::<String>(), &mut tokens);
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

/// Typographic quotation marks as the keyboard has them.
fn plain(c: char) -> char {
    match c {
        '\u{2bc}' | '\u{2018}'..='\u{201b}' => '\'',
        '\u{201c}'..='\u{201f}' => '"',
        _ => c,
    }
}
