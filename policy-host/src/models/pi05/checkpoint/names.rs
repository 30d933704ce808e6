//! Names of the tensors in a π0.5 checkpoint.

use crate::weights::TensorFolder;

/// Prefix of the names of the two language models and the vision tower.
const JOINT: &str = "paligemma_with_expert.";

/// Names of a checkpoint's tensors.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pi05Names {
    /// `model.` in LeRobot's checkpoints, nothing in openpi's.
    root: &'static str,
    /// `true` if the embedding is stored as the output layer with which it shares its weights.
    tied: bool,
}

/// The three stacks of layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LayerStack {
    Vision,
    Prefix,
    Expert,
}

impl Pi05Names {
    /// LeRobot's names.
    pub const LEROBOT: Self = Self { root: "model.", tied: false };

    /// Recognises LeRobot's and openpi's names.
    #[must_use]
    pub fn of(tensors: &TensorFolder) -> Self {
        let is_lerobot = tensors.names().any(|name| name.starts_with("model.paligemma_with_expert."));
        let names = Self { root: if is_lerobot { "model." } else { "" }, tied: false };
        let tied = tensors.shape(&names.embedding()).is_none();
        Self { tied, ..names }
    }

    /// Returns `true` for a tensor that only training uses: output layers over words, and the last norm of
    /// the language model.
    #[must_use]
    pub fn is_unused(&self, name: &str) -> bool {
        name.strip_prefix(self.root).and_then(|name| name.strip_prefix(JOINT)).is_some_and(|name| {
            [
                "paligemma.lm_head.weight",
                "paligemma.model.language_model.norm.weight",
                "paligemma.model.language_model.embed_tokens.weight",
                "gemma_expert.lm_head.weight",
                "gemma_expert.model.embed_tokens.weight",
            ]
            .contains(&name)
                || name.starts_with("paligemma.model.vision_tower.vision_model.head.")
        })
    }

    pub(crate) fn root(&self, name: &str) -> String {
        format!("{}{name}", self.root)
    }

    pub(crate) fn layer(&self, part: LayerStack, layer: usize, name: &str) -> String {
        let stack = match part {
            LayerStack::Vision => "paligemma.model.vision_tower.vision_model.encoder",
            LayerStack::Prefix => "paligemma.model.language_model",
            LayerStack::Expert => "gemma_expert.model",
        };
        format!("{}{JOINT}{stack}.layers.{layer}.{name}", self.root)
    }

    pub(crate) fn patch_embedding(&self, name: &str) -> String {
        format!(
            "{}{JOINT}paligemma.model.vision_tower.vision_model.embeddings.patch_embedding.{name}",
            self.root
        )
    }

    pub(crate) fn position_embedding(&self) -> String {
        format!(
            "{}{JOINT}paligemma.model.vision_tower.vision_model.embeddings.position_embedding.weight",
            self.root
        )
    }

    pub(crate) fn post_norm(&self, name: &str) -> String {
        format!("{}{JOINT}paligemma.model.vision_tower.vision_model.post_layernorm.{name}", self.root)
    }

    pub(crate) fn projector(&self, name: &str) -> String {
        format!("{}{JOINT}paligemma.model.multi_modal_projector.linear.{name}", self.root)
    }

    pub(crate) fn embedding(&self) -> String {
        let name =
            if self.tied { "paligemma.lm_head" } else { "paligemma.model.language_model.embed_tokens" };
        format!("{}{JOINT}{name}.weight", self.root)
    }

    pub(crate) fn expert_norm(&self, name: &str) -> String {
        format!("{}{JOINT}gemma_expert.model.norm.dense.{name}", self.root)
    }
}
