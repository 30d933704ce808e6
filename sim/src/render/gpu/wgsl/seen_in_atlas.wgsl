// What raster.wgsl left for resolve.wgsl.

@group(0) @binding(6) var seen_ids: texture_2d<u32>;
@group(0) @binding(7) var map_heights: texture_depth_2d;

fn id_at(view: View, at: vec2u) -> u32 {
    return textureLoad(seen_ids, view.atlas + at, 0).x;
}

fn height_at(map: View, at: vec2u) -> f32 {
    return textureLoad(map_heights, map.atlas + at, 0);
}
