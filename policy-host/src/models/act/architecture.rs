//! Hyperparameters of an ACT network and its normalisation, independent of the checkpoint format.

use ipc_types::ImageSize;
use ipc_types::layout::MAX_ACTION_DIM;

use crate::formats::scaling::ShiftScale;

/// Hyperparameters of a network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Architecture {
    /// Sizes of the backbone's input images, in the order of their tokens. May be empty.
    pub cameras: Vec<ImageSize>,
    /// Dimension of the state vector, or `None` for a network without state input.
    pub state_dim: Option<usize>,
    /// Instruction input, or `None` for a network without one.
    pub instruction: Option<InstructionInput>,
    /// Dimension of an action.
    pub action_dim: usize,
    /// Number of actions in a chunk.
    pub horizon: usize,
    /// Model width `d`, the dimension of a token.
    pub hidden_dim: usize,
    /// Hidden width of the feed-forward layers.
    pub dim_feedforward: usize,
    /// Number of attention heads.
    pub n_heads: usize,
    /// Number of encoder layers.
    pub enc_layers: usize,
    /// Number of decoder layers that affect the output.
    pub dec_layers: usize,
    /// Backbone of the image input.
    pub backbone: ResNet,
}

/// Normalisation of all inputs and outputs of a network. `None` means identity.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Normalisation {
    /// Per camera, over its three channels, whose values are in [0, 1].
    pub images: Vec<Option<ShiftScale>>,
    /// Over the state vector.
    pub state: Option<ShiftScale>,
    /// Over the instruction embedding.
    pub instruction: Option<ShiftScale>,
    /// Over an action; the policy applies its inverse.
    pub action: Option<ShiftScale>,
}

/// A ResNet of basic blocks (two 3×3 convolutions each), without the classifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResNet {
    /// Number of blocks in each stage.
    pub blocks: [usize; 4],
    /// Channels of the first stage. Every further stage doubles them.
    pub width: usize,
}

/// Instruction input: the embedding and its projection to a token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstructionInput {
    /// Dimension of the embedding.
    pub dim: usize,
    /// Projection to a token.
    pub projection: TokenProjection,
}

/// Projection of an instruction embedding to a token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TokenProjection {
    /// `(Linear, ReLU, LayerNorm) × 2, Linear` (docs/benchmark.md, "Policies and evaluation"). The token has
    /// no position embedding, and an empty instruction has no token.
    Mlp,
    /// One linear layer, like LeRobot's environment state. The token has a learned position embedding.
    Linear,
}

/// A hyperparameter outside its limits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InvalidHyperparameter {
    /// Name of the hyperparameter.
    pub name: &'static str,
    /// Value that was found.
    pub found: usize,
    /// Description of the valid values.
    pub expected: String,
}

/// Base-2 logarithm of the backbone's total stride: one feature covers 32 × 32 pixels.
const BACKBONE_STRIDE_LOG2: u32 = 5;

/// Returns the size of the backbone's last feature map for images of this size: halved five times, rounding
/// up.
#[must_use]
pub fn features(image: ImageSize) -> ImageSize {
    let halved = |side: usize| (0..BACKBONE_STRIDE_LOG2).fold(side, |side, _| side.div_ceil(2));
    ImageSize { height: halved(image.height), width: halved(image.width) }
}

impl ResNet {
    /// ResNet-18 with the standard widths.
    pub const RESNET_18: Self = Self { blocks: [2, 2, 2, 2], width: 64 };
    /// ResNet-34 with the standard widths.
    pub const RESNET_34: Self = Self { blocks: [3, 4, 6, 3], width: 64 };

    /// Returns the number of output channels of a stage.
    #[must_use]
    pub const fn channels(self, stage: usize) -> usize {
        self.width << stage
    }

    /// Returns the number of output channels of the last stage.
    #[must_use]
    pub const fn n_features(self) -> usize {
        self.channels(self.blocks.len() - 1)
    }
}

impl Architecture {
    /// Maximum number of actions in a chunk.
    pub const MAX_HORIZON: usize = 1024;

    /// Checks every value against its limits.
    ///
    /// # Errors
    /// The first hyperparameter outside its limits.
    pub fn check(&self) -> Result<(), InvalidHyperparameter> {
        let sides =
            self.cameras.iter().flat_map(|size| [("image height", size.height), ("image width", size.width)]);
        let sides = sides.map(|(name, found)| (name, found, 2048));
        let sizes = [
            ("state width", self.state_dim.unwrap_or(1), 4096),
            ("instruction width", self.instruction.map_or(1, |input| input.dim), 4096),
            ("action width", self.action_dim, MAX_ACTION_DIM),
            ("horizon", self.horizon, Self::MAX_HORIZON),
            ("token width", self.hidden_dim, 4096),
            ("feed-forward width", self.dim_feedforward, 16_384),
            ("number of heads", self.n_heads, 64),
            ("number of encoder layers", self.enc_layers, 32),
            ("number of decoder layers", self.dec_layers, 32),
            ("backbone width", self.backbone.width, 256),
        ];
        for (name, found, limit) in sizes.into_iter().chain(sides) {
            if found == 0 || found > limit {
                return Err(InvalidHyperparameter { name, found, expected: format!("1 to {limit}") });
            }
        }
        if self.cameras.len() > 8 {
            return Err(InvalidHyperparameter {
                name: "number of cameras",
                found: self.cameras.len(),
                expected: "at most 8".into(),
            });
        }
        if !self.hidden_dim.is_multiple_of(4) || !self.hidden_dim.is_multiple_of(self.n_heads) {
            let expected = format!("a multiple of 4 and of the number of heads, {}", self.n_heads);
            return Err(InvalidHyperparameter { name: "token width", found: self.hidden_dim, expected });
        }
        Ok(())
    }

    /// Returns the number of image tokens of all cameras.
    #[must_use]
    pub fn n_image_tokens(&self) -> usize {
        self.cameras.iter().map(|size| features(*size).n_pixels()).sum()
    }

    /// Returns the number of tokens with a learned position embedding: latent, state and, with
    /// [`TokenProjection::Linear`], instruction.
    #[must_use]
    pub fn n_learned_positions(&self) -> usize {
        let linear = self.instruction.is_some_and(|input| input.projection == TokenProjection::Linear);
        1 + usize::from(self.state_dim.is_some()) + usize::from(linear)
    }

    /// Returns the maximum number of encoder tokens: latent, state, instruction and images.
    #[must_use]
    pub fn max_tokens(&self) -> usize {
        let leading = 1 + usize::from(self.state_dim.is_some()) + usize::from(self.instruction.is_some());
        leading + self.n_image_tokens()
    }
}

impl Architecture {
    /// Returns the floating-point operations of one query for the first `n_rows` rows of a chunk, whose
    /// instruction token is cached. Work that does not affect these rows and precomputed terms are excluded.
    #[must_use]
    pub fn flop_per_query(&self, n_rows: usize) -> u64 {
        let product = |rows: usize, inner: usize, cols: usize| 2 * (rows * inner * cols) as u64;
        let (width, inner) = (self.hidden_dim, self.dim_feedforward);
        let (tokens, queries) = (self.max_tokens(), self.horizon);

        let feed_forward = |rows| 2 * product(rows, width, inner);
        let attention = |rows, keys| 2 * product(rows, width, keys);
        let encoder_layer =
            4 * product(tokens, width, width) + attention(tokens, tokens) + feed_forward(tokens);
        let cross = 2 * product(tokens, width, width) + attention(queries, tokens);
        let tail = |rows| product(rows, width, width) + feed_forward(rows);
        // The first layer's self-attention and cross-attention queries are constant and precomputed.
        let self_attention = 5 * product(queries, width, width) + attention(queries, queries);
        let all_rows = self.dec_layers as u64 - 1;
        let decoder = self.dec_layers as u64 * cross
            + all_rows * (self_attention + tail(queries))
            + tail(n_rows.min(queries));
        let projections = product(self.n_image_tokens(), self.backbone.n_features(), width)
            + product(1, self.state_dim.unwrap_or(0), width)
            + product(n_rows.min(queries), width, self.action_dim);
        let backbones: u64 = self.cameras.iter().map(|&size| backbone_flop(self.backbone, size)).sum();
        backbones + projections + self.enc_layers as u64 * encoder_layer + decoder
    }
}

/// Returns the floating-point operations of the backbone for one image.
fn backbone_flop(backbone: ResNet, image: ImageSize) -> u64 {
    let half = |size: ImageSize| ImageSize { height: size.height.div_ceil(2), width: size.width.div_ceil(2) };
    let conv = |size: ImageSize, taps: usize, c_in: usize, c_out: usize| {
        2 * (size.n_pixels() * taps * c_in * c_out) as u64
    };
    let mut size = half(image);
    let mut total = conv(size, 49, 3, backbone.width);
    size = half(size);
    for (stage, n_blocks) in backbone.blocks.into_iter().enumerate() {
        let c = backbone.channels(stage);
        let c_in = if stage == 0 { c } else { c / 2 };
        if stage > 0 {
            size = half(size);
            total += conv(size, 1, c_in, c);
        }
        total += conv(size, 9, c_in, c) + (2 * n_blocks as u64 - 1) * conv(size, 9, c, c);
    }
    total
}
