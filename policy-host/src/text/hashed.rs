//! A language encoder without weights: an instruction becomes a vector by hashing its words and word pairs.
//!
//! It stands where the benchmark has CLIP, whose weights are not shipped here. It tells instructions apart and keeps
//! those that share words close, but knows nothing of meaning: a paraphrase with other words is as far away as any other
//! sentence. A checkpoint must be used with the encoder it was trained with; its configuration says which.

use crate::generated::{fnv1a64, sym};

/// `[dim] f32` of expected length 1: the sum of a pseudo-random vector for every word and every pair of neighbouring
/// words, divided by the root of their number. Words are runs of ASCII letters and digits, in lower case; other
/// characters only separate. An instruction without a word is the zero vector.
#[must_use]
pub fn hashed_embedding(instruction: &str, dim: usize) -> Vec<f32> {
    let lower = instruction.to_ascii_lowercase();
    let words: Vec<&str> =
        lower.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty()).collect();
    let pairs = words.windows(2).map(|pair| fnv1a64(&pair.join(" ")));
    let streams: Vec<u64> = words.iter().map(|word| fnv1a64(word)).chain(pairs).collect();
    // A uniform number in ±√(3/dim) has variance 1/dim.
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
    fn length_is_about_one_and_shared_words_are_close() {
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
