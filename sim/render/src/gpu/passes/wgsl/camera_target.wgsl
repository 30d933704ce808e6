// Camera images, as a target of visibility.wgsl: front faces in perspective; keeps the id with the largest
// 1/z.

// Per sample: the bits of 1/z, whose integer order equals the numeric order, above the complement of the id.
@group(0) @binding(6) var<storage, read_write> samples: array<atomic<u64>>;

// Index of the second vertex when a front face is traversed clockwise in image space (y points down).
const SECOND_VERTEX: u32 = 2u;

fn write_sample(view: View, at: vec2u, depth: f32, id: u32) {
    if depth > view.inverse_far {
        let sample_idx = (view.first_pixel * SAMPLES_PER_AXIS + at.y * view.size.x) * SAMPLES_PER_AXIS + at.x;
        atomicMax(&samples[sample_idx], (u64(bitcast<u32>(depth)) << 32u) | u64(~id));
    }
}

fn project(view: View, p: vec3f) -> ProjectedVertex {
    let inverse_z = 1.0 / p.z;
    let px = view.half_px + p.xy * view.focal_px * inverse_z;
    return ProjectedVertex(vec2i(round(px * 256.0)) * i32(SAMPLES_PER_AXIS), inverse_z);
}

// Outcode: the frustum planes outside of which a point lies, one bit each.
fn outcode(view: View, p: vec3f) -> u32 {
    let edge = view.half_px / view.focal_px * p.z;
    return select(0u, 1u, p.x < -edge.x) | select(0u, 2u, p.x > edge.x)
        | select(0u, 4u, p.y < -edge.y) | select(0u, 8u, p.y > edge.y)
        | select(0u, 16u, p.z < view.near_m);
}

fn needs_clipping(view: View, p: vec3f) -> bool {
    return p.z < view.near_m || any(abs(p.xy) > guard_slopes(view) * p.z);
}

fn guard_slopes(view: View) -> vec2f {
    return (view.half_px + view.guard_px) / view.focal_px;
}

// Signed distance to a clipping plane, non-negative on the inner side, in units that differ by plane.
fn clip_distance(view: View, plane: u32, p: vec3f) -> f32 {
    let guard = guard_slopes(view) * p.z;
    switch plane {
        case 0u: { return p.z - view.near_m; }
        case 1u: { return guard.x - p.x; }
        case 2u: { return guard.x + p.x; }
        case 3u: { return guard.y - p.y; }
        default: { return guard.y + p.y; }
    }
}
