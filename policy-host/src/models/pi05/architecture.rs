//! Sizes of a π0.5 network, and the names of its tensors.
//!
//! LeRobot's configuration names only a variant, and checkpoints of other widths occur. The sizes are
//! therefore taken from the shapes of the tensors; only the number of vision heads does not follow from them.

use crate::weights::{TensorFolder, TensorSpec, WeightsError};

/// Patch side of SigLIP So400m/14, in pixels.
pub const PATCH_SIDE: usize = 14;
/// Vision heads of SigLIP So400m/14.
pub const DEFAULT_VISION_HEADS: usize = 16;
/// Prefix of the names of the two language models and the vision tower.
const JOINT: &str = "paligemma_with_expert.";

/// Sizes of the vision tower (SigLIP).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VisionSizes {
    /// Width of a token.
    pub width: usize,
    /// Number of layers.
    pub depth: usize,
    /// Width of the hidden layer of an MLP.
    pub hidden: usize,
    /// Number of attention heads.
    pub n_heads: usize,
    /// Number of patches of an image, and of its tokens.
    pub n_patches: usize,
}

/// Sizes of a Gemma language model. Query heads share one key and one value head.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GemmaSizes {
    /// Width of a token.
    pub width: usize,
    /// Number of layers.
    pub depth: usize,
    /// Width of the hidden layer of an MLP.
    pub hidden: usize,
    /// Number of query heads.
    pub n_heads: usize,
    /// Width of a head.
    pub head_width: usize,
}

/// Sizes of a π0.5 network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pi05Architecture {
    /// Vision tower.
    pub vision: VisionSizes,
    /// Language model that reads images, instruction and state.
    pub prefix: GemmaSizes,
    /// Language model that denoises actions: the action expert.
    pub expert: GemmaSizes,
    /// Number of entries of the token embedding.
    pub vocabulary: usize,
    /// Rows of an action chunk.
    pub horizon: usize,
    /// Width of an action inside the network, padded with zeros beyond the robot's.
    pub action_width: usize,
}

/// Names of a checkpoint's tensors.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pi05Names {
    /// `model.` in LeRobot's checkpoints, nothing in openpi's.
    root: &'static str,
    /// `true` if the embedding is stored as the output layer with which it shares its weights.
    tied: bool,
}

impl Pi05Architecture {
    /// The architecture of the released checkpoints: SigLIP So400m/14, Gemma 2B and an expert of 300 million
    /// parameters.
    pub const FULL: Self = Self {
        vision: VisionSizes { width: 1152, depth: 27, hidden: 4304, n_heads: 16, n_patches: 256 },
        prefix: GemmaSizes { width: 2048, depth: 18, hidden: 16_384, n_heads: 8, head_width: 256 },
        expert: GemmaSizes { width: 1024, depth: 18, hidden: 4096, n_heads: 8, head_width: 256 },
        vocabulary: 257_152,
        horizon: 50,
        action_width: 32,
    };

    /// A small network for tests, for images of 56 × 56 pixels.
    pub const TINY: Self = Self {
        vision: VisionSizes { width: 24, depth: 2, hidden: 40, n_heads: 3, n_patches: 16 },
        prefix: GemmaSizes { width: 32, depth: 2, hidden: 64, n_heads: 8, head_width: 8 },
        expert: GemmaSizes { width: 16, depth: 2, hidden: 32, n_heads: 8, head_width: 8 },
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
        let gemma = |part: LayerStack| -> Result<GemmaSizes, WeightsError> {
            let layer = |idx, name: &str| names.layer(part, idx, name);
            let query = shape(layer(0, "self_attn.q_proj.weight"), "[queries, width]", 2)?;
            let key = shape(layer(0, "self_attn.k_proj.weight"), "[head width, width]", 2)?;
            let gate = shape(layer(0, "mlp.gate_proj.weight"), "[hidden, width]", 2)?;
            Ok(GemmaSizes {
                width: query[1],
                depth: depth(&|idx| layer(idx, "self_attn.q_proj.weight")),
                hidden: gate[0],
                n_heads: query[0] / key[0].max(1),
                head_width: key[0],
            })
        };
        let hidden = shape(names.layer(LayerStack::Vision, 0, "mlp.fc1.weight"), "[hidden, width]", 2)?;
        let position = shape(names.position_embedding(), "[patches, width]", 2)?;
        let embedding = shape(names.embedding(), "[vocabulary, width]", 2)?;
        let action = shape(names.root("action_in_proj.weight"), "[width, actions]", 2)?;
        Ok(Self {
            vision: VisionSizes {
                width: hidden[1],
                depth: depth(&|idx| names.layer(LayerStack::Vision, idx, "mlp.fc1.weight")),
                hidden: hidden[0],
                n_heads: vision_heads,
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
        let gemma = |sizes: &GemmaSizes| [sizes.width, sizes.hidden, sizes.n_heads, sizes.head_width];
        let sizes = [&gemma(prefix)[..], &gemma(expert), &[vision.width, vision.hidden, vision.n_patches]];
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
                vision.n_heads == 0 || !vision.width.is_multiple_of(vision.n_heads),
                "vision_heads",
                found(vision.n_heads),
                format!("a divisor of the vision width {}", vision.width),
            ),
            (
                expert.depth != prefix.depth,
                "number of expert layers",
                found(expert.depth),
                format!("{}, as in the language model, whose keys it reads", prefix.depth),
            ),
            (
                (expert.n_heads, expert.head_width) != (prefix.n_heads, prefix.head_width),
                "heads of the expert",
                format!("{} of width {}", expert.n_heads, expert.head_width),
                format!("{} of width {}", prefix.n_heads, prefix.head_width),
            ),
            (
                prefix.head_width % 2 != 0 || expert.width % 2 != 0,
                "width of a head or of the expert",
                format!("{} and {}", prefix.head_width, expert.width),
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
        let VisionSizes { width: vision, hidden, n_patches, .. } = self.vision;
        add(names.patch_embedding("weight"), &[vision, 3, PATCH_SIDE, PATCH_SIDE]);
        add(names.patch_embedding("bias"), &[vision]);
        add(names.position_embedding(), &[n_patches, vision]);
        for layer in 0..self.vision.depth {
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
        add(names.projector("weight"), &[prefix.width, vision]);
        add(names.projector("bias"), &[prefix.width]);
        add(names.embedding(), &[self.vocabulary, prefix.width]);
        for (part, sizes) in [(LayerStack::Prefix, prefix), (LayerStack::Expert, expert)] {
            let GemmaSizes { width, hidden, n_heads, head_width, .. } = sizes;
            for layer in 0..sizes.depth {
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
        add(names.expert_norm("weight"), &[3 * expert.width, expert.width]);
        add(names.expert_norm("bias"), &[3 * expert.width]);
        for (name, out, input) in [
            ("action_in_proj", expert.width, self.action_width),
            ("action_out_proj", self.action_width, expert.width),
            ("time_mlp_in", expert.width, expert.width),
            ("time_mlp_out", expert.width, expert.width),
        ] {
            add(names.root(&format!("{name}.weight")), &[out, input]);
            add(names.root(&format!("{name}.bias")), &[out]);
        }
        specs
    }
}

/// The three stacks of layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LayerStack {
    Vision,
    Prefix,
    Expert,
}

impl Pi05Names {
    /// LeRobot's names.
    pub const LEROBOT: Self = Self { root: "model.", tied: false };

    /// Recognises LeRobot's and openpi's names.
    #[must_use]
    pub fn of(tensors: &TensorFolder) -> Self {
        let is_lerobot = tensors.names().any(|name| name.starts_with("model.paligemma_with_expert."));
        let names = Self { root: if is_lerobot { "model." } else { "" }, tied: false };
        let tied = tensors.shape(&names.embedding()).is_none();
        Self { tied, ..names }
    }

    /// Returns `true` for a tensor that only training uses: output layers over words, and the last norm of
    /// the language model.
    #[must_use]
    pub fn is_unused(&self, name: &str) -> bool {
        name.strip_prefix(self.root).and_then(|name| name.strip_prefix(JOINT)).is_some_and(|name| {
            [
                "paligemma.lm_head.weight",
                "paligemma.model.language_model.norm.weight",
                "paligemma.model.language_model.embed_tokens.weight",
                "gemma_expert.lm_head.weight",
                "gemma_expert.model.embed_tokens.weight",
            ]
            .contains(&name)
                || name.starts_with("paligemma.model.vision_tower.vision_model.head.")
        })
    }

    pub(crate) fn root(&self, name: &str) -> String {
        format!("{}{name}", self.root)
    }

    pub(crate) fn layer(&self, part: LayerStack, layer: usize, name: &str) -> String {
        let stack = match part {
            LayerStack::Vision => "paligemma.model.vision_tower.vision_model.encoder",
            LayerStack::Prefix => "paligemma.model.language_model",
            LayerStack::Expert => "gemma_expert.model",
        };
        format!("{}{JOINT}{stack}.layers.{layer}.{name}", self.root)
    }

    pub(crate) fn patch_embedding(&self, name: &str) -> String {
        format!(
            "{}{JOINT}paligemma.model.vision_tower.vision_model.embeddings.patch_embedding.{name}",
            self.root
        )
    }

    pub(crate) fn position_embedding(&self) -> String {
        format!(
            "{}{JOINT}paligemma.model.vision_tower.vision_model.embeddings.position_embedding.weight",
            self.root
        )
    }

    pub(crate) fn post_norm(&self, name: &str) -> String {
        format!("{}{JOINT}paligemma.model.vision_tower.vision_model.post_layernorm.{name}", self.root)
    }

    pub(crate) fn projector(&self, name: &str) -> String {
        format!("{}{JOINT}paligemma.model.multi_modal_projector.linear.{name}", self.root)
    }

    pub(crate) fn embedding(&self) -> String {
        let name =
            if self.tied { "paligemma.lm_head" } else { "paligemma.model.language_model.embed_tokens" };
        format!("{}{JOINT}{name}.weight", self.root)
    }

    pub(crate) fn expert_norm(&self, name: &str) -> String {
        format!("{}{JOINT}gemma_expert.model.norm.dense.{name}", self.root)
    }
}

impl Pi05Architecture {
    /// Returns the floating-point operations of a query with this many distinct images and prompt tokens,
    /// counting matrix products only, a multiplication and an addition as two.
    #[must_use]
    pub fn flop_per_query(&self, n_images: usize, n_prompt: usize, n_steps: usize) -> u64 {
        let VisionSizes { width, depth, hidden, n_patches, .. } = self.vision;
        let patch = 3 * PATCH_SIDE * PATCH_SIDE * width + width * self.prefix.width;
        let layer = 4 * width * width + 2 * width * hidden + 2 * n_patches * width;
        let vision = n_images * n_patches * (patch + depth * layer);

        let length = n_images * n_patches + n_prompt;
        let keys = |sizes: GemmaSizes| 2 * sizes.width * sizes.head_width;
        let rest = |sizes: GemmaSizes, n_keys: usize| {
            let heads = sizes.n_heads * sizes.head_width;
            2 * sizes.width * heads + 3 * sizes.width * sizes.hidden + 2 * n_keys * heads
        };
        let GemmaSizes { depth, .. } = self.prefix;
        let prefix = length * (depth * keys(self.prefix) + (depth - 1) * rest(self.prefix, length));

        let row = self.expert.depth * (keys(self.expert) + rest(self.expert, length + self.horizon))
            + 2 * self.expert.width * self.action_width;
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
