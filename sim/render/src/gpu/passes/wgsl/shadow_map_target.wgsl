// Shadow maps, as a target of visibility.wgsl: back faces in orthographic projection; keeps the largest
// height.

// Per texel the bits of the height in [0, 1], whose integer order equals the numeric order.
@group(0) @binding(6) var<storage, read_write> texels: array<atomic<u32>>;

// Index of the second vertex when a back face is traversed clockwise on the map.
const SECOND_VERTEX: u32 = 1u;
// Width of the guard band: triangles are clipped only if they extend farther beyond the map's edges, in
// texels.
const GUARD_TEXELS: f32 = 448.0;

fn write_sample(view: View, at: vec2u, depth: f32, id: u32) {
    if depth > 0.0 && depth < 1.0 {
        atomicMax(&texels[view.first_pixel + at.y * view.size.x + at.x], bitcast<u32>(depth));
    }
}

fn project(view: View, p: vec3f) -> ProjectedVertex {
    return ProjectedVertex(vec2i(round(p.xy * 256.0)), p.z);
}

// Outcode: the edges of the map outside of which a point lies, one bit each.
fn outcode(view: View, p: vec3f) -> u32 {
    let edge = vec2f(view.size);
    return select(0u, 1u, p.x < 0.0) | select(0u, 2u, p.x > edge.x)
        | select(0u, 4u, p.y < 0.0) | select(0u, 8u, p.y > edge.y);
}

fn needs_clipping(view: View, p: vec3f) -> bool {
    let beyond = max(-p.xy, p.xy - vec2f(view.size));
    return max(beyond.x, beyond.y) > GUARD_TEXELS;
}

// Signed distance to a clipping plane, non-negative on the inner side.
fn clip_distance(view: View, plane: u32, p: vec3f) -> f32 {
    let far_edge = vec2f(view.size) + GUARD_TEXELS;
    switch plane {
        case 0u: { return far_edge.x - p.x; }
        case 1u: { return GUARD_TEXELS + p.x; }
        case 2u: { return far_edge.y - p.y; }
        case 3u: { return GUARD_TEXELS + p.y; }
        default: { return 1.0; }
    }
}
