//! Matrices of products in device memory: in f32, or in 16 bits as a checkpoint stores them.

use gpu::{DeviceBuffer, GpuDevice, GpuError};

use crate::weights::{FloatType, StoredTensor};

/// Weights and bias `[n]` of a product.
#[derive(Clone, Debug)]
pub struct DeviceWeights {
    pub(crate) weights: DeviceBuffer,
    pub(crate) bias: DeviceBuffer,
    pub(crate) k: usize,
    pub(crate) n: usize,
    pub(crate) layout: WeightLayout,
}

/// Order and type of weights in device memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum WeightLayout {
    /// `[k, n]` f32.
    ByInput,
    /// `[n, k]`, as PyTorch stores them. With 16 bits, `k` is even and a word holds two values.
    Stored(FloatType),
}

impl WeightLayout {
    /// Returns the WGSL source that loads the weights, and its constants.
    pub(crate) const fn source(self) -> (&'static str, &'static [(&'static str, usize)]) {
        match self {
            Self::ByInput => (include_str!("wgsl/product/weights.wgsl"), &[]),
            Self::Stored(FloatType::F32) => (include_str!("wgsl/product/stored_weights.wgsl"), &[]),
            Self::Stored(FloatType::F16) => {
                (include_str!("wgsl/product/half_weights.wgsl"), &[("IS_BF16", 0)])
            }
            Self::Stored(FloatType::Bf16) => {
                (include_str!("wgsl/product/half_weights.wgsl"), &[("IS_BF16", 1)])
            }
        }
    }
}

impl DeviceWeights {
    /// Uploads weights `[k, n]`.
    ///
    /// # Panics
    /// If the lengths do not match.
    #[must_use]
    pub fn new(gpu: &GpuDevice, weights: &[f32], bias: &[f32]) -> Self {
        let (k, n) = (weights.len() / bias.len(), bias.len());
        assert_eq!(weights.len(), k * n, "weights [{k}, {n}]");
        let [weights, bias] = [weights, bias].map(|values| DeviceBuffer::of(gpu, "weights", values));
        Self { weights, bias, k, n, layout: WeightLayout::ByInput }
    }

    /// Uploads PyTorch's weights `[n, k]`.
    #[must_use]
    pub fn transposed(gpu: &GpuDevice, weights: &[f32], bias: &[f32]) -> Self {
        let k = weights.len() / bias.len();
        let by_input = (0..k).flat_map(|i| weights.iter().skip(i).step_by(k).copied());
        Self::new(gpu, &by_input.collect::<Vec<_>>(), bias)
    }

    /// Uploads weights `[n, k]` as the bits of bf16 values, with a bias of zeros.
    ///
    /// # Panics
    /// If `k` is odd or does not divide the number of values.
    #[must_use]
    pub fn bf16(gpu: &GpuDevice, k: usize, bits: &[u16]) -> Self {
        let n = bits.len() / k;
        assert!(k.is_multiple_of(2) && bits.len() == n * k, "weights [{n}, {k}]");
        let weights = DeviceBuffer::of(gpu, "weights", bits);
        let bias = DeviceBuffer::zeroed(gpu, "bias", n);
        Self { weights, bias, k, n, layout: WeightLayout::Stored(FloatType::Bf16) }
    }

    /// Uploads stored weights, the rows `[n, k]` of all tensors one after the other; axes after the first are
    /// the input. They keep their type, but for 16-bit weights with an odd `k`, or of several types, which
    /// become f32. `bias [n]` is empty for a layer without one.
    ///
    /// # Errors
    /// If the matrix exceeds what a kernel of the device can use, or the device fails.
    ///
    /// # Panics
    /// If the shapes do not match.
    pub fn stored(gpu: &GpuDevice, tensors: &[StoredTensor], bias: &[f32]) -> Result<Self, GpuError> {
        let k: usize = tensors[0].shape()[1..].iter().product();
        let n = tensors.iter().map(|tensor| tensor.shape()[0]).sum();
        let first = tensors[0].float_type();
        let keeps_type = tensors.iter().all(|tensor| tensor.float_type() == first);
        let float_type = if keeps_type && k.is_multiple_of(2) { first } else { FloatType::F32 };
        let (n_bytes, limit) = ((n * k * float_type.size()) as u64, gpu.max_buffer_bytes());
        if n_bytes > limit {
            let shape = format!("a matrix [{n}, {k}] of {}", float_type.name());
            return Err(gpu.error(&format!("{shape} has {n_bytes} bytes, expected at most {limit}")));
        }
        let weights = DeviceBuffer::zeroed(gpu, "weights", (n_bytes / 4) as usize);
        let mut offset = 0;
        for tensor in tensors {
            assert_eq!(tensor.shape()[1..].iter().product::<usize>(), k, "inputs of matrices side by side");
            if tensor.float_type() == float_type {
                weights.write(gpu, offset, tensor.bytes());
            } else {
                weights.write(gpu, offset, &tensor.values());
            }
            offset += (tensor.shape().iter().product::<usize>() * float_type.size()) as u64;
        }
        let zeros = vec![0.0; n];
        let bias = if bias.is_empty() { &zeros } else { bias };
        assert_eq!(bias.len(), n, "bias of a layer with {n} outputs");
        let bias = DeviceBuffer::of(gpu, "bias", bias);
        gpu.finish_uploads()?;
        Ok(Self { weights, bias, k, n, layout: WeightLayout::Stored(float_type) })
    }
}
