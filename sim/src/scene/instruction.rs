//! What the policy is told.

use crate::stream::Stream;

/// Common English words, as many to a line as fit.
const WORDS: &str = include_str!("words.txt");
/// Fewest and most words of a sentence without sense.
const N_WORDS: [usize; 2] = [5, 12];

/// How another sentence is made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wording {
    /// One of these, with equal chances.
    OneOf(Vec<&'static str>),
    /// Five to twelve common English words, each drawn from all of them.
    RandomWords,
}

/// The distribution of an episode's instruction.
#[derive(Clone, Debug, PartialEq)]
pub struct InstructionSpec {
    /// The sentence policies are trained with.
    pub training: &'static str,
    /// Another sentence, and the chance that it takes the place of the training sentence.
    pub other: Option<(Wording, f64)>,
}

impl InstructionSpec {
    /// The training sentence alone.
    #[must_use]
    pub const fn training(training: &'static str) -> Self {
        Self { training, other: None }
    }

    /// The instruction of one episode.
    pub(super) fn draw(&self, episode_seed: u64) -> String {
        let chance = || Stream::new(episode_seed, "instruction/chance").unit();
        match &self.other {
            Some((wording, share)) if chance() < *share => {
                wording.draw(&mut Stream::new(episode_seed, "instruction"))
            }
            Some(_) | None => self.training.to_owned(),
        }
    }
}

impl Wording {
    fn draw(&self, stream: &mut Stream) -> String {
        match self {
            Self::OneOf(sentences) => (*stream.choose(sentences)).to_owned(),
            Self::RandomWords => {
                let words: Vec<&str> = WORDS.split_whitespace().collect();
                let [least, most] = N_WORDS;
                let n = least + (stream.unit() * (most - least + 1) as f64) as usize;
                let drawn: Vec<&str> = (0..n).map(|_| *stream.choose(&words)).collect();
                drawn.join(" ")
            }
        }
    }
}
