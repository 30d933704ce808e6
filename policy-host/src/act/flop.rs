//! Floating-point operation count of one query, derived from the shapes: multiplications and additions of all
//! matrix products and convolutions that affect the output. Normalisations, activations and softmaxes are not
//! counted.

use super::architecture::{Architecture, ImageSize, ResNet};

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
