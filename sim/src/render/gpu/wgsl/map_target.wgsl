// What compute.wgsl draws for shadow maps: back faces along the light, the greatest height.

// Per texel the bits of the height, in [0, 1] and ordered as the numbers are.
@group(0) @binding(6) var<storage, read_write> texels: array<atomic<u32>>;

// The second of a triangle's corners in the order that is clockwise on the map when it is seen from behind.
const SECOND: u32 = 1u;
// Texels beyond the map's edges to which triangles are drawn uncut.
const GUARD: f32 = 448.0;

fn keep(view: View, at: vec2u, depth: f32, id: u32) {
    if depth > 0.0 && depth < 1.0 {
        atomicMax(&texels[view.first_pixel + at.y * view.side + at.x], bitcast<u32>(depth));
    }
}

fn project(view: View, p: vec3f) -> Corner {
    return Corner(vec2i(round(p.xy * 256.0)), p.z);
}

// The edges of the map beyond which a point lies, one bit each.
fn missed(view: View, p: vec3f) -> u32 {
    let side = f32(view.side);
    return select(0u, 1u, p.x < 0.0) | select(0u, 2u, p.x > side)
        | select(0u, 4u, p.y < 0.0) | select(0u, 8u, p.y > side);
}

fn must_be_cut(view: View, p: vec3f) -> bool {
    let beyond = max(-p.xy, p.xy - f32(view.side));
    return max(beyond.x, beyond.y) > GUARD;
}

// Not negative on the inner side of a plane.
fn height_above(view: View, plane: u32, p: vec3f) -> f32 {
    let far_edge = f32(view.side) + GUARD;
    switch plane {
        case 0u: { return far_edge - p.x; }
        case 1u: { return GUARD + p.x; }
        case 2u: { return far_edge - p.y; }
        case 3u: { return GUARD + p.y; }
        default: { return 1.0; }
    }
}
