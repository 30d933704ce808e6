// What compute.wgsl left for resolve.wgsl.

// The complement of an id, then the bits of its 1/z; zeros where nothing is.
@group(0) @binding(6) var<storage, read> seen: array<vec2u>;
@group(0) @binding(7) var<storage, read> map_heights: array<u32>;

fn id_at(view: View, at: vec2u) -> u32 {
    return ~seen[(view.first_pixel * ZOOM + at.y * view.side) * ZOOM + at.x].x;
}

fn height_at(map: View, at: vec2u) -> f32 {
    return bitcast<f32>(map_heights[map.first_pixel + at.y * map.side + at.x]);
}
