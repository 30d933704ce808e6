// What compute.wgsl draws for cameras: front faces in perspective, the id with the greatest 1/z.

// Per sample: the bits of 1/z, which are ordered as the numbers are, above the complement of the id.
@group(0) @binding(6) var<storage, read_write> samples: array<atomic<u64>>;

// The second of a triangle's corners in the order that is clockwise on the image, as y runs down.
const SECOND: u32 = 2u;
// Pixels beyond the image's edges to which triangles are drawn uncut.
const GUARD_PX: f32 = 448.0;

fn keep(view: View, at: vec2u, depth: f32, id: u32) {
    if depth > view.inverse_far {
        let place = (view.first_pixel * ZOOM + at.y * view.side) * ZOOM + at.x;
        atomicMax(&samples[place], (u64(bitcast<u32>(depth)) << 32u) | u64(~id));
    }
}

fn project(view: View, p: vec3f) -> Corner {
    let inverse_z = 1.0 / p.z;
    let px = view.half_px + p.xy * view.focal_px * inverse_z;
    return Corner(vec2i(round(px * 256.0)) * i32(ZOOM), inverse_z);
}

// The planes of the image beyond which a point lies, one bit each.
fn missed(view: View, p: vec3f) -> u32 {
    let edge = view.half_px / view.focal_px * p.z;
    return select(0u, 1u, p.x < -edge) | select(0u, 2u, p.x > edge)
        | select(0u, 4u, p.y < -edge) | select(0u, 8u, p.y > edge)
        | select(0u, 16u, p.z < view.near_m);
}

fn must_be_cut(view: View, p: vec3f) -> bool {
    let guard = guard_slope(view) * p.z;
    return p.z < view.near_m || abs(p.x) > guard || abs(p.y) > guard;
}

fn guard_slope(view: View) -> f32 {
    return (view.half_px + GUARD_PX) / view.focal_px;
}

// Not negative on the inner side of a plane.
fn height_above(view: View, plane: u32, p: vec3f) -> f32 {
    let guard = guard_slope(view) * p.z;
    switch plane {
        case 0u: { return p.z - view.near_m; }
        case 1u: { return guard - p.x; }
        case 2u: { return guard + p.x; }
        case 3u: { return guard - p.y; }
        default: { return guard + p.y; }
    }
}
