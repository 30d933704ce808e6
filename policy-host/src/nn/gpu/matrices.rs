//! Cooperative matrices: which of an adapter's shapes the split product uses.

/// Threads of a workgroup of the split product.
const THREADS: u32 = 128;
/// Matrices along each axis of the workgroup's tile of 64 × 64 values that a subgroup computes.
const MATRICES_PER_SUBGROUP: u32 = 2;
/// Side of that tile.
const TILE: u32 = 64;

/// Features that the split product needs.
pub(super) const FEATURES: wgpu::Features = wgpu::Features::SHADER_F16
    .union(wgpu::Features::SUBGROUP)
    .union(wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX);

/// Returns the side of the square matrices of 16-bit floats with sums in f32 of an adapter, if there are such
/// whose subgroups fill a workgroup of the split product.
pub(super) fn side(adapter: &wgpu::Adapter) -> Option<u32> {
    use wgpu::CooperativeScalarType::{F16, F32};
    let info = adapter.get_info();
    if !adapter.features().contains(FEATURES) || info.subgroup_min_size != info.subgroup_max_size {
        return None;
    }
    let fits = |side: &u32| {
        let subgroups = (TILE / (MATRICES_PER_SUBGROUP * side)).pow(2);
        subgroups * info.subgroup_max_size == THREADS
    };
    let is_supported = |side: &u32| {
        adapter.cooperative_matrix_properties().iter().any(|it| {
            [it.m_size, it.n_size, it.k_size] == [*side; 3] && it.ab_type == F16 && it.cr_type == F32
        })
    };
    [16, 8].into_iter().filter(fits).find(is_supported)
}

/// Returns the WGSL source that defines the types of matrices.
pub(super) const fn source(side: u32) -> &'static str {
    if side == 16 { include_str!("wgsl/matrix_16.wgsl") } else { include_str!("wgsl/matrix_8.wgsl") }
}

/// Returns the consent to features that wgpu calls experimental.
pub(super) fn experimental_features() -> wgpu::ExperimentalFeatures {
    // SAFETY: the only experimental feature in `FEATURES` is that of cooperative matrices, which one kernel
    // uses, within the bounds of its workgroup memory and with matrices that the adapter lists.
    unsafe { wgpu::ExperimentalFeatures::enabled() }
}
