//! The vision tower: SigLIP's image encoder (Zhai et al., Sigmoid loss for language image pre-training, 2023)
//! and the projector to the language model. Letters in shapes: `n` images, `p` patches of an image.

use rayon::prelude::*;

use super::architecture::{PATCH_SIDE, SiglipConfig};
use super::checkpoint::names::LayerStack;
use super::layers::{AttentionInput, LayerSource, Sequence, add_rows, attend, in_row_blocks};
use crate::nn::gelu::gelu_tanh;
use crate::nn::norm::LayerNorm;
use crate::nn::projection::Projection;
use crate::weights::WeightsError;

/// Values of a patch: three channels of its pixels.
pub(crate) const PATCH_VALUES: usize = 3 * PATCH_SIDE * PATCH_SIDE;

/// Multi-head self-attention.
#[derive(Debug)]
struct SiglipAttention {
    q_proj: Projection,
    k_proj: Projection,
    v_proj: Projection,
    out_proj: Projection,
    n_heads: usize,
}

/// Two linear layers with a GELU in between.
#[derive(Debug)]
struct SiglipMlp {
    fc1: Projection,
    fc2: Projection,
}

/// A transformer layer with normalisation before attention and before the MLP.
#[derive(Debug)]
struct SiglipEncoderLayer {
    layer_norm1: LayerNorm,
    self_attn: SiglipAttention,
    layer_norm2: LayerNorm,
    mlp: SiglipMlp,
}

/// The vision tower and the projector.
#[derive(Debug)]
pub(crate) struct SiglipVisionModel {
    config: SiglipConfig,
    patch_embedding: Projection,
    /// Learned position embedding `[p, width]`.
    position_embedding: Vec<f32>,
    layers: Vec<SiglipEncoderLayer>,
    post_layernorm: LayerNorm,
    multi_modal_projector: Projection,
}

impl SiglipAttention {
    /// Returns the attention of normalised rows `x [t, width]`, each sequence over itself.
    fn forward(&self, mut x: Vec<f32>, sequences: &[Sequence]) -> Vec<f32> {
        let project = |projection: &Projection| {
            let mut out = vec![0.0; x.len()];
            projection.forward(&x, &mut out);
            out
        };
        let (queries, keys, values) = (project(&self.q_proj), project(&self.k_proj), project(&self.v_proj));
        let input = AttentionInput {
            queries: &queries,
            keys: &keys,
            values: &values,
            n_heads: self.n_heads,
            head_width: self.q_proj.out_features() / self.n_heads,
            shares_keys: false,
        };
        attend(input, sequences, &mut x);
        let mut out = queries;
        self.out_proj.forward(&x, &mut out);
        out
    }
}

impl SiglipMlp {
    /// Computes the MLP of normalised rows `x [t, width]` in place.
    fn forward(&self, x: &mut [f32]) {
        let hidden = self.fc1.out_features();
        let mut inner = vec![0.0; x.len() / self.fc1.in_features() * hidden];
        self.fc1.forward(x, &mut inner);
        inner.par_chunks_exact_mut(hidden).for_each(gelu_tanh);
        self.fc2.forward(&inner, x);
    }
}

impl SiglipEncoderLayer {
    fn load(source: LayerSource<'_>, layer: usize, n_heads: usize) -> Result<Self, WeightsError> {
        let name = |module: &str| {
            let module = module.to_owned();
            move |tensor: &str| source.names.layer(LayerStack::Vision, layer, &format!("{module}.{tensor}"))
        };
        Ok(Self {
            layer_norm1: source.layer_norm(name("layer_norm1"))?,
            self_attn: SiglipAttention {
                q_proj: source.linear(name("self_attn.q_proj"))?,
                k_proj: source.linear(name("self_attn.k_proj"))?,
                v_proj: source.linear(name("self_attn.v_proj"))?,
                out_proj: source.linear(name("self_attn.out_proj"))?,
                n_heads,
            },
            layer_norm2: source.layer_norm(name("layer_norm2"))?,
            mlp: SiglipMlp { fc1: source.linear(name("mlp.fc1"))?, fc2: source.linear(name("mlp.fc2"))? },
        })
    }

    /// Applies the layer to `x [t, width]` in place.
    fn forward(&self, x: &mut [f32], sequences: &[Sequence]) {
        let width = self.mlp.fc1.in_features();
        add_rows(x, &self.self_attn.forward(normalised(&self.layer_norm1, x, width), sequences));
        in_row_blocks(x, width, |x| {
            let mut out = normalised(&self.layer_norm2, x, width);
            self.mlp.forward(&mut out);
            add_rows(x, &out);
        });
    }
}

impl SiglipVisionModel {
    pub(crate) fn load(source: LayerSource<'_>, config: SiglipConfig) -> Result<Self, WeightsError> {
        let names = source.names;
        let layer = |layer| SiglipEncoderLayer::load(source, layer, config.num_attention_heads);
        Ok(Self {
            config,
            patch_embedding: source.exact_linear(|tensor| names.patch_embedding(tensor))?,
            position_embedding: source.vector(&names.position_embedding())?,
            layers: (0..config.num_hidden_layers).map(layer).collect::<Result<_, _>>()?,
            post_layernorm: source.layer_norm(|tensor| names.post_norm(tensor))?,
            multi_modal_projector: source.linear(|tensor| names.projector(tensor))?,
        })
    }

    /// Maps images `[n, 3, side, side]` with values in [−1, 1] to tokens `[n, p, prefix width]`.
    pub(crate) fn forward(&self, images: &[f32]) -> Vec<f32> {
        let SiglipConfig { hidden_size: width, n_patches, .. } = self.config;
        let patches = unfold(images, n_patches.isqrt());
        let n_rows = patches.len() / PATCH_VALUES;
        let mut x = vec![0.0; n_rows * width];
        self.patch_embedding.forward(&patches, &mut x);
        let positions = &self.position_embedding;
        x.par_chunks_exact_mut(positions.len()).for_each(|image| add_rows(image, positions));
        let sequences: Vec<_> = (0..n_rows / n_patches)
            .map(|image| {
                let first = image * n_patches;
                Sequence { first_query: first, n_queries: n_patches, first_key: first, n_keys: n_patches }
            })
            .collect();
        for layer in &self.layers {
            layer.forward(&mut x, &sequences);
        }
        x.par_chunks_exact_mut(width).for_each(|row| self.post_layernorm.forward(row));
        let mut tokens = vec![0.0; n_rows * self.multi_modal_projector.out_features()];
        self.multi_modal_projector.forward(&x, &mut tokens);
        tokens
    }
}

/// Returns the normalised rows of `x [t, width]`.
fn normalised(norm: &LayerNorm, x: &[f32], width: usize) -> Vec<f32> {
    let mut out = x.to_vec();
    out.par_chunks_exact_mut(width).for_each(|row| norm.forward(row));
    out
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
