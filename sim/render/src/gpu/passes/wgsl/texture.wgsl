// Repeating square textures, filtered in integer arithmetic.

// Texels of all textures. Rows and columns are extended by eight repeated texels. Red, green and blue from
// the lowest byte up, each the square root of a linear factor.
@group(0) @binding(4) var<storage, read> texels: array<u32>;

// Side of a tile in texels.
const TILE_SIDE: u32 = 256u;
// Distance between the rows of a tile in texels, and their number.
const TILE_PITCH: u32 = 264u;

// Samples a texture at uv, in tiles, with bilinear interpolation. Returns linear RGB factors.
fn sample_texture(texture: u32, uv: vec2f) -> vec3f {
    // In 1/256 texel; texel centres are half a texel from the corner.
    let at = bitcast<vec2u>(vec2i(round(uv * f32(TILE_SIDE * 256u))) - 128);
    let left_upper = (at >> vec2u(8u)) & vec2u(TILE_SIDE - 1u);
    let fraction = at & vec2u(255u);
    let weight_11 = (fraction.x * fraction.y) >> 8u;
    let upper = (texture * TILE_PITCH + left_upper.y) * TILE_PITCH + left_upper.x;
    let lower = upper + TILE_PITCH;
    let value = channels(texels[upper]) * (256u + weight_11 - fraction.x - fraction.y)
        + channels(texels[upper + 1u]) * (fraction.x - weight_11)
        + channels(texels[lower]) * (fraction.y - weight_11)
        + channels(texels[lower + 1u]) * weight_11;
    let root = vec3f(value) / 65280.0;
    return root * root;
}

fn channels(texel: u32) -> vec3u {
    return (vec3u(texel) >> vec3u(0u, 8u, 16u)) & vec3u(255u);
}
