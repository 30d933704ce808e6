// Records of views and instances. The fields and their order must match records.rs.

// Sentinel for a missing texture, shadow map or triangle.
const NONE: u32 = 0xffffffffu;

// Samples per pixel along each axis: 1, or 2 with anti-aliasing.
override SAMPLES_PER_AXIS: u32 = 1u;

struct Sun {
    // Unit vector towards the light, in the view frame.
    towards: vec4f,
    // Irradiance, linear RGB.
    color: vec4f,
}

// A camera image or a shadow map.
struct View {
    focal_px: f32,
    near_m: f32,
    // 1/z of the far clipping plane; samples whose 1/z does not exceed it are discarded.
    inverse_far: f32,
    far_m: f32,
    // Half the width and height of the image.
    half_px: vec2f,
    // Distance along x and y, per unit of radius, by which the centre of a sphere may lie outside an edge of
    // the image while the sphere is still visible.
    sphere_margins: vec2f,
    // Columns and rows in whole tiles, of which the image is the left upper part.
    size: vec2u,
    // Width of the guard band.
    guard_px: f32,
    // 1 for a shadow map, 0 for an image.
    is_shadow_map: u32,
    // Number of pixels of all preceding views of the same kind.
    first_pixel: u32,
    first_instance: u32,
    // View index of the shadow map, or NONE.
    shadow_map: u32,
    first_scene_instance: u32,
    // Number of instances of the scene.
    n_instances: u32,
    first_pose: u32,
    padding_0: u32,
    padding_1: u32,
    // Rows of the transform from the world to the view frame, or to shadow map texels and height.
    view_from_world: array<vec4f, 3>,
    ambient: vec4f,
    suns: array<Sun, 2>,
    // Rows of the transform from the view frame to shadow map texels and height.
    shadow_from_view: array<vec4f, 3>,
}

// A mesh instance in a view.
struct Instance {
    // Rows of the transform from the mesh frame to the view frame, or to shadow map texels and height.
    view_from_mesh: array<vec4f, 3>,
    // Reflectance, linear RGB, and specular reflectance in white, which is 0 for a metal.
    color_specular: vec4f,
    // Texture tiles per mesh unit along each axis.
    tiles: vec3f,
    // Index of the texture, or NONE.
    texture: u32,
    view: u32,
    first_triangle: u32,
    n_triangles: u32,
    // Id of the first triangle. The upper 12 bits hold the instance's index within the view.
    first_id: u32,
    // 1 for a metal, 0 for anything else.
    metallic: f32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

struct Vertex {
    position: vec4f,
    normal: vec4f,
}

// Number of low bits of a triangle id that hold the triangle's index in its mesh. The bits above hold the
// instance's index in its view.
const TRIANGLE_BITS: u32 = 20u;

// Applies an affine transform, given as the rows of a 3 × 4 matrix, to a point.
fn transform_point(map: array<vec4f, 3>, point: vec3f) -> vec3f {
    let p = vec4f(point, 1.0);
    return vec3f(dot(map[0], p), dot(map[1], p), dot(map[2], p));
}

// Rounds to 1/256 px, ties to even.
fn snap_to_grid(px: vec2f) -> vec2f {
    return round(px * 256.0) / 256.0;
}
