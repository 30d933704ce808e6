// Result of raster.wgsl, as input of shading.wgsl.

@group(0) @binding(6) var triangle_ids: texture_2d_array<u32>;
@group(0) @binding(7) var shadow_heights: texture_depth_2d_array;

fn id_at(view: View, at: vec2u) -> u32 {
    return textureLoad(triangle_ids, at, view.layer, 0).x;
}

fn height_at(map: View, at: vec2u) -> f32 {
    return textureLoad(shadow_heights, at, map.layer, 0);
}
