//! The shape of an ACT network: what its arithmetic is, whatever folder its weights came from.

use ipc_types::layout::MAX_ACTION_DIM;

/// Hyperparameters of a network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Architecture {
    /// Images as the backbone sees them, in the order of their tokens; may be empty.
    pub cameras: Vec<ImageSize>,
    /// Width of the state vector, for a network that sees one.
    pub state_dim: Option<usize>,
    /// The embedding of an instruction, for a network that sees one.
    pub instruction: Option<InstructionInput>,
    /// Width of an action row.
    pub action_dim: usize,
    /// Rows of an action chunk.
    pub horizon: usize,
    /// Width of a token.
    pub hidden_dim: usize,
    /// Inner width of the feed-forward layers.
    pub dim_feedforward: usize,
    /// Attention heads.
    pub n_heads: usize,
    /// Encoder layers.
    pub enc_layers: usize,
    /// Decoder layers that reach the output.
    pub dec_layers: usize,
    /// The image network.
    pub backbone: ResNet,
}

/// Sides of an image in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageSize {
    /// Rows.
    pub height: usize,
    /// Pixels in a row.
    pub width: usize,
}

/// A residual network of two-convolution blocks, without its classifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResNet {
    /// Blocks of each stage.
    pub blocks: [usize; 4],
    /// Channels of the first stage; each further stage has twice as many.
    pub width: usize,
}

/// The embedding of an instruction and how it becomes a token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstructionInput {
    /// Width of the embedding.
    pub dim: usize,
    /// How it becomes a token.
    pub projection: Projection,
}

/// How an embedding becomes a token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Projection {
    /// `(Linear, ReLU, LayerNorm) × 2, Linear` (spec/eval.md §1.2). The token has no position, and an empty instruction has
    /// no token.
    Mlp,
    /// One linear layer, as for LeRobot's environment state. The token has a learned position.
    Linear,
}

/// A hyperparameter that no network can have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadValue {
    /// Which one.
    pub name: &'static str,
    /// What it is.
    pub found: usize,
    /// What it may be.
    pub expected: String,
}

/// Pixels of an image that the features of one place cover in each direction.
const BACKBONE_STRIDE_LOG2: u32 = 5;

impl ImageSize {
    /// Sides of the backbone's last feature map: halved five times, rounded up.
    #[must_use]
    pub fn features(self) -> Self {
        let halved = |side: usize| (0..BACKBONE_STRIDE_LOG2).fold(side, |side, _| side.div_ceil(2));
        Self { height: halved(self.height), width: halved(self.width) }
    }

    /// Places of a map of these sides.
    #[must_use]
    pub const fn n_places(self) -> usize {
        self.height * self.width
    }
}

impl ResNet {
    /// The usual ResNet-18.
    pub const RESNET_18: Self = Self { blocks: [2, 2, 2, 2], width: 64 };
    /// The usual ResNet-34.
    pub const RESNET_34: Self = Self { blocks: [3, 4, 6, 3], width: 64 };

    /// Channels of a stage's output.
    #[must_use]
    pub const fn channels(self, stage: usize) -> usize {
        self.width << stage
    }

    /// Channels of the last stage's output.
    #[must_use]
    pub const fn n_features(self) -> usize {
        self.channels(self.blocks.len() - 1)
    }
}

impl Architecture {
    /// Longest chunk.
    pub const MAX_HORIZON: usize = 1024;

    /// Checks every value against its limits.
    ///
    /// # Errors
    /// The first that no network can have.
    pub fn check(&self) -> Result<(), BadValue> {
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
                return Err(BadValue { name, found, expected: format!("1 to {limit}") });
            }
        }
        if self.cameras.len() > 8 {
            return Err(BadValue {
                name: "number of cameras",
                found: self.cameras.len(),
                expected: "at most 8".into(),
            });
        }
        if !self.hidden_dim.is_multiple_of(4) || !self.hidden_dim.is_multiple_of(self.n_heads) {
            let expected = format!("a multiple of 4 and of the number of heads, {}", self.n_heads);
            return Err(BadValue { name: "token width", found: self.hidden_dim, expected });
        }
        Ok(())
    }

    /// Tokens that images make.
    #[must_use]
    pub fn n_image_tokens(&self) -> usize {
        self.cameras.iter().map(|size| size.features().n_places()).sum()
    }

    /// Tokens with a learned position: latent, state and, of a [`Projection::Linear`], instruction.
    #[must_use]
    pub fn n_placed_tokens(&self) -> usize {
        let linear = self.instruction.is_some_and(|input| input.projection == Projection::Linear);
        1 + usize::from(self.state_dim.is_some()) + usize::from(linear)
    }

    /// Most tokens in the encoder: latent, state, instruction if it can be there, images.
    #[must_use]
    pub fn max_tokens(&self) -> usize {
        let leading = 1 + usize::from(self.state_dim.is_some()) + usize::from(self.instruction.is_some());
        leading + self.n_image_tokens()
    }
}
