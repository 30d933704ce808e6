//! The action expert: Euler steps from noise to actions, in place.

use super::gemma::{LayerWeights, StackBuffers};
use super::runs::{BatchUnit, RunBuilder};
use crate::models::LoadGpuError;
use crate::models::pi05::architecture::GemmaConfig;
use crate::models::pi05::checkpoint::names::LayerStack;
use crate::models::pi05::expert::Modulation;
use crate::nn::gpu::DeviceBuffer;
use crate::nn::gpu::ops::{DeviceWeights, ProductEpilogue};
use crate::nn::gpu::sequences::{SequenceInput, SequenceShape};

/// Input of the action expert.
pub(crate) struct ExpertInput<'a> {
    /// Actions `[samples, horizon, action_width]`, noise at first.
    pub(crate) actions: &'a DeviceBuffer,
    pub(crate) action_width: usize,
    /// Keys and values of the prefix, by layer.
    pub(crate) cache: &'a [DeviceBuffer],
    /// Cosines and sines of all positions.
    pub(crate) angles: &'a DeviceBuffer,
    /// Normalisations of every Euler step.
    pub(crate) modulations: &'a [Vec<Modulation>],
}

/// An adaptive normalisation at one time.
struct DeviceModulation {
    scale: DeviceBuffer,
    shift: DeviceBuffer,
    gate: DeviceBuffer,
}

impl RunBuilder<'_> {
    /// Adds all Euler steps.
    pub(crate) fn expert(
        &mut self,
        stack: &StackBuffers,
        input: &ExpertInput<'_>,
    ) -> Result<(), LoadGpuError> {
        let GemmaConfig { num_hidden_layers: depth, head_dim: head_width, .. } = stack.config;
        let names = self.source.names;
        let root = |module: &str, tensor: &str| names.root(&format!("{module}.{tensor}"));
        let action_in_proj = self.linear(&["action_in_proj"], root)?;
        let action_out_proj = self.linear(&["action_out_proj"], root)?;
        let layer = |idx: usize| -> Result<_, LoadGpuError> {
            let part = LayerStack::Expert;
            Ok((self.key_weights(part, idx)?, self.layer_weights(part, idx)?))
        };
        let layers = (0..depth).map(layer).collect::<Result<Vec<_>, _>>()?;
        let keys = self.buffer("suffix keys", BatchUnit::Sample, stack.n_rows * 2 * head_width);
        let n_values = stack.n_rows * input.action_width;
        let velocity = self.buffer("velocity", BatchUnit::Sample, n_values);
        let step_size = (-1.0 / input.modulations.len() as f64) as f32;
        self.count(BatchUnit::Sample);
        for modulations in input.modulations {
            let modulations: Vec<_> = modulations.iter().map(|one| self.modulation(one)).collect();
            self.multiply(&action_in_proj, stack.n_rows, (input.actions, &stack.x), ProductEpilogue::Store);
            for (idx, weights) in layers.iter().enumerate() {
                let norms = [&modulations[2 * idx], &modulations[2 * idx + 1]];
                self.expert_layer(weights, norms, stack, (input, idx), &keys)?;
            }
            let last = &modulations[2 * depth];
            self.rms_norm(stack, (&last.scale, &last.shift));
            self.multiply(&action_out_proj, stack.n_rows, (&stack.normed, &velocity), ProductEpilogue::Store);
            let step = self.ops.add_scaled(step_size, n_values, &velocity, input.actions);
            self.push(step);
        }
        Ok(())
    }

    fn expert_layer(
        &mut self,
        (key_weights, weights): &(DeviceWeights, LayerWeights),
        [input_layernorm, post_attention_layernorm]: [&DeviceModulation; 2],
        stack: &StackBuffers,
        (input, layer): (&ExpertInput<'_>, usize),
        keys: &DeviceBuffer,
    ) -> Result<(), LoadGpuError> {
        let GemmaConfig { num_attention_heads: n_heads, head_dim: head_width, .. } = stack.config;
        let n_rows = stack.n_rows;
        self.rms_norm(stack, (&input_layernorm.scale, &input_layernorm.shift));
        self.store_keys(key_weights, stack, input.angles, keys);
        self.store_queries(weights, stack, input.angles);
        let shape =
            SequenceShape { n_heads, head_width, shares_keys: true, max_queries: n_rows, suffix: n_rows };
        let (queries, spans) = (&stack.queries, &stack.spans);
        let prefix = &input.cache[layer];
        self.attend(shape, SequenceInput { queries, prefix, suffix: keys, spans }, &stack.heads)?;
        let step =
            self.ops.gated_linear(&weights.o_proj, n_rows, &stack.heads, &input_layernorm.gate, &stack.x);
        self.push(step);
        self.rms_norm(stack, (&post_attention_layernorm.scale, &post_attention_layernorm.shift));
        self.hidden(weights, stack);
        let step = self.ops.gated_linear(
            &weights.down_proj,
            n_rows,
            &stack.hidden,
            &post_attention_layernorm.gate,
            &stack.x,
        );
        self.push(step);
        Ok(())
    }

    fn modulation(&self, modulation: &Modulation) -> DeviceModulation {
        DeviceModulation {
            scale: self.constant("scale", &modulation.scale),
            shift: self.constant("shift", &modulation.shift),
            gate: self.constant("gate", &modulation.gate),
        }
    }
}
