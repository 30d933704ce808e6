// Deferred shading: each thread intersects the ray of one pixel with its visible triangles, shades the hit
// points and writes sRGB bytes.

@group(0) @binding(0) var<storage, read> views: array<View>;
@group(0) @binding(1) var<storage, read> instances: array<Instance>;
@group(0) @binding(2) var<storage, read> vertices: array<Vertex>;
// Three vertex indices and the texture projection axis (0 x, 1 y, 2 z) per triangle.
@group(0) @binding(3) var<storage, read> triangles: array<vec4u>;
// Result of visibility.wgsl in images: the complement of the id, then the bits of 1/z; zero for samples
// without a triangle.
@group(0) @binding(5) var<storage, read> samples: array<vec2u>;
// sRGB bytes of all images in whole tiles, `[height, width, 3]` each, stored consecutively.
@group(0) @binding(7) var<storage, read_write> image: array<u32>;

// Side of the pixel tile that a workgroup shades.
const TILE: u32 = 8u;

// sRGB codes of the workgroup's pixels.
var<workgroup> tile_rgb: array<u32, 64>;

@compute @workgroup_size(8, 8)
fn shade_tile(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) lane: vec3u) {
    let view = views[group.y];
    let tiles = view.size / TILE;
    if group.x >= tiles.x * tiles.y {
        return;
    }
    let corner = vec2u(group.x % tiles.x, group.x / tiles.x) * TILE;
    tile_rgb[lane.y * TILE + lane.x] = shade_pixel(view, corner + lane.xy);
    workgroupBarrier();
    // A row of eight pixels with three bytes each is six words.
    if lane.x < 6u {
        let first_word = ((view.first_pixel + (corner.y + lane.y) * view.size.x + corner.x) * 3u) / 4u;
        image[first_word + lane.x] = pack_bytes(lane.y * TILE, lane.x * 4u);
    }
}

// Packs four bytes of a row of pixels, starting at byte `first`.
fn pack_bytes(row: u32, first: u32) -> u32 {
    var word = 0u;
    for (var i = 0u; i < 4u; i++) {
        let byte = first + i;
        word |= ((tile_rgb[row + byte / 3u] >> (8u * (byte % 3u))) & 255u) << (8u * i);
    }
    return word;
}

// Returns the packed sRGB codes of a pixel: the mean radiance of its samples, where each triangle is shaded
// once.
fn shade_pixel(view: View, at: vec2u) -> u32 {
    var ids: array<u32, 4>;
    var light = vec3f(0.0);
    for (var i = 0u; i < SAMPLES_PER_AXIS * SAMPLES_PER_AXIS; i++) {
        ids[i] = id_at(view, at * SAMPLES_PER_AXIS + vec2u(i % SAMPLES_PER_AXIS, i / SAMPLES_PER_AXIS));
    }
    for (var i = 0u; i < SAMPLES_PER_AXIS * SAMPLES_PER_AXIS; i++) {
        var n = 0u;
        for (var k = 0u; k < SAMPLES_PER_AXIS * SAMPLES_PER_AXIS; k++) {
            n += select(0u, 1u, ids[k] == ids[i]);
            // An earlier sample has counted this triangle.
            if k < i && ids[k] == ids[i] {
                n = 0u;
                break;
            }
        }
        if n > 0u && ids[i] != NONE {
            light += f32(n) * shade_triangle(view, ids[i], at);
        }
    }
    let code = vec3u(floor(srgb_codes(light / f32(SAMPLES_PER_AXIS * SAMPLES_PER_AXIS)) + 0.5));
    return code.x | (code.y << 8u) | (code.z << 16u);
}

fn id_at(view: View, at: vec2u) -> u32 {
    return ~samples[(view.first_pixel * SAMPLES_PER_AXIS + at.y * view.size.x) * SAMPLES_PER_AXIS + at.x].x;
}

// Encodes linear values in [0, 1] as sRGB codes in [0, 255]. The constants are those of srgb.rs.
fn srgb_codes(light: vec3f) -> vec3f {
    let root = sqrt(light);
    var curve = vec3f(SQRT_POLYNOMIAL[0]);
    for (var i = 1u; i < 7u; i++) {
        curve = curve * root + SQRT_POLYNOMIAL[i];
    }
    return clamp(select(curve, LINEAR_SEGMENT_SLOPE * light, light < vec3f(LINEAR_SEGMENT_END)), vec3f(0.0), vec3f(255.0));
}

// Returns the linear radiance, clamped to [0, 1], of a triangle along the ray through a pixel's centre.
fn shade_triangle(view: View, id: u32, at: vec2u) -> vec3f {
    let instance = instances[view.first_instance + (id >> TRIANGLE_BITS)];
    let corners = triangles[instance.first_triangle + (id & ((1u << TRIANGLE_BITS) - 1u))];
    let v0 = vertices[corners.x];
    let v1 = vertices[corners.y];
    let v2 = vertices[corners.z];
    let p = snap_vertex(view, transform_point(instance.view_from_mesh, v0.position.xyz));
    let e = snap_vertex(view, transform_point(instance.view_from_mesh, v1.position.xyz)) - p;
    let f = snap_vertex(view, transform_point(instance.view_from_mesh, v2.position.xyz)) - p;
    let px = vec2f(at) + 0.5;
    // With several samples per pixel, the pixel's centre may lie outside of the triangle.
    let ab = intersect(view, p, e, f, px);
    let point = p + ab.x * e + ab.y * f;
    if point.z * view.inverse_far >= 1.0 {
        return vec3f(0.0);
    }
    let cofactors = cofactor_matrix(instance.view_from_mesh);
    let n0 = normalize(cofactors * v0.normal.xyz);
    let n1 = normalize(cofactors * v1.normal.xyz);
    let n2 = normalize(cofactors * v2.normal.xyz);
    let normal = normalize(n0 + ab.x * (n1 - n0) + ab.y * (n2 - n0));
    var color = instance.color_specular.rgb;
    if instance.texture != NONE {
        let points = array<vec3f, 3>(v0.position.xyz, v1.position.xyz, v2.position.xyz);
        color *= texture_factor(instance, corners.w, points, ab);
    }
    let light = illuminate(view, color, instance.color_specular.w, instance.metallic, point, normal, -normalize(ray_through(view, px)));
    return clamp(light, vec3f(0.0), vec3f(1.0));
}

// Samples the instance's texture at ab. Returns linear RGB factors.
fn texture_factor(instance: Instance, axis: u32, points: array<vec3f, 3>, ab: vec2f) -> vec3f {
    let t = project_along(axis, points[0] * instance.tiles);
    let e = project_along(axis, points[1] * instance.tiles) - t;
    let f = project_along(axis, points[2] * instance.tiles) - t;
    return sample_texture(instance.texture, t + ab.x * e + ab.y * f);
}

// Drops the coordinate along the texture projection axis.
fn project_along(axis: u32, p: vec3f) -> vec2f {
    switch axis {
        case 0u: { return p.zy; }
        case 1u: { return p.xz; }
        default: { return p.xy; }
    }
}
