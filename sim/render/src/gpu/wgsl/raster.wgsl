// Visibility pass on the hardware rasteriser: triangle ids of images and heights of shadow maps. The largest
// 1/z or height wins the depth test.

enable primitive_index;

@group(0) @binding(0) var<storage, read> views: array<View>;
@group(0) @binding(1) var<storage, read> instances: array<Instance>;
@group(0) @binding(2) var<storage, read> vertices: array<Vertex>;

struct VertexOutput {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) first_id: u32,
}

// Converts a position px, in pixels of the view times w, to clip space.
fn to_clip_space(view: View, px: vec2f, depth: f32, w: f32, first_id: u32) -> VertexOutput {
    let at = px / view.half_px;
    return VertexOutput(vec4f(at.x - w, w - at.y, depth, w), first_id);
}

@vertex
fn camera_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) i: u32) -> VertexOutput {
    let instance = instances[i];
    let view = views[instance.view];
    let p = transform_point(instance.view_from_mesh, vertices[vertex].position.xyz);
    var px = view.half_px * p.z + view.focal_px * p.xy;
    if p.z >= view.near_m {
        px = snap_to_grid(view.half_px + p.xy * view.focal_px / p.z) * p.z;
    }
    // The depth buffer then holds near/z, which is linear in image space, like 1/z.
    return to_clip_space(view, px, view.near_m, p.z, instance.first_id);
}

@vertex
fn shadow_map_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) i: u32) -> VertexOutput {
    let instance = instances[i];
    let p = transform_point(instance.view_from_mesh, vertices[vertex].position.xyz);
    return to_clip_space(views[instance.view], snap_to_grid(p.xy), p.z, 1.0, 0u);
}

@fragment
fn triangle_id(@location(0) @interpolate(flat) first_id: u32, @builtin(primitive_index) triangle: u32) -> @location(0) u32 {
    return first_id + triangle;
}
