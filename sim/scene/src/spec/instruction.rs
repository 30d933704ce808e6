//! Distribution of the language instruction given to the policy.

use std::borrow::Cow;

use crate::stream::Stream;

/// Vocabulary of [`InstructionSource::RandomWords`]: common English words, separated by whitespace.
const VOCABULARY: &str = include_str!("vocabulary.txt");
/// Minimum and maximum number of words of a random sentence.
const N_WORDS: [usize; 2] = [5, 12];

/// Sources of an instruction that replaces the training instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum InstructionSource {
    /// No words.
    Empty,
    /// A uniform choice from these sentences of other tasks.
    OtherTask(Vec<String>),
    /// A uniform choice from these paraphrases of the training sentence.
    Paraphrase(Vec<String>),
    /// A sentence of 5 to 12 words, each sampled independently from the vocabulary.
    RandomWords,
}

/// Distribution of an episode's instruction.
#[derive(Clone, Debug, PartialEq)]
pub struct InstructionSpec {
    /// The sentence used in training.
    pub training: Cow<'static, str>,
    /// Source of a replacement sentence, and the probability that it replaces the training sentence.
    pub replacement: Option<(InstructionSource, f64)>,
}

impl InstructionSpec {
    /// Creates the distribution that always yields the training sentence.
    #[must_use]
    pub const fn training(training: &'static str) -> Self {
        Self { training: Cow::Borrowed(training), replacement: None }
    }

    /// Returns the sentences that may be drawn, without random ones.
    #[must_use]
    pub fn sentences(&self) -> Vec<&str> {
        let mut sentences = vec![self.training.as_ref()];
        match &self.replacement {
            Some((InstructionSource::OtherTask(others) | InstructionSource::Paraphrase(others), _)) => {
                sentences.extend(others.iter().map(String::as_str));
            }
            Some((InstructionSource::Empty, _)) => sentences.push(""),
            Some((InstructionSource::RandomWords, _)) | None => {}
        }
        sentences
    }

    /// Draws the instruction of one episode.
    #[must_use]
    pub fn draw(&self, episode_seed: u64) -> String {
        let chance = || Stream::new(episode_seed, "instruction/chance").unit();
        match &self.replacement {
            Some((source, probability)) if chance() < *probability => {
                source.draw(&mut Stream::new(episode_seed, "instruction"))
            }
            Some(_) | None => self.training.clone().into_owned(),
        }
    }
}

impl InstructionSource {
    fn draw(&self, stream: &mut Stream) -> String {
        match self {
            Self::Empty => String::new(),
            Self::OtherTask(sentences) | Self::Paraphrase(sentences) => stream.choose(sentences).clone(),
            Self::RandomWords => {
                let vocabulary: Vec<&str> = VOCABULARY.split_whitespace().collect();
                let [min, max] = N_WORDS;
                let n = min + (stream.unit() * (max - min + 1) as f64) as usize;
                let words: Vec<&str> = (0..n).map(|_| *stream.choose(&vocabulary)).collect();
                words.join(" ")
            }
        }
    }
}
