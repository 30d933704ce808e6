//! Names and shapes of the tensors that inference needs, derived from the architecture, in the order of the
//! benchmark's reference implementation.

use crate::models::act::architecture::{Architecture, ResNet, TokenProjection};
use crate::weights::TensorSpec;

/// Name prefix of the backbone's tensors.
pub const BACKBONE: &str = "backbones.0.0.body";

/// Returns the specs of all tensors, under the names of the benchmark's checkpoints.
#[must_use]
pub fn tensor_specs(architecture: &Architecture) -> Vec<TensorSpec> {
    let mut list = SpecList { specs: Vec::new() };
    list.transformer(architecture);
    list.heads(architecture);
    if !architecture.cameras.is_empty() {
        list.backbone(architecture.backbone);
    }
    list.instruction(architecture);
    list.specs
}

struct SpecList {
    specs: Vec<TensorSpec>,
}

impl SpecList {
    fn add(&mut self, name: String, shape: &[usize]) {
        self.specs.push(TensorSpec { name, shape: shape.to_vec() });
    }

    fn linear(&mut self, name: &str, n_out: usize, n_in: usize) {
        self.add(format!("{name}.weight"), &[n_out, n_in]);
        self.add(format!("{name}.bias"), &[n_out]);
    }

    fn norm(&mut self, name: &str, width: usize) {
        self.add(format!("{name}.weight"), &[width]);
        self.add(format!("{name}.bias"), &[width]);
    }

    fn attention(&mut self, name: &str, width: usize) {
        self.add(format!("{name}.in_proj_weight"), &[3 * width, width]);
        self.add(format!("{name}.in_proj_bias"), &[3 * width]);
        self.linear(&format!("{name}.out_proj"), width, width);
    }

    fn encoder_layer(&mut self, name: &str, architecture: &Architecture) {
        let (width, inner) = (architecture.hidden_dim, architecture.dim_feedforward);
        self.attention(&format!("{name}.self_attn"), width);
        self.linear(&format!("{name}.linear1"), inner, width);
        self.linear(&format!("{name}.linear2"), width, inner);
        self.norm(&format!("{name}.norm1"), width);
        self.norm(&format!("{name}.norm2"), width);
    }

    fn transformer(&mut self, architecture: &Architecture) {
        let width = architecture.hidden_dim;
        for layer in 0..architecture.enc_layers {
            self.encoder_layer(&format!("transformer.encoder.layers.{layer}"), architecture);
        }
        for layer in 0..architecture.dec_layers {
            let name = format!("transformer.decoder.layers.{layer}");
            self.encoder_layer(&name, architecture);
            self.attention(&format!("{name}.multihead_attn"), width);
            self.norm(&format!("{name}.norm3"), width);
        }
        self.norm("transformer.decoder.norm", width);
    }

    fn heads(&mut self, architecture: &Architecture) {
        let width = architecture.hidden_dim;
        self.linear("action_head", architecture.action_dim, width);
        self.add("query_embed.weight".to_owned(), &[architecture.horizon, width]);
        if !architecture.cameras.is_empty() {
            self.add("input_proj.weight".to_owned(), &[width, architecture.backbone.n_features(), 1, 1]);
            self.add("input_proj.bias".to_owned(), &[width]);
        }
        if let Some(state_dim) = architecture.state_dim {
            self.linear("input_proj_robot_state", width, state_dim);
        }
        self.add("latent_out_proj.bias".to_owned(), &[width]);
        self.add("additional_pos_embed.weight".to_owned(), &[architecture.n_learned_positions(), width]);
    }

    fn batch_norm(&mut self, name: &str, width: usize) {
        for part in ["weight", "bias", "running_mean", "running_var"] {
            self.add(format!("{name}.{part}"), &[width]);
        }
    }

    fn backbone(&mut self, backbone: ResNet) {
        self.add(format!("{BACKBONE}.conv1.weight"), &[backbone.width, 3, 7, 7]);
        self.batch_norm(&format!("{BACKBONE}.bn1"), backbone.width);
        for (stage, n_blocks) in backbone.blocks.into_iter().enumerate() {
            let c_out = backbone.channels(stage);
            for block in 0..n_blocks {
                let first = block == 0 && stage > 0;
                let c_in = if first { c_out / 2 } else { c_out };
                let name = format!("{BACKBONE}.layer{}.{block}", stage + 1);
                self.add(format!("{name}.conv1.weight"), &[c_out, c_in, 3, 3]);
                self.batch_norm(&format!("{name}.bn1"), c_out);
                self.add(format!("{name}.conv2.weight"), &[c_out, c_out, 3, 3]);
                self.batch_norm(&format!("{name}.bn2"), c_out);
                if first {
                    self.add(format!("{name}.downsample.0.weight"), &[c_out, c_in, 1, 1]);
                    self.batch_norm(&format!("{name}.downsample.1"), c_out);
                }
            }
        }
    }

    fn instruction(&mut self, architecture: &Architecture) {
        let Some(input) = architecture.instruction else { return };
        match input.projection {
            TokenProjection::Linear => {
                self.linear("input_proj_env_state", architecture.hidden_dim, input.dim);
            }
            TokenProjection::Mlp => {
                for (linear, norm) in [(0, 2), (3, 5)] {
                    self.linear(&format!("lang_proj.{linear}"), input.dim, input.dim);
                    self.norm(&format!("lang_proj.{norm}"), input.dim);
                }
                self.linear("lang_proj.6", architecture.hidden_dim, input.dim);
            }
        }
    }
}
