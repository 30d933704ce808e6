//! The arithmetic of one query, counted from the shapes: multiplications and additions of all matrix products and
//! convolutions that reach the output. Normalisations, activations and softmaxes are not counted.

use super::architecture::{Architecture, ImageSize, ResNet};

impl Architecture {
    /// Floating-point operations of one query with an instruction known before; dead layers and what is precomputed are
    /// left out.
    #[must_use]
    pub fn flop_per_query(&self) -> u64 {
        let product = |rows: usize, inner: usize, cols: usize| 2 * (rows * inner * cols) as u64;
        let (width, inner) = (self.hidden_dim, self.dim_feedforward);
        let (tokens, queries) = (self.max_tokens(), self.horizon);

        let feed_forward = |rows| 2 * product(rows, width, inner);
        let attention = |rows, keys| 2 * product(rows, width, keys);
        let encoder_layer =
            4 * product(tokens, width, width) + attention(tokens, tokens) + feed_forward(tokens);
        let cross = 2 * product(tokens, width, width)
            + attention(queries, tokens)
            + product(queries, width, width)
            + feed_forward(queries);
        // Self-attention and the cross-attention's queries of the first layer are the same in every query.
        let own = 5 * product(queries, width, width) + attention(queries, queries);
        let decoder = self.dec_layers as u64 * cross + (self.dec_layers as u64 - 1) * own;
        let projections = product(self.n_image_tokens(), self.backbone.n_features(), width)
            + product(1, self.state_dim.unwrap_or(0), width)
            + product(queries, width, self.action_dim);
        let trunks: u64 = self.cameras.iter().map(|&size| trunk_flop(self.backbone, size)).sum();
        trunks + projections + self.enc_layers as u64 * encoder_layer + decoder
    }
}

/// Floating-point operations of the backbone for one image.
fn trunk_flop(backbone: ResNet, image: ImageSize) -> u64 {
    let half = |size: ImageSize| ImageSize { height: size.height.div_ceil(2), width: size.width.div_ceil(2) };
    let conv = |size: ImageSize, taps: usize, c_in: usize, c_out: usize| {
        2 * (size.n_places() * taps * c_in * c_out) as u64
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
