// From ids to bytes: one thread per pixel works out what its ray meets and what light comes back along it.

@group(0) @binding(0) var<storage, read> views: array<View>;
@group(0) @binding(1) var<storage, read> instances: array<Instance>;
@group(0) @binding(2) var<storage, read> vertices: array<Vertex>;
// Three vertices each, then the axis it faces: 0 x, 1 y, 2 z.
@group(0) @binding(3) var<storage, read> triangles: array<vec4u>;
// Bytes of all images, `[side, side, 3]` each, one after the other.
@group(0) @binding(5) var<storage, read_write> image: array<u32>;

// Side of the square of pixels that a workgroup makes.
const TILE: u32 = 8u;
// Side of the square of pixels that read a triangle's texture at the level that suits its middle.
const BLOCK: u32 = 4u;

// sRGB of the workgroup's pixels.
var<workgroup> rgb: array<u32, 64>;

@compute @workgroup_size(8, 8)
fn resolve(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) lane: vec3u) {
    let view = views[group.y];
    let tiles_per_row = view.side / TILE;
    if group.x >= tiles_per_row * tiles_per_row {
        return;
    }
    let corner = vec2u(group.x % tiles_per_row, group.x / tiles_per_row) * TILE;
    rgb[lane.y * TILE + lane.x] = pixel(view, corner + lane.xy);
    workgroupBarrier();
    // Eight pixels of three bytes are six words.
    if lane.x < 6u {
        let first_word = ((view.first_pixel + (corner.y + lane.y) * view.side + corner.x) * 3u) / 4u;
        image[first_word + lane.x] = packed(lane.y * TILE, lane.x * 4u);
    }
}

// Four bytes of a row of pixels, from byte `first` on.
fn packed(row: u32, first: u32) -> u32 {
    var word = 0u;
    for (var i = 0u; i < 4u; i++) {
        let byte = first + i;
        word |= ((rgb[row + byte / 3u] >> (8u * (byte % 3u))) & 255u) << (8u * i);
    }
    return word;
}

// sRGB codes of a pixel: the mean of its samples' light, each triangle shaded once.
fn pixel(view: View, at: vec2u) -> u32 {
    var ids: array<u32, 4>;
    var light = vec3f(0.0);
    for (var i = 0u; i < ZOOM * ZOOM; i++) {
        ids[i] = id_at(view, at * ZOOM + vec2u(i % ZOOM, i / ZOOM));
    }
    for (var i = 0u; i < ZOOM * ZOOM; i++) {
        var n = 0u;
        for (var k = 0u; k < ZOOM * ZOOM; k++) {
            n += select(0u, 1u, ids[k] == ids[i]);
            // Counted with an earlier sample.
            if k < i && ids[k] == ids[i] {
                n = 0u;
                break;
            }
        }
        if n > 0u && ids[i] != NONE {
            light += f32(n) * shade(view, ids[i], at);
        }
    }
    let code = vec3u(floor(codes(light / f32(ZOOM * ZOOM)) + 0.5));
    return code.x | (code.y << 8u) | (code.z << 16u);
}

// sRGB of linear light in [0, 1], in codes. The constants are those of srgb.rs.
fn codes(light: vec3f) -> vec3f {
    let root = sqrt(light);
    var curve = vec3f(SQRT_POLYNOMIAL[0]);
    for (var i = 1u; i < 7u; i++) {
        curve = curve * root + SQRT_POLYNOMIAL[i];
    }
    return clamp(select(curve, LINEAR_SEGMENT_SLOPE * light, light < vec3f(LINEAR_SEGMENT_END)), vec3f(0.0), vec3f(255.0));
}

// Linear light, held in [0, 1], that a triangle sends along the ray through a pixel's centre.
fn shade(view: View, id: u32, at: vec2u) -> vec3f {
    let instance = instances[view.first_instance + (id >> TRIANGLE_BITS)];
    let corners = triangles[instance.first_triangle + (id & ((1u << TRIANGLE_BITS) - 1u))];
    let v0 = vertices[corners.x];
    let v1 = vertices[corners.y];
    let v2 = vertices[corners.z];
    let p = on_grid(view, moved(instance.view_from_mesh, v0.position.xyz));
    let e = on_grid(view, moved(instance.view_from_mesh, v1.position.xyz)) - p;
    let f = on_grid(view, moved(instance.view_from_mesh, v2.position.xyz)) - p;
    let px = vec2f(at) + 0.5;
    // With several samples a pixel's centre may lie outside of the triangle.
    let ab = clamp(meet(view, p, e, f, px).ab, vec2f(0.0), vec2f(1.0));
    let point = p + ab.x * e + ab.y * f;
    if point.z * view.inverse_far >= 1.0 {
        return vec3f(0.0);
    }
    let cofactors = cofactors_of(instance.view_from_mesh);
    let n0 = normalize(cofactors * v0.normal.xyz);
    let n1 = normalize(cofactors * v1.normal.xyz);
    let n2 = normalize(cofactors * v2.normal.xyz);
    let normal = normalize(n0 + ab.x * (n1 - n0) + ab.y * (n2 - n0));
    var color = instance.paint.rgb;
    if instance.texture != NONE {
        let points = array<vec3f, 3>(v0.position.xyz, v1.position.xyz, v2.position.xyz);
        let middle = vec2f(at / BLOCK * BLOCK) + 0.5 * f32(BLOCK);
        color *= textured(instance, corners.w, points, ab, meet(view, p, e, f, middle));
    }
    let light = lit(view, color, instance.paint.w, point, normal, -normalize(ray_through(view, px)));
    return clamp(light, vec3f(0.0), vec3f(1.0));
}

// Factors of the instance's texture at ab, from the level that suits the steps of a hit.
fn textured(instance: Instance, facing: u32, points: array<vec3f, 3>, ab: vec2f, hit: Hit) -> vec3f {
    let t = projected(facing, points[0] * instance.tiles);
    let e = projected(facing, points[1] * instance.tiles) - t;
    let f = projected(facing, points[2] * instance.tiles) - t;
    let right = hit.right.x * e + hit.right.y * f;
    let down = hit.down.x * e + hit.down.y * f;
    let footprint = max(dot(right, right), dot(down, down)) * f32(TILE_SIDE * TILE_SIDE);
    return factor(instance.texture, t + ab.x * e + ab.y * f, footprint);
}

// A point without the axis that its triangle faces.
fn projected(facing: u32, p: vec3f) -> vec2f {
    switch facing {
        case 0u: { return p.zy; }
        case 1u: { return p.xz; }
        default: { return p.xy; }
    }
}
