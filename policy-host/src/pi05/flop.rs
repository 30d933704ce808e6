//! Operation count of a query.

use super::architecture::{GemmaSizes, PATCH_SIDE, Pi05Architecture, VisionSizes};

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
