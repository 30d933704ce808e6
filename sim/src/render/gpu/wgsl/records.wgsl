// What the CPU says about views and instances: the same fields in the same order as in records.rs.

// No texture, no shadow map, no triangle.
const NONE: u32 = 0xffffffffu;

// Samples per pixel along each axis: 1, or 2 with anti-aliasing.
override ZOOM: u32 = 1u;

struct Sun {
    // Unit vector to the light, in the view frame.
    towards: vec4f,
    // Linear RGB.
    color: vec4f,
}

// A camera's image or a shadow map.
struct View {
    focal_px: f32,
    // Half the image's side.
    half_px: f32,
    near_m: f32,
    // What is not nearer than this 1/z is not drawn.
    inverse_far: f32,
    side: u32,
    // Pixels of the views before this one.
    first_pixel: u32,
    // Its place among the images or among the maps.
    layer: u32,
    first_instance: u32,
    // Index of the shadow map's view, or NONE.
    map: u32,
    spare_0: u32,
    spare_1: u32,
    spare_2: u32,
    ambient: vec4f,
    // The world's up, in the view frame.
    up: vec4f,
    suns: array<Sun, 2>,
    // From the view frame to texels of the shadow map and the height in it.
    map_from_view: array<vec4f, 3>,
}

struct Instance {
    // From the mesh to the view frame, or to texels and height of a shadow map.
    view_from_mesh: array<vec4f, 3>,
    // Linear RGB; the strength of the highlight.
    paint: vec4f,
    // Tiles of the texture per unit of the mesh along each axis.
    tiles: vec3f,
    // Index of the texture, or NONE.
    texture: u32,
    view: u32,
    first_triangle: u32,
    n_triangles: u32,
    // Id of its first triangle: its index within the view in the upper twelve bits.
    first_id: u32,
}

struct Vertex {
    position: vec4f,
    normal: vec4f,
}

// An id is the instance's index in its view above these bits, and the triangle's index in its mesh in them.
const TRIANGLE_BITS: u32 = 20u;

fn moved(map: array<vec4f, 3>, point: vec3f) -> vec3f {
    let p = vec4f(point, 1.0);
    return vec3f(dot(map[0], p), dot(map[1], p), dot(map[2], p));
}

// To 1/256 pixel, ties to even.
fn snapped(px: vec2f) -> vec2f {
    return round(px * 256.0) / 256.0;
}
