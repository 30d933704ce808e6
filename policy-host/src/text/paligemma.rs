//! PaliGemma's vocabulary, in SentencePiece's or Hugging Face's format: from a text to numbers of tokens.

use std::path::{Path, PathBuf};

use run_config::input;
use sentencepiece_rs::SentencePieceProcessor;
use thiserror::Error;
use tokenizers::Tokenizer;

/// File name of the SentencePiece model in a checkpoint folder.
pub const TOKENIZER_FILE: &str = "tokenizer.model";
/// File name of the vocabulary in Hugging Face's format, read if there is no SentencePiece model.
pub const TOKENIZER_JSON: &str = "tokenizer.json";
/// Number and text of the token that starts a text.
const START: u32 = 2;
const START_TEXT: &str = "<bos>";
/// Maximum size of a vocabulary; PaliGemma's SentencePiece model has 4 MB, its `tokenizer.json` 33 MB.
const MAX_TOKENIZER_BYTES: u64 = 64 << 20;

/// Errors that can occur while loading the vocabulary.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum TokenizerError {
    #[error(
        "{} is missing: the checkpoint needs PaliGemma's vocabulary, which LeRobot and openpi load from elsewhere; copy \
         its SentencePiece model there under this name, or its {TOKENIZER_JSON}",
        path.display()
    )]
    Absent { path: PathBuf },
    #[error("failed to read {}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{} has {found} bytes, expected a vocabulary of at most {limit}", path.display())]
    Size { path: PathBuf, found: u64, limit: u64 },
    #[error("{} is not a vocabulary of its format: {reason}", path.display())]
    Invalid { path: PathBuf, reason: String },
    #[error("{} has {found} pieces, the network's embedding has {expected} entries", path.display())]
    Vocabulary { path: PathBuf, found: usize, expected: usize },
}

/// A vocabulary in one of its two formats.
#[derive(Debug)]
enum Vocabulary {
    SentencePiece(Box<SentencePieceProcessor>),
    Json(Box<Tokenizer>),
}

/// Splits prompts into tokens.
#[derive(Debug)]
pub struct PaliGemmaTokenizer {
    vocabulary: Vocabulary,
    max_tokens: usize,
}

impl PaliGemmaTokenizer {
    /// Loads the vocabulary in a checkpoint folder, for an embedding with `vocabulary` entries and prompts of
    /// up to `max_tokens` tokens.
    ///
    /// # Errors
    /// If the file is absent or damaged, or does not fit the embedding.
    pub fn load(folder: &Path, vocabulary: usize, max_tokens: usize) -> Result<Self, TokenizerError> {
        let paths = [TOKENIZER_FILE, TOKENIZER_JSON].map(|name| folder.join(name));
        let Some(path) = paths.iter().find(|path| path.is_file()) else {
            return Err(TokenizerError::Absent { path: folder.join(TOKENIZER_FILE) });
        };
        let read = |source| TokenizerError::Read { path: path.clone(), source };
        let found = std::fs::metadata(path).map_err(read)?.len();
        if found > MAX_TOKENIZER_BYTES {
            return Err(TokenizerError::Size { path: path.clone(), found, limit: MAX_TOKENIZER_BYTES });
        }
        let bytes = input::read(path).map_err(read)?;
        let invalid = |reason: String| TokenizerError::Invalid { path: path.clone(), reason };
        let parse = if *path == paths[0] { Vocabulary::sentence_piece } else { Vocabulary::json };
        let own = parse(&bytes).map_err(invalid)?;
        let found = own.size();
        if found > vocabulary {
            return Err(TokenizerError::Vocabulary { path: path.clone(), found, expected: vocabulary });
        }
        Ok(Self { vocabulary: own, max_tokens })
    }

    /// Returns the tokens of a prompt, starting with the one that starts a text, without padding.
    ///
    /// # Errors
    /// If the tokenizer fails on this text, which a valid model does not.
    pub fn tokens(&self, prompt: &str) -> Result<Vec<u32>, TokenizerError> {
        let mut tokens = self.all_tokens(prompt)?;
        tokens.truncate(self.max_tokens);
        Ok(tokens)
    }

    /// Returns the number of tokens of a whole prompt.
    ///
    /// # Errors
    /// As [`tokens`](Self::tokens).
    pub fn n_tokens(&self, prompt: &str) -> Result<usize, TokenizerError> {
        Ok(self.all_tokens(prompt)?.len())
    }

    fn all_tokens(&self, prompt: &str) -> Result<Vec<u32>, TokenizerError> {
        let path = PathBuf::from(TOKENIZER_FILE);
        let invalid = |reason: String| TokenizerError::Invalid { path, reason };
        let ids: Vec<u32> = match &self.vocabulary {
            Vocabulary::SentencePiece(tokenizer) => {
                let ids = tokenizer.encode_to_ids(prompt).map_err(|error| invalid(error.to_string()))?;
                ids.into_iter().map(|id| id as u32).collect()
            }
            Vocabulary::Json(tokenizer) => {
                let encoded = tokenizer.encode(prompt, false).map_err(|error| invalid(error.to_string()))?;
                encoded.get_ids().to_vec()
            }
        };
        Ok(std::iter::once(START).chain(ids).collect())
    }
}

impl Vocabulary {
    fn sentence_piece(bytes: &[u8]) -> Result<Self, String> {
        let tokenizer =
            SentencePieceProcessor::from_serialized_model(bytes).map_err(|error| error.to_string())?;
        match tokenizer.bos_id() {
            Some(start) if start == START as usize => Ok(Self::SentencePiece(Box::new(tokenizer))),
            start => Err(format!("the token that starts a text is {start:?}, expected {START}")),
        }
    }

    fn json(bytes: &[u8]) -> Result<Self, String> {
        let mut tokenizer = Tokenizer::from_bytes(bytes).map_err(|error| error.to_string())?;
        tokenizer.with_truncation(None).map_err(|error| error.to_string())?.with_padding(None);
        match tokenizer.token_to_id(START_TEXT) {
            Some(START) => Ok(Self::Json(Box::new(tokenizer))),
            start => Err(format!("the number of {START_TEXT} is {start:?}, expected {START}")),
        }
    }

    fn size(&self) -> usize {
        match self {
            Self::SentencePiece(tokenizer) => tokenizer.model().pieces().len(),
            Self::Json(tokenizer) => tokenizer.get_vocab_size(true),
        }
    }
}
