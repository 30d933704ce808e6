//! Layers of a π0.5 network, built from the tensors of a checkpoint.

use super::architecture::Pi05Names;
use crate::nn::Precision;
use crate::nn::norm::LayerNorm;
use crate::nn::projection::Projection;
use crate::weights::{StoredTensor, TensorFolder, WeightsError};

/// Term added to variances and mean squares, in SigLIP and in Gemma.
pub(crate) const EPSILON: f32 = 1e-6;

/// The tensors of a checkpoint and the precision of the layers to build from them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LayerSource<'a> {
    pub(crate) tensors: &'a TensorFolder,
    pub(crate) names: &'a Pi05Names,
    pub(crate) precision: Precision,
}

impl LayerSource<'_> {
    pub(crate) fn tensor(&self, name: &str) -> Result<StoredTensor, WeightsError> {
        self.tensors.tensor(name)
    }

    pub(crate) fn vector(&self, name: &str) -> Result<Vec<f32>, WeightsError> {
        Ok(self.tensor(name)?.values())
    }

    /// Builds a layer without bias.
    pub(crate) fn matrix(&self, name: &str) -> Result<Projection, WeightsError> {
        Ok(Projection::new(self.tensor(name)?, None, self.precision))
    }

    /// Builds a layer from the tensors that `name` returns for `weight` and `bias`.
    pub(crate) fn linear(&self, name: impl Fn(&str) -> String) -> Result<Projection, WeightsError> {
        self.linear_with(name, self.precision)
    }

    /// Like [`linear`](Self::linear), with the weights as stored.
    pub(crate) fn exact_linear(&self, name: impl Fn(&str) -> String) -> Result<Projection, WeightsError> {
        self.linear_with(name, Precision::F32)
    }

    pub(crate) fn layer_norm(&self, name: impl Fn(&str) -> String) -> Result<LayerNorm, WeightsError> {
        let (weight, bias) = (self.vector(&name("weight"))?, self.vector(&name("bias"))?);
        Ok(LayerNorm::with_epsilon(&weight, &bias, EPSILON))
    }

    fn linear_with(
        &self,
        name: impl Fn(&str) -> String,
        precision: Precision,
    ) -> Result<Projection, WeightsError> {
        let (weight, bias) = (self.tensor(&name("weight"))?, self.vector(&name("bias"))?);
        Ok(Projection::new(weight, Some(bias), precision))
    }
}
