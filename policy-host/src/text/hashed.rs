//! A language encoder without weights: it hashes the words and word pairs of an instruction to a vector.
//!
//! It substitutes for CLIP where CLIP's weights are not available. It distinguishes instructions, and
//! instructions with common words have similar embeddings, but it does not capture meaning: a paraphrase in
//! other words is as distant as an unrelated sentence. A checkpoint must be used with the encoder it was
//! trained with; its configuration names it.

use crate::generated::{fnv1a64, sym};

/// Version of the embedding, to be increased when the embedding of any instruction changes.
pub const VERSION: u8 = 1;
/// Name of the statistic of an embedding's feature whose value, of shape `[1]`, is the encoder's [`VERSION`].
/// LeRobot copies every statistic of a dataset into the normaliser's state of a checkpoint, so that a network
/// trained by `lerobot-train` names its encoder there, as the tensor `observation.environment_state.hashed`.
pub const STATISTIC: &str = "hashed";

/// Returns the embedding `[dim] f32`, of expected norm 1: the sum of a pseudo-random vector for each word and
/// each pair of adjacent words, divided by the square root of their number. Words are runs of ASCII letters
/// and digits, in lower case; all other characters are separators. An instruction without words maps to the
/// zero vector.
#[must_use]
pub fn hashed_embedding(instruction: &str, dim: usize) -> Vec<f32> {
    let lower = instruction.to_ascii_lowercase();
    let words: Vec<&str> =
        lower.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty()).collect();
    let pairs = words.windows(2).map(|pair| fnv1a64(&pair.join(" ")));
    let streams: Vec<u64> = words.iter().map(|word| fnv1a64(word)).chain(pairs).collect();
    // A uniform variable in ±√(3/dim) has variance 1/dim.
    let bound = (3.0 / (dim * streams.len().max(1)) as f32).sqrt();
    (0..dim).map(|idx| streams.iter().map(|&stream| sym(stream, idx, bound)).sum()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cosine(a: &str, b: &str) -> f32 {
        let [a, b] = [a, b].map(|text| hashed_embedding(text, 512));
        let dot = |x: &[f32], y: &[f32]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f32>();
        dot(&a, &b) / (dot(&a, &a) * dot(&b, &b)).sqrt()
    }

    #[test]
    fn embeddings_are_similar_when_words_are_shared() {
        let embedding = hashed_embedding("pick up the cube and raise it", 512);
        let norm = embedding.iter().map(|x| x * x).sum::<f32>().sqrt();
        assert!((norm - 1.0).abs() < 0.2, "{norm}");
        assert!(cosine("Raise the cube!", "raise  the cube") > 0.999);
        assert!(cosine("raise the red cube", "raise the cube") > 0.5);
        assert!(cosine("raise the cube", "open a drawer").abs() < 0.2);
        assert!(cosine("cube on plate", "plate on cube") < 0.9);
        assert!(hashed_embedding(" ,!", 512).iter().all(|&x| x == 0.0));
    }
}
