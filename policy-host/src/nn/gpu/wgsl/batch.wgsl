// Number of samples in the batch, for all kernels.
struct Batch { n_samples: u32 }
@group(0) @binding(0) var<uniform> batch: Batch;

