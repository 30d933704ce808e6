//! The tensors of an ACT checkpoint: names and shapes, derived from its configuration, in the order of the reference
//! implementation (PyTorch's state dict of the benchmark's ACT).

use super::config::ActConfig;

/// What a tensor is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Needed to compute actions.
    Live,
    /// Part of the trained network but not of inference: later decoder layers and the training-only encoder. A
    /// checkpoint may leave it out.
    Unused,
}

/// One tensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorSpec {
    /// Its name in `model.safetensors`.
    pub name: String,
    /// Its shape, row-major.
    pub shape: Vec<usize>,
    /// What it is for.
    pub role: Role,
}

/// Blocks of a ResNet-18 stage.
pub const BLOCKS_PER_STAGE: usize = 2;
/// Stages of a ResNet-18.
pub const N_STAGES: usize = 4;
/// Where the backbone's tensors live.
pub const BACKBONE: &str = "backbones.0.0.body";
/// Counters that PyTorch's BatchNorm keeps: accepted in any type and ignored.
pub const IGNORED_SUFFIX: &str = ".num_batches_tracked";

/// Names of the optional normalisation statistics: all of them or none.
pub const STATISTICS: [&str; 4] =
    ["norm_stats.state_mean", "norm_stats.state_std", "norm_stats.action_mean", "norm_stats.action_std"];

/// Channels of a stage's output.
#[must_use]
pub fn stage_channels(config: &ActConfig, stage: usize) -> usize {
    config.backbone_width << stage
}

/// All tensors that a checkpoint of this configuration has, statistics apart.
#[must_use]
pub fn tensor_specs(config: &ActConfig) -> Vec<TensorSpec> {
    let mut list = List { specs: Vec::new(), role: Role::Live };
    list.transformer(config);
    list.heads(config);
    list.backbone(config);
    if let Some(language) = config.language {
        list.language(config.hidden_dim, language.dim);
    }
    list.role = Role::Unused;
    list.variational_encoder(config);
    list.specs
}

struct List {
    specs: Vec<TensorSpec>,
    role: Role,
}

impl List {
    fn add(&mut self, name: String, shape: &[usize]) {
        self.specs.push(TensorSpec { name, shape: shape.to_vec(), role: self.role });
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

    fn encoder_layer(&mut self, name: &str, config: &ActConfig) {
        self.attention(&format!("{name}.self_attn"), config.hidden_dim);
        self.linear(&format!("{name}.linear1"), config.dim_feedforward, config.hidden_dim);
        self.linear(&format!("{name}.linear2"), config.hidden_dim, config.dim_feedforward);
        self.norm(&format!("{name}.norm1"), config.hidden_dim);
        self.norm(&format!("{name}.norm2"), config.hidden_dim);
    }

    fn transformer(&mut self, config: &ActConfig) {
        for layer in 0..config.enc_layers {
            self.encoder_layer(&format!("transformer.encoder.layers.{layer}"), config);
        }
        for layer in 0..config.dec_layers {
            let name = format!("transformer.decoder.layers.{layer}");
            self.role = if layer == 0 { Role::Live } else { Role::Unused };
            self.encoder_layer(&name, config);
            self.attention(&format!("{name}.multihead_attn"), config.hidden_dim);
            self.norm(&format!("{name}.norm3"), config.hidden_dim);
        }
        self.role = Role::Live;
        self.norm("transformer.decoder.norm", config.hidden_dim);
    }

    fn heads(&mut self, config: &ActConfig) {
        let width = config.hidden_dim;
        self.linear("action_head", config.action_dim, width);
        self.add("query_embed.weight".to_owned(), &[config.num_queries, width]);
        self.add("input_proj.weight".to_owned(), &[width, stage_channels(config, N_STAGES - 1), 1, 1]);
        self.add("input_proj.bias".to_owned(), &[width]);
        self.linear("input_proj_robot_state", width, config.state_dim);
        self.add("latent_out_proj.bias".to_owned(), &[width]);
        self.add("additional_pos_embed.weight".to_owned(), &[2, width]);
    }

    fn batch_norm(&mut self, name: &str, width: usize) {
        for part in ["weight", "bias", "running_mean", "running_var"] {
            self.add(format!("{name}.{part}"), &[width]);
        }
    }

    fn backbone(&mut self, config: &ActConfig) {
        let width = config.backbone_width;
        self.add(format!("{BACKBONE}.conv1.weight"), &[width, 3, 7, 7]);
        self.batch_norm(&format!("{BACKBONE}.bn1"), width);
        for stage in 0..N_STAGES {
            let c_out = stage_channels(config, stage);
            for block in 0..BLOCKS_PER_STAGE {
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

    fn language(&mut self, width: usize, embedding: usize) {
        for (linear, norm) in [(0, 2), (3, 5)] {
            self.linear(&format!("lang_proj.{linear}"), embedding, embedding);
            self.norm(&format!("lang_proj.{norm}"), embedding);
        }
        self.linear("lang_proj.6", width, embedding);
    }

    fn variational_encoder(&mut self, config: &ActConfig) {
        let width = config.hidden_dim;
        for layer in 0..config.enc_layers {
            self.encoder_layer(&format!("encoder.layers.{layer}"), config);
        }
        self.add("pos_table".to_owned(), &[1, 2 + config.num_queries, width]);
        self.add("cls_embed.weight".to_owned(), &[1, width]);
        self.linear("encoder_state_proj", width, config.state_dim);
        self.linear("encoder_action_proj", width, config.action_dim);
        self.linear("latent_proj", 2 * ActConfig::LATENT_DIM, width);
        self.add("latent_out_proj.weight".to_owned(), &[width, ActConfig::LATENT_DIM]);
    }
}
