// Repeating square textures with mip levels, filtered in integer arithmetic.

// Texels of all textures. Each texture stores its mip levels from the finest to the coarsest; rows and
// columns are extended by eight repeated texels. Red, green and blue from the lowest byte up, each the square
// root of a linear factor.
@group(0) @binding(4) var<storage, read> texels: array<u32>;

// Side of level 0 in texels.
const TILE_SIDE: u32 = 256u;
const LAST_LEVEL: u32 = 8u;
// Repeated texels at the end of each row and column.
const APRON: u32 = 8u;
// Words per texture: the sum of (side + 8)² over all levels.
const TILE_WORDS: u32 = 96133u;

// Returns the number of words before a level: the sum of s² + 16 s + 64 over the sides s of all finer levels,
// which are powers of two.
fn level_offset(level: u32) -> u32 {
    let side = TILE_SIDE >> level;
    return (TILE_SIDE * TILE_SIDE - side * side) * 4u / 3u
        + 4u * APRON * (TILE_SIDE - side)
        + APRON * APRON * level;
}

// Samples a texture at uv, in tiles, for a pixel whose longer side spans √footprint texels. Returns linear
// RGB factors.
fn sample_texture(texture: u32, uv: vec2f, footprint: f32) -> vec3f {
    let clamped = clamp(footprint, 1.0, f32(TILE_SIDE * TILE_SIDE) * 0.999);
    let level = (bitcast<u32>(clamped) - bitcast<u32>(1.0)) >> 16u;
    let base = level >> 8u;
    let blend = u32(clamp((i32(level & 255u) - 96) * 4, 0, 256));
    let at = vec2i(round(uv * f32((TILE_SIDE >> base) * 256u)));
    var value = bilinear(texture, base, at);
    if blend > 0u {
        value = (value * (256u - blend) + bilinear(texture, base + 1u, at >> vec2u(1u)) * blend) >> vec3u(8u);
    }
    let root = vec3f(value) / 65280.0;
    return root * root;
}

// Bilinear interpolation at a point given in 1/256 texel of a level. Results are in [0, 65280].
fn bilinear(texture: u32, level: u32, point: vec2i) -> vec3u {
    let side = TILE_SIDE >> level;
    // Texel centres are half a texel from the corner.
    let at = bitcast<vec2u>(point - 128);
    let left_upper = (at >> vec2u(8u)) & vec2u(side - 1u);
    let fraction = at & vec2u(255u);
    let weight_11 = (fraction.x * fraction.y) >> 8u;
    let pitch = side + APRON;
    let upper = texture * TILE_WORDS + level_offset(level) + left_upper.y * pitch + left_upper.x;
    let lower = upper + pitch;
    return channels(texels[upper]) * (256u + weight_11 - fraction.x - fraction.y)
        + channels(texels[upper + 1u]) * (fraction.x - weight_11)
        + channels(texels[lower]) * (fraction.y - weight_11)
        + channels(texels[lower + 1u]) * weight_11;
}

fn channels(texel: u32) -> vec3u {
    return (vec3u(texel) >> vec3u(0u, 8u, 16u)) & vec3u(255u);
}
