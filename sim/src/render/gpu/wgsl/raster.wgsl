// Visibility by the rasteriser: ids of what an image shows, heights in a shadow map, the greatest 1/z or height on top.

enable primitive_index;

@group(0) @binding(0) var<storage, read> views: array<View>;
@group(0) @binding(1) var<storage, read> instances: array<Instance>;
@group(0) @binding(2) var<storage, read> vertices: array<Vertex>;
// Indices into instances, those of one mesh together.
@group(0) @binding(3) var<storage, read> drawn: array<u32>;

struct Projected {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) first_id: u32,
}

// A point at px, in pixels of its view times w.
fn placed(view: View, px: vec2f, depth: f32, w: f32, first_id: u32) -> Projected {
    let at = px / view.half_px;
    return Projected(vec4f(at.x - w, w - at.y, depth, w), first_id);
}

@vertex
fn camera_corner(@builtin(vertex_index) vertex: u32, @builtin(instance_index) i: u32) -> Projected {
    let instance = instances[drawn[i]];
    let view = views[instance.view];
    let p = moved(instance.view_from_mesh, vertices[vertex].position.xyz);
    var px = view.half_px * p.z + view.focal_px * p.xy;
    if p.z >= view.near_m {
        px = snapped(view.half_px + p.xy * view.focal_px / p.z) * p.z;
    }
    // The depth buffer then holds near/z, which runs linearly over the image as 1/z does.
    return placed(view, px, view.near_m, p.z, instance.first_id);
}

@vertex
fn map_corner(@builtin(vertex_index) vertex: u32, @builtin(instance_index) i: u32) -> Projected {
    let instance = instances[drawn[i]];
    let p = moved(instance.view_from_mesh, vertices[vertex].position.xyz);
    return placed(views[instance.view], snapped(p.xy), p.z, 1.0, 0u);
}

@fragment
fn id(@location(0) @interpolate(flat) first_id: u32, @builtin(primitive_index) triangle: u32) -> @location(0) u32 {
    return first_id + triangle;
}
