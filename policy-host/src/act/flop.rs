//! The arithmetic of one query, counted from the shapes: multiplications and additions of all matrix products and
//! convolutions that reach the output. Normalisations, activations and softmaxes are not counted.

use super::config::ActConfig;
use super::tensors::{N_STAGES, stage_channels};

impl ActConfig {
    /// Floating-point operations of one query with an instruction; dead layers and what is precomputed are left out.
    #[must_use]
    pub fn flop_per_query(&self) -> u64 {
        let product = |rows: usize, inner: usize, cols: usize| 2 * (rows * inner * cols) as u64;
        let (width, inner) = (self.hidden_dim, self.dim_feedforward);
        let (tokens, queries) = (self.max_tokens(), self.num_queries);

        let feed_forward = |rows| 2 * product(rows, width, inner);
        let attention = |rows| 2 * product(rows, width, tokens);
        let encoder_layer = 4 * product(tokens, width, width) + attention(tokens) + feed_forward(tokens);
        let decoder = 2 * product(tokens, width, width)
            + attention(queries)
            + product(queries, width, width)
            + feed_forward(queries)
            + product(queries, width, self.action_dim);
        let features = stage_channels(self, N_STAGES - 1);
        let projections = product(self.n_image_tokens(), features, width) + product(1, self.state_dim, width);
        self.n_cameras as u64 * self.trunk_flop()
            + projections
            + self.enc_layers as u64 * encoder_layer
            + decoder
    }

    /// Floating-point operations of the backbone for one image.
    #[must_use]
    pub fn trunk_flop(&self) -> u64 {
        let conv = |side: usize, taps: usize, c_in: usize, c_out: usize| {
            2 * (side * side * taps * c_in * c_out) as u64
        };
        let mut total = conv(112, 49, 3, self.backbone_width);
        for stage in 0..N_STAGES {
            let (side, c) = (56 >> stage, stage_channels(self, stage));
            let c_in = if stage == 0 { c } else { c / 2 };
            let downsample = if stage == 0 { 0 } else { conv(side, 1, c_in, c) };
            total += conv(side, 9, c_in, c) + 3 * conv(side, 9, c, c) + downsample;
        }
        total
    }
}
