// Placement: computes the instances of every view from the resident scenes and the poses of their envs, and
// lists blocks of their triangles for visibility.wgsl, for images and for shadow maps.

@group(0) @binding(0) var<storage, read> views: array<View>;
@group(0) @binding(1) var<storage, read> scene_instances: array<SceneInstance>;
// Rows of the transform to the world per body and link.
@group(0) @binding(2) var<storage, read> poses: array<array<vec4f, 3>>;
// Instances of all views. The instances of a view are in the order of its scene; those that it does not show
// are not written.
@group(0) @binding(3) var<storage, read_write> instances: array<Instance>;
@group(0) @binding(4) var<storage, read_write> image_blocks: BlockList;
@group(0) @binding(5) var<storage, read_write> map_blocks: BlockList;

const TRIANGLES_PER_BLOCK: u32 = 64u;

struct BlockList {
    n: atomic<u32>,
    padding: u32,
    // Instance index and first triangle. The order differs from run to run, which no image depends on.
    blocks: array<vec2u>,
}

// A mesh instance of a scene.
struct SceneInstance {
    // Rows of the transform from the mesh frame to the frame that the instance is attached to.
    anchor_from_mesh: array<vec4f, 3>,
    // Reflectance, linear RGB, and specular reflectance in white, which is 0 for a metal.
    color_specular: vec4f,
    // Texture tiles per mesh unit along each axis.
    tiles: vec3f,
    // Index of the texture, or NONE.
    texture: u32,
    // Bounding sphere in the mesh frame.
    centre: vec3f,
    radius: f32,
    // Index of the frame's pose among those of the env, or NONE for the world.
    pose: u32,
    first_triangle: u32,
    n_triangles: u32,
    // 1 for a metal, 0 for anything else.
    metallic: f32,
    casts_shadow: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

// Composes two transforms: inner applies first.
fn compose(outer: array<vec4f, 3>, inner: array<vec4f, 3>) -> array<vec4f, 3> {
    return array<vec4f, 3>(
        compose_row(outer[0], inner), compose_row(outer[1], inner), compose_row(outer[2], inner));
}

fn compose_row(row: vec4f, inner: array<vec4f, 3>) -> vec4f {
    return row.x * inner[0] + row.y * inner[1] + row.z * inner[2] + vec4f(0.0, 0.0, 0.0, row.w);
}

// Returns the largest of the scale factors along the three input axes.
fn max_scale(map: array<vec4f, 3>) -> f32 {
    let squares = map[0].xyz * map[0].xyz + map[1].xyz * map[1].xyz + map[2].xyz * map[2].xyz;
    return sqrt(max(max(squares.x, squares.y), squares.z));
}

// Returns true if a view may show an instance. The test is conservative.
fn may_show(view: View, source: SceneInstance, view_from_mesh: array<vec4f, 3>) -> bool {
    if view.is_shadow_map == 1u {
        return source.casts_shadow == 1u;
    }
    let p = transform_point(view_from_mesh, source.centre);
    let radius = source.radius * max_scale(view_from_mesh);
    let edge = view.half_px / view.focal_px * p.z + radius * view.sphere_margins;
    return p.z + radius >= view.near_m && p.z - radius <= view.far_m && all(abs(p.xy) <= edge);
}

// One workgroup per view.
@compute @workgroup_size(64)
fn place(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let view = views[group.x];
    for (var i = lane; i < view.n_instances; i += 64u) {
        let source = scene_instances[view.first_scene_instance + i];
        var view_from_mesh = compose(view.view_from_world, source.anchor_from_mesh);
        if source.pose != NONE {
            let world_from_mesh = compose(poses[view.first_pose + source.pose], source.anchor_from_mesh);
            view_from_mesh = compose(view.view_from_world, world_from_mesh);
        }
        if may_show(view, source, view_from_mesh) {
            instances[view.first_instance + i] = Instance(
                view_from_mesh,
                source.color_specular,
                source.tiles,
                source.texture,
                group.x,
                source.first_triangle,
                source.n_triangles,
                i << TRIANGLE_BITS,
                source.metallic,
                0u,
                0u,
                0u);
            list_blocks(view, view.first_instance + i, source.n_triangles);
        }
    }
}

fn list_blocks(view: View, instance_idx: u32, n_triangles: u32) {
    let n_blocks = (n_triangles + TRIANGLES_PER_BLOCK - 1u) / TRIANGLES_PER_BLOCK;
    if view.is_shadow_map == 1u {
        let first = atomicAdd(&map_blocks.n, n_blocks);
        for (var i = 0u; i < n_blocks; i++) {
            map_blocks.blocks[first + i] = vec2u(instance_idx, i * TRIANGLES_PER_BLOCK);
        }
    } else {
        let first = atomicAdd(&image_blocks.n, n_blocks);
        for (var i = 0u; i < n_blocks; i++) {
            image_blocks.blocks[first + i] = vec2u(instance_idx, i * TRIANGLES_PER_BLOCK);
        }
    }
}
