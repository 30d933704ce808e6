// Output of placement.wgsl for raster.wgsl: one indirect draw call per instance, which draws nothing if the
// view does not show it.

@group(0) @binding(4) var<storage, read_write> draws: array<DrawCall>;

// Arguments of an indexed indirect draw call.
struct DrawCall {
    n_indices: u32,
    n_instances: u32,
    first_index: u32,
    base_vertex: i32,
    first_instance: u32,
}

fn list_instance(view: View, instance_idx: u32, source: SceneInstance, is_shown: bool) {
    let n_indices = select(0u, 3u * source.n_triangles, is_shown);
    draws[instance_idx] = DrawCall(n_indices, 1u, 3u * source.first_triangle, 0i, instance_idx);
}
