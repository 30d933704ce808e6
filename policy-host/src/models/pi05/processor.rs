//! Conversion of observations to the input of a π0.5 network, and of its output to actions.

use std::collections::HashMap;
use std::fmt::Write;

use ipc_types::{ImageSize, ObservationView};
use rayon::prelude::*;
use xxhash_rust::xxh3::xxh3_64;

use super::checkpoint::Pi05Description;
use super::image::resize_with_pad;
use super::model::{Pi05Input, SampleTokens, draw_noise};
use crate::formats::mapping::PromptState;
use crate::nn::Precision;
use crate::policy::{ActionChunk, PolicyError};
use crate::text::paligemma::{PaliGemmaTokenizer, TokenizerError};

/// Bins into which an entry of the state is discretised, over [−1, 1].
const N_BINS: usize = 256;
/// Tokens of a typical prompt, for an estimate of the time that a query takes.
const TYPICAL_PROMPT: usize = 60;

/// Maps observations to the input of a network, and its output to actions.
#[derive(Debug)]
pub(crate) struct Pi05Processor {
    pub(crate) tokenizer: PaliGemmaTokenizer,
    pub(crate) description: Pi05Description,
    /// Number of Euler steps from noise to actions.
    pub(crate) n_steps: usize,
}

/// Input of a network for some envs of an observation.
#[derive(Debug)]
pub(crate) struct Pi05Batch {
    /// Distinct images `[n, 3, side, side]`.
    images: Vec<f32>,
    samples: Vec<SampleTokens>,
    /// Noise `[n, horizon, action_width]`.
    pub(crate) noise: Vec<f32>,
}

/// The distinct images of a batch, found by content: an image that several envs see is encoded once.
#[derive(Debug, Default)]
struct DistinctImages<'a> {
    images: Vec<(&'a [u8], ImageSize)>,
    by_hash: HashMap<u64, Vec<usize>>,
}

impl Pi05Processor {
    /// Returns the floating-point operations of a query with a prompt of typical length.
    pub(crate) fn flop_per_query(&self) -> u64 {
        let Pi05Description { architecture, mapping, .. } = &self.description;
        architecture.flop_per_query(mapping.cameras.len(), TYPICAL_PROMPT, self.n_steps)
    }

    /// Returns what the network is.
    pub(crate) fn startup_message(&self, precision: Precision) -> String {
        let Pi05Description { architecture, mapping, prompt_state, .. } = &self.description;
        let n_steps = self.n_steps;
        let n_weights = architecture.n_weights();
        let weights = match precision {
            Precision::F32 => "weights as stored",
            Precision::Int8 => "8-bit weights",
        };
        let convention = match prompt_state {
            PromptState::Unpadded => "unpadded",
            PromptState::Padded => "padded",
        };
        format!(
            "π0.5 for {} tasks, {:.1} million {weights}, {n_steps} denoising steps, state {convention} in the prompt",
            mapping.morphology.name(),
            n_weights as f64 / 1e6,
        )
    }

    /// Returns the tokens of each env's prompt.
    pub(crate) fn prompts(&self, observation: &ObservationView<'_>) -> Result<Vec<Vec<u32>>, PolicyError> {
        let envs = (0..observation.n_envs()).map(|env_idx| observation.env(env_idx));
        envs.map(|env| self.prompt(env.instruction, env.state)).collect()
    }

    /// Prepares the envs starting at `first_env`, which have these prompts.
    pub(crate) fn batch(
        &self,
        observation: &ObservationView<'_>,
        first_env: usize,
        prompts: &[Vec<u32>],
    ) -> Pi05Batch {
        let Pi05Description { architecture, mapping, padding_value, .. } = &self.description;
        let chunk_len = architecture.horizon * architecture.action_width;
        let mut distinct = DistinctImages::default();
        let mut samples = Vec::with_capacity(prompts.len());
        let mut noise = vec![0.0; prompts.len() * chunk_len];
        for ((env_idx, prompt), noise) in (first_env..).zip(prompts).zip(noise.chunks_exact_mut(chunk_len)) {
            let env = observation.env(env_idx);
            let images = mapping.cameras.iter().map(|&camera| distinct.add(env.image(camera))).collect();
            samples.push(SampleTokens { images, prompt: prompt.clone() });
            draw_noise(env.record.policy_seed, env.record.query, noise);
        }
        Pi05Batch { images: distinct.resize(architecture.image_side(), *padding_value), samples, noise }
    }

    /// Writes the robot's part of denoised `actions [n, horizon, action_width]`, one chunk per element of
    /// `answer`. `state(idx)` is the robot's state in the observation that element `idx` answers.
    pub(crate) fn write_chunks<'a>(
        &self,
        actions: &[f32],
        state: impl Fn(usize) -> &'a [f32],
        answer: &mut [ActionChunk],
    ) {
        let Pi05Description { architecture, action, action_dim, relative, .. } = &self.description;
        let chunks = actions.chunks_exact(architecture.horizon * architecture.action_width);
        for (idx, (chunk, answer)) in chunks.zip(answer).enumerate() {
            let origin = if relative.is_empty() { Vec::new() } else { self.description.state_of(state(idx)) };
            let rows = answer.reset(architecture.horizon, *action_dim).chunks_exact_mut(*action_dim);
            for (row, padded) in rows.zip(chunk.chunks_exact(architecture.action_width)) {
                row.copy_from_slice(&padded[..*action_dim]);
                action.restore(row);
                for ((x, origin), _) in row.iter_mut().zip(&origin).zip(relative).filter(|(_, it)| **it) {
                    *x += origin;
                }
            }
        }
    }

    /// Returns the tokens of the prompt for an instruction and the robot's state.
    fn prompt(&self, instruction: &str, state: &[f32]) -> Result<Vec<u32>, PolicyError> {
        let Pi05Description { state: scaling, prompt_state, max_state_dim, .. } = &self.description;
        let mut own = self.description.state_of(state);
        scaling.normalise(&mut own);
        if *prompt_state == PromptState::Padded {
            own.resize(*max_state_dim, 0.0);
        }
        self.tokenizer
            .tokens(&prompt(instruction, &own))
            .map_err(|error: TokenizerError| PolicyError::Instruction { reason: error.to_string() })
    }
}

impl Pi05Batch {
    pub(crate) fn input(&self) -> Pi05Input<'_> {
        Pi05Input { images: &self.images, samples: &self.samples }
    }
}

impl<'a> DistinctImages<'a> {
    /// Returns the index of an image, adding it if no image with the same content is there yet.
    fn add(&mut self, image: (&'a [u8], ImageSize)) -> usize {
        let same_hash = self.by_hash.entry(xxh3_64(image.0)).or_default();
        if let Some(&idx) = same_hash.iter().find(|&&idx| self.images[idx] == image) {
            return idx;
        }
        same_hash.push(self.images.len());
        self.images.push(image);
        self.images.len() - 1
    }

    /// Returns the images as the network's input, `[n, 3, side, side]`, letterboxed with
    /// `padding_value` if they are not square.
    fn resize(&self, side: usize, padding_value: f32) -> Vec<f32> {
        let image_len = 3 * side * side;
        let mut planes = vec![0.0; self.images.len() * image_len];
        let jobs = planes.par_chunks_exact_mut(image_len).zip(&self.images);
        jobs.for_each(|(planes, &(pixels, size))| {
            resize_with_pad(pixels, [size.height, size.width], side, padding_value, planes);
        });
        planes
    }
}

/// Returns the prompt for an instruction and a normalised state.
#[must_use]
pub fn prompt(instruction: &str, state: &[f32]) -> String {
    let instruction = instruction.trim().replace(['_', '\n'], " ");
    let mut text = format!("Task: {instruction}, State: ");
    for (idx, &x) in state.iter().enumerate() {
        let separator = if idx == 0 { "" } else { " " };
        // Writing to a string cannot fail.
        let _ = write!(text, "{separator}{}", bin(x));
    }
    text.push_str(";\nAction: ");
    text
}

/// Returns the bin of a normalised value: −1 below −1, and the last bin from its lower edge on.
fn bin(x: f32) -> i64 {
    let last = N_BINS as i64 - 1;
    // The edges are exact in binary, so that a product finds the bin.
    let position = (f64::from(x) + 1.0) * (N_BINS as f64 / 2.0);
    if position.is_nan() { last } else { (position.floor() as i64).clamp(-1, last) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::pi05::image::BLACK;

    #[test]
    fn values_fall_into_bins_of_equal_width() {
        let cases = [
            (-1.5, -1),
            (-1.000_001, -1),
            (-1.0, 0),
            (-0.992_187_5, 1),
            (-0.992_19, 0),
            (0.0, 128),
            (0.999, 255),
            (1.0, 255),
            (3.0, 255),
        ];
        for (x, expected) in cases {
            assert_eq!(bin(x), expected, "{x}");
        }
    }

    #[test]
    fn prompt_cleans_the_instruction() {
        assert_eq!(prompt(" lift_the\ncube ", &[0.0, -2.0]), "Task: lift the cube, State: 128 -1;\nAction: ");
    }

    #[test]
    fn equal_images_are_encoded_once() {
        let (first, second) = (vec![1_u8; 12], vec![2_u8; 12]);
        let copy = first.clone();
        let mut distinct = DistinctImages::default();
        let found =
            [&first, &second, &copy, &first].map(|pixels| distinct.add((pixels, ImageSize::square(2))));
        assert_eq!(found, [0, 1, 0, 0]);
        assert_eq!(distinct.resize(2, BLACK).len(), 2 * 3 * 4);
    }
}
