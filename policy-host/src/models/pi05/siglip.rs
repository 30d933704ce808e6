//! The vision tower: SigLIP's image encoder (Zhai et al., Sigmoid loss for language image pre-training, 2023)
//! and the projector to the language model. Letters in shapes: `n` images, `p` patches of an image.

use rayon::prelude::*;

use super::architecture::{LayerStack, PATCH_SIDE, VisionSizes};
use super::layers::{AttentionInput, LayerSource, Sequence, add_rows, attend, in_row_blocks};
use crate::nn::gelu::gelu_tanh;
use crate::nn::norm::LayerNorm;
use crate::nn::projection::Projection;
use crate::weights::WeightsError;

/// Values of a patch: three channels of its pixels.
pub(crate) const PATCH_VALUES: usize = 3 * PATCH_SIDE * PATCH_SIDE;

/// The vision tower and the projector.
#[derive(Debug)]
pub(crate) struct VisionTower {
    sizes: VisionSizes,
    patches: Projection,
    /// Learned position embedding `[p, width]`.
    positions: Vec<f32>,
    layers: Vec<VisionLayer>,
    post_norm: LayerNorm,
    projector: Projection,
}

/// A transformer layer with normalisation before attention and before the MLP.
#[derive(Debug)]
struct VisionLayer {
    norm_1: LayerNorm,
    queries: Projection,
    keys: Projection,
    values: Projection,
    out: Projection,
    norm_2: LayerNorm,
    hidden: Projection,
    output: Projection,
}

impl VisionTower {
    pub(crate) fn load(source: LayerSource<'_>, sizes: VisionSizes) -> Result<Self, WeightsError> {
        let names = source.names;
        let layer = |layer: usize| -> Result<VisionLayer, WeightsError> {
            let name = |module: &str| {
                let module = module.to_owned();
                move |tensor: &str| names.layer(LayerStack::Vision, layer, &format!("{module}.{tensor}"))
            };
            Ok(VisionLayer {
                norm_1: source.layer_norm(name("layer_norm1"))?,
                queries: source.linear(name("self_attn.q_proj"))?,
                keys: source.linear(name("self_attn.k_proj"))?,
                values: source.linear(name("self_attn.v_proj"))?,
                out: source.linear(name("self_attn.out_proj"))?,
                norm_2: source.layer_norm(name("layer_norm2"))?,
                hidden: source.linear(name("mlp.fc1"))?,
                output: source.linear(name("mlp.fc2"))?,
            })
        };
        Ok(Self {
            sizes,
            patches: source.exact_linear(|tensor| names.patch_embedding(tensor))?,
            positions: source.vector(&names.position_embedding())?,
            layers: (0..sizes.depth).map(layer).collect::<Result<_, _>>()?,
            post_norm: source.layer_norm(|tensor| names.post_norm(tensor))?,
            projector: source.linear(|tensor| names.projector(tensor))?,
        })
    }

    /// Encodes images `[n, 3, side, side]` with values in [−1, 1] as tokens `[n, p, prefix width]`.
    pub(crate) fn encode(&self, images: &[f32]) -> Vec<f32> {
        let VisionSizes { width, n_patches, .. } = self.sizes;
        let patches = unfold(images, n_patches.isqrt());
        let n_rows = patches.len() / PATCH_VALUES;
        let mut x = vec![0.0; n_rows * width];
        self.patches.forward(&patches, &mut x);
        x.par_chunks_exact_mut(self.positions.len()).for_each(|image| add_rows(image, &self.positions));
        let sequences: Vec<_> = (0..n_rows / n_patches)
            .map(|image| {
                let first = image * n_patches;
                Sequence { first_query: first, n_queries: n_patches, first_key: first, n_keys: n_patches }
            })
            .collect();
        for layer in &self.layers {
            self.attention(layer, &sequences, &mut x);
            self.mlp(layer, &mut x);
        }
        x.par_chunks_exact_mut(width).for_each(|row| self.post_norm.forward(row));
        let mut tokens = vec![0.0; n_rows * self.projector.out_features()];
        self.projector.forward(&x, &mut tokens);
        tokens
    }

    fn attention(&self, layer: &VisionLayer, sequences: &[Sequence], x: &mut [f32]) {
        let VisionSizes { width, n_heads, .. } = self.sizes;
        let mut normed = x.to_vec();
        normed.par_chunks_exact_mut(width).for_each(|row| layer.norm_1.forward(row));
        let project = |projection: &Projection| {
            let mut out = vec![0.0; normed.len()];
            projection.forward(&normed, &mut out);
            out
        };
        let (queries, keys, values) = (project(&layer.queries), project(&layer.keys), project(&layer.values));
        let input = AttentionInput {
            queries: &queries,
            keys: &keys,
            values: &values,
            n_heads,
            head_width: width / n_heads,
            shares_keys: false,
        };
        attend(input, sequences, &mut normed);
        let mut out = queries;
        layer.out.forward(&normed, &mut out);
        add_rows(x, &out);
    }

    fn mlp(&self, layer: &VisionLayer, x: &mut [f32]) {
        let VisionSizes { width, hidden, .. } = self.sizes;
        in_row_blocks(x, width, |x| {
            let n_rows = x.len() / width;
            let mut normed = x.to_vec();
            normed.par_chunks_exact_mut(width).for_each(|row| layer.norm_2.forward(row));
            let mut inner = vec![0.0; n_rows * hidden];
            layer.hidden.forward(&normed, &mut inner);
            inner.par_chunks_exact_mut(hidden).for_each(gelu_tanh);
            layer.output.forward(&inner, &mut normed);
            add_rows(x, &normed);
        });
    }
}

/// Copies the patches of images `[n, 3, side, side]` into rows `[n · p, 3 · PATCH_SIDE²]`.
pub(crate) fn unfold(images: &[f32], n_across: usize) -> Vec<f32> {
    let side = n_across * PATCH_SIDE;
    let mut patches = vec![0.0; images.len()];
    patches.par_chunks_exact_mut(PATCH_VALUES).enumerate().for_each(|(patch, out)| {
        let (image, patch) = (patch / (n_across * n_across), patch % (n_across * n_across));
        let (top, left) = (patch / n_across * PATCH_SIDE, patch % n_across * PATCH_SIDE);
        for (line, out) in out.chunks_exact_mut(PATCH_SIDE).enumerate() {
            let (channel, row) = (line / PATCH_SIDE, line % PATCH_SIDE);
            let start = ((image * 3 + channel) * side + top + row) * side + left;
            out.copy_from_slice(&images[start..start + PATCH_SIDE]);
        }
    });
    patches
}
