// Result of compute.wgsl, as input of shading.wgsl.

// Complement of the id, then the bits of 1/z; zero for samples without a triangle.
@group(0) @binding(6) var<storage, read> samples: array<vec2u>;
@group(0) @binding(7) var<storage, read> shadow_heights: array<u32>;

fn id_at(view: View, at: vec2u) -> u32 {
    return ~samples[(view.first_pixel * SAMPLES_PER_AXIS + at.y * view.side) * SAMPLES_PER_AXIS + at.x].x;
}

fn height_at(map: View, at: vec2u) -> f32 {
    return bitcast<f32>(shadow_heights[map.first_pixel + at.y * map.side + at.x]);
}
