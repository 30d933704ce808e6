//! Sizes of a π0.5 network.
//!
//! LeRobot's configuration names only a variant, and checkpoints of other widths occur. The sizes are
//! therefore taken from the shapes of the tensors; only the number of vision heads does not follow from them.

use super::checkpoint::names::{LayerStack, Pi05Names};
use crate::weights::{TensorFolder, TensorSpec, WeightsError};

/// Patch side of SigLIP So400m/14, in pixels.
pub const PATCH_SIDE: usize = 14;
/// Vision heads of SigLIP So400m/14.
pub const DEFAULT_VISION_HEADS: usize = 16;
/// Maximum number of Euler steps from noise to actions.
pub(crate) const MAX_STEPS: u32 = 1000;

/// Sizes of the vision tower, under the names of SigLIP's configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SiglipConfig {
    /// Width of a token.
    pub hidden_size: usize,
    /// Number of layers.
    pub num_hidden_layers: usize,
    /// Width of the hidden layer of an MLP.
    pub intermediate_size: usize,
    /// Number of attention heads.
    pub num_attention_heads: usize,
    /// Number of patches of an image, and of its tokens.
    pub n_patches: usize,
}

/// Sizes of a language model, under the names of Gemma's configuration. Query heads share one key and one
/// value head.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GemmaConfig {
    /// Width of a token.
    pub hidden_size: usize,
    /// Number of layers.
    pub num_hidden_layers: usize,
    /// Width of the hidden layer of an MLP.
    pub intermediate_size: usize,
    /// Number of query heads.
    pub num_attention_heads: usize,
    /// Width of a head.
    pub head_dim: usize,
}

/// Sizes of a π0.5 network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pi05Architecture {
    /// Vision tower.
    pub vision: SiglipConfig,
    /// Language model that processes images, instruction and state.
    pub prefix: GemmaConfig,
    /// Language model that denoises actions: the action expert.
    pub expert: GemmaConfig,
    /// Number of entries of the token embedding.
    pub vocabulary: usize,
    /// Rows of an action chunk.
    pub horizon: usize,
    /// Width of an action inside the network, padded with zeros beyond the robot's.
    pub action_width: usize,
}

impl Pi05Architecture {
    /// The architecture of the released checkpoints: SigLIP So400m/14, Gemma 2B and an expert of 300 million
    /// parameters.
    pub const FULL: Self = Self {
        vision: SiglipConfig {
            hidden_size: 1152,
            num_hidden_layers: 27,
            intermediate_size: 4304,
            num_attention_heads: 16,
            n_patches: 256,
        },
        prefix: GemmaConfig {
            hidden_size: 2048,
            num_hidden_layers: 18,
            intermediate_size: 16_384,
            num_attention_heads: 8,
            head_dim: 256,
        },
        expert: GemmaConfig {
            hidden_size: 1024,
            num_hidden_layers: 18,
            intermediate_size: 4096,
            num_attention_heads: 8,
            head_dim: 256,
        },
        vocabulary: 257_152,
        horizon: 50,
        action_width: 32,
    };

    /// A small network for tests, for images of 56 × 56 pixels.
    pub const TINY: Self = Self {
        vision: SiglipConfig {
            hidden_size: 24,
            num_hidden_layers: 2,
            intermediate_size: 40,
            num_attention_heads: 3,
            n_patches: 16,
        },
        prefix: GemmaConfig {
            hidden_size: 32,
            num_hidden_layers: 2,
            intermediate_size: 64,
            num_attention_heads: 8,
            head_dim: 8,
        },
        expert: GemmaConfig {
            hidden_size: 16,
            num_hidden_layers: 2,
            intermediate_size: 32,
            num_attention_heads: 8,
            head_dim: 8,
        },
        vocabulary: 512,
        horizon: 10,
        action_width: 32,
    };

    /// Derives the sizes from the shapes of the tensors.
    ///
    /// # Errors
    /// If a tensor from which a size follows is missing or has another number of axes.
    pub fn of(
        tensors: &TensorFolder,
        names: &Pi05Names,
        vision_heads: usize,
        horizon: usize,
    ) -> Result<Self, WeightsError> {
        let shape = |name: String, axes: &str, n_axes: usize| -> Result<Vec<usize>, WeightsError> {
            match tensors.shape(&name) {
                Some(shape) if shape.len() == n_axes => Ok(shape.to_vec()),
                Some(shape) => Err(WeightsError::Mismatch {
                    path: tensors.path_of(&name).to_owned(),
                    expected: axes.to_owned(),
                    found: format!("{shape:?}"),
                    tensor: name,
                }),
                None => Err(WeightsError::Missing {
                    path: tensors.path_of(&name).to_owned(),
                    tensor: name,
                    expected: axes.to_owned(),
                }),
            }
        };
        let depth = |of: &dyn Fn(usize) -> String| {
            (0..).take_while(|layer| tensors.shape(&of(*layer)).is_some()).count()
        };
        let gemma = |part: LayerStack| -> Result<GemmaConfig, WeightsError> {
            let layer = |idx, name: &str| names.layer(part, idx, name);
            let query = shape(layer(0, "self_attn.q_proj.weight"), "[queries, width]", 2)?;
            let key = shape(layer(0, "self_attn.k_proj.weight"), "[head width, width]", 2)?;
            let gate = shape(layer(0, "mlp.gate_proj.weight"), "[hidden, width]", 2)?;
            Ok(GemmaConfig {
                hidden_size: query[1],
                num_hidden_layers: depth(&|idx| layer(idx, "self_attn.q_proj.weight")),
                intermediate_size: gate[0],
                num_attention_heads: query[0] / key[0].max(1),
                head_dim: key[0],
            })
        };
        let hidden = shape(names.layer(LayerStack::Vision, 0, "mlp.fc1.weight"), "[hidden, width]", 2)?;
        let position = shape(names.position_embedding(), "[patches, width]", 2)?;
        let embedding = shape(names.embedding(), "[vocabulary, width]", 2)?;
        let action = shape(names.root("action_in_proj.weight"), "[width, actions]", 2)?;
        Ok(Self {
            vision: SiglipConfig {
                hidden_size: hidden[1],
                num_hidden_layers: depth(&|idx| names.layer(LayerStack::Vision, idx, "mlp.fc1.weight")),
                intermediate_size: hidden[0],
                num_attention_heads: vision_heads,
                n_patches: position[0],
            },
            prefix: gemma(LayerStack::Prefix)?,
            expert: gemma(LayerStack::Expert)?,
            vocabulary: embedding[0],
            horizon,
            action_width: action[1],
        })
    }

    /// Returns the first size that is impossible, with what was expected.
    #[must_use]
    pub fn invalid(&self) -> Option<(&'static str, String, String)> {
        let Self { vision, prefix, expert, horizon, .. } = self;
        let side = vision.n_patches.isqrt();
        let found = |found: usize| found.to_string();
        let gemma = |sizes: &GemmaConfig| {
            [sizes.hidden_size, sizes.intermediate_size, sizes.num_attention_heads, sizes.head_dim]
        };
        let sizes = [
            &gemma(prefix)[..],
            &gemma(expert),
            &[vision.hidden_size, vision.intermediate_size, vision.n_patches],
        ];
        let smallest = sizes.concat().into_iter().chain([self.vocabulary, self.action_width]).min();
        [
            (
                smallest == Some(0),
                "smallest width of the network",
                "0".to_owned(),
                "at least 1 for every axis of every tensor".to_owned(),
            ),
            (
                side * side != vision.n_patches,
                "number of patches",
                found(vision.n_patches),
                "a square".to_owned(),
            ),
            (
                vision.num_attention_heads == 0
                    || !vision.hidden_size.is_multiple_of(vision.num_attention_heads),
                "vision_heads",
                found(vision.num_attention_heads),
                format!("a divisor of the vision width {}", vision.hidden_size),
            ),
            (
                expert.num_hidden_layers != prefix.num_hidden_layers,
                "number of expert layers",
                found(expert.num_hidden_layers),
                format!("{}, as in the language model, whose keys it reads", prefix.num_hidden_layers),
            ),
            (
                (expert.num_attention_heads, expert.head_dim)
                    != (prefix.num_attention_heads, prefix.head_dim),
                "heads of the expert",
                format!("{} of width {}", expert.num_attention_heads, expert.head_dim),
                format!("{} of width {}", prefix.num_attention_heads, prefix.head_dim),
            ),
            (
                prefix.head_dim % 2 != 0 || expert.hidden_size % 2 != 0,
                "width of a head or of the expert",
                format!("{} and {}", prefix.head_dim, expert.hidden_size),
                "even numbers".to_owned(),
            ),
            (*horizon == 0, "chunk_size", found(*horizon), "at least 1".to_owned()),
        ]
        .into_iter()
        .find_map(|(differs, key, found, expected)| differs.then_some((key, found, expected)))
    }

    /// Returns the number of weights that inference needs.
    #[must_use]
    pub fn n_weights(&self) -> usize {
        let specs = self.tensor_specs(&Pi05Names::LEROBOT);
        specs.iter().map(|spec| spec.shape.iter().product::<usize>()).sum()
    }

    /// Returns the side of an input image in pixels.
    #[must_use]
    pub fn image_side(&self) -> usize {
        self.vision.n_patches.isqrt() * PATCH_SIDE
    }

    /// Returns the names and shapes of all tensors that inference needs.
    #[must_use]
    pub fn tensor_specs(&self, names: &Pi05Names) -> Vec<TensorSpec> {
        let mut specs = Vec::new();
        let mut add = |name: String, shape: &[usize]| specs.push(TensorSpec { name, shape: shape.to_vec() });
        let SiglipConfig { hidden_size: vision, intermediate_size: hidden, n_patches, .. } = self.vision;
        add(names.patch_embedding("weight"), &[vision, 3, PATCH_SIDE, PATCH_SIDE]);
        add(names.patch_embedding("bias"), &[vision]);
        add(names.position_embedding(), &[n_patches, vision]);
        for layer in 0..self.vision.num_hidden_layers {
            let mut add_linear = |name: &str, out: usize, input: usize| {
                add(names.layer(LayerStack::Vision, layer, &format!("{name}.weight")), &[out, input]);
                add(names.layer(LayerStack::Vision, layer, &format!("{name}.bias")), &[out]);
            };
            for name in ["q_proj", "k_proj", "v_proj", "out_proj"] {
                add_linear(&format!("self_attn.{name}"), vision, vision);
            }
            add_linear("mlp.fc1", hidden, vision);
            add_linear("mlp.fc2", vision, hidden);
            for name in ["layer_norm1.weight", "layer_norm1.bias", "layer_norm2.weight", "layer_norm2.bias"] {
                add(names.layer(LayerStack::Vision, layer, name), &[vision]);
            }
        }
        for name in ["weight", "bias"] {
            add(names.post_norm(name), &[vision]);
        }
        let (prefix, expert) = (self.prefix, self.expert);
        add(names.projector("weight"), &[prefix.hidden_size, vision]);
        add(names.projector("bias"), &[prefix.hidden_size]);
        add(names.embedding(), &[self.vocabulary, prefix.hidden_size]);
        for (part, sizes) in [(LayerStack::Prefix, prefix), (LayerStack::Expert, expert)] {
            let GemmaConfig {
                hidden_size: width,
                intermediate_size: hidden,
                num_attention_heads: n_heads,
                head_dim: head_width,
                ..
            } = sizes;
            for layer in 0..sizes.num_hidden_layers {
                let mut add = |name: &str, shape: &[usize]| add(names.layer(part, layer, name), shape);
                add("self_attn.q_proj.weight", &[n_heads * head_width, width]);
                add("self_attn.k_proj.weight", &[head_width, width]);
                add("self_attn.v_proj.weight", &[head_width, width]);
                add("self_attn.o_proj.weight", &[width, n_heads * head_width]);
                add("mlp.gate_proj.weight", &[hidden, width]);
                add("mlp.up_proj.weight", &[hidden, width]);
                add("mlp.down_proj.weight", &[width, hidden]);
                for norm in ["input_layernorm", "post_attention_layernorm"] {
                    if part == LayerStack::Prefix {
                        add(&format!("{norm}.weight"), &[width]);
                    } else {
                        add(&format!("{norm}.dense.weight"), &[3 * width, width]);
                        add(&format!("{norm}.dense.bias"), &[3 * width]);
                    }
                }
            }
        }
        add(names.expert_norm("weight"), &[3 * expert.hidden_size, expert.hidden_size]);
        add(names.expert_norm("bias"), &[3 * expert.hidden_size]);
        for (name, out, input) in [
            ("action_in_proj", expert.hidden_size, self.action_width),
            ("action_out_proj", self.action_width, expert.hidden_size),
            ("time_mlp_in", expert.hidden_size, expert.hidden_size),
            ("time_mlp_out", expert.hidden_size, expert.hidden_size),
        ] {
            add(names.root(&format!("{name}.weight")), &[out, input]);
            add(names.root(&format!("{name}.bias")), &[out]);
        }
        specs
    }
}

impl Pi05Architecture {
    /// Returns the floating-point operations of a query with this many distinct images and prompt tokens,
    /// counting matrix products only, a multiplication and an addition as two.
    #[must_use]
    pub fn flop_per_query(&self, n_images: usize, n_prompt: usize, n_steps: usize) -> u64 {
        let SiglipConfig {
            hidden_size: width,
            num_hidden_layers: depth,
            intermediate_size: hidden,
            n_patches,
            ..
        } = self.vision;
        let patch = 3 * PATCH_SIDE * PATCH_SIDE * width + width * self.prefix.hidden_size;
        let layer = 4 * width * width + 2 * width * hidden + 2 * n_patches * width;
        let vision = n_images * n_patches * (patch + depth * layer);

        let length = n_images * n_patches + n_prompt;
        let keys = |sizes: GemmaConfig| 2 * sizes.hidden_size * sizes.head_dim;
        let rest = |sizes: GemmaConfig, n_keys: usize| {
            let heads = sizes.num_attention_heads * sizes.head_dim;
            2 * sizes.hidden_size * heads
                + 3 * sizes.hidden_size * sizes.intermediate_size
                + 2 * n_keys * heads
        };
        let GemmaConfig { num_hidden_layers: depth, .. } = self.prefix;
        let prefix = length * (depth * keys(self.prefix) + (depth - 1) * rest(self.prefix, length));

        let row = self.expert.num_hidden_layers
            * (keys(self.expert) + rest(self.expert, length + self.horizon))
            + 2 * self.expert.hidden_size * self.action_width;
        2 * (vision + prefix + n_steps * self.horizon * row) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_size_takes_five_teraflop() {
        let tera = |flop: u64| flop as f64 / 1e12;
        let found = tera(Pi05Architecture::FULL.flop_per_query(3, 200, 10));
        assert!((4.6..5.1).contains(&found), "{found} TFLOP");
    }
}
