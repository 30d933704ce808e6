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
    var curve = vec3f(ROOT_CODES[0]);
    for (var i = 1u; i < 7u; i++) {
        curve = curve * root + ROOT_CODES[i];
    }
    return clamp(select(curve, LINEAR_CODES * light, light < vec3f(LINEAR_BELOW)), vec3f(0.0), vec3f(255.0));
}

// Linear light, held in [0, 1], that a triangle sends along the ray through a pixel's centre.
fn shade(view: View, id: u32, at: vec2u) -> vec3f {
    let instance = instances[view.first_instance + (id >> TRIANGLE_BITS)];
    let corners = triangles[instance.first_triangle + (id & ((1u << TRIANGLE_BITS) - 1u))];
    let v0 = vertices[corners.x];
    let v1 = vertices[corners.y];
    let v2 = vertices[corners.z];
    let step = 1.0 / view.focal_px;
    let ray = vec3f((vec2f(at) + 0.5 - view.half_px) * step, 1.0);
    let p0 = on_grid(view, moved(instance.view_from_mesh, v0.position.xyz));
    let p1 = on_grid(view, moved(instance.view_from_mesh, v1.position.xyz));
    let p2 = on_grid(view, moved(instance.view_from_mesh, v2.position.xyz));
    let hit = meet(p0, p1 - p0, p2 - p0, ray, step);
    if hit.point.z * view.inverse_far >= 1.0 {
        return vec3f(0.0);
    }
    let cofactors = cofactors_of(instance.view_from_mesh);
    let n0 = normalize(cofactors * v0.normal.xyz);
    let n1 = normalize(cofactors * v1.normal.xyz);
    let n2 = normalize(cofactors * v2.normal.xyz);
    let normal = normalize(n0 + hit.ab.x * (n1 - n0) + hit.ab.y * (n2 - n0));
    var color = instance.paint.rgb;
    if instance.texture != NONE {
        color *= textured(instance, corners.w, v0.position.xyz, v1.position.xyz, v2.position.xyz, hit);
    }
    return clamp(lit(view, color, instance.paint.w, hit.point, normal, -normalize(ray)), vec3f(0.0), vec3f(1.0));
}

// A point moved to where the visibility pass puts it, 1/256 px apart, so that no pixel of a triangle lies outside of it.
// Behind the near plane points stay where they are.
fn on_grid(view: View, p: vec3f) -> vec3f {
    if p.z < view.near_m {
        return p;
    }
    let px = snapped(view.half_px + p.xy * view.focal_px / p.z);
    return vec3f((px - view.half_px) * (p.z / view.focal_px), p.z);
}

// Where a ray meets a triangle's plane: at p + a e + b f, for the corners p, p + e and p + f.
struct Hit {
    point: vec3f,
    // Held in [0, 1]: with several samples a pixel's centre may lie outside of the triangle.
    ab: vec2f,
    // Changes of a and b with a step right and a step down.
    right: vec2f,
    down: vec2f,
}

// Möller and Trumbore, "Fast, minimum storage ray/triangle intersection" (1997).
fn meet(p: vec3f, e: vec3f, f: vec3f, ray: vec3f, step: f32) -> Hit {
    let along_a = cross(p, f);
    let along_b = cross(e, p);
    let along_n = cross(f, e);
    let n = dot(ray, along_n);
    let per_n = select(1.0 / n, 0.0, n == 0.0);
    let ab = clamp(vec2f(dot(ray, along_a), dot(ray, along_b)) * per_n, vec2f(0.0), vec2f(1.0));
    var hit: Hit;
    hit.point = p + ab.x * e + ab.y * f;
    hit.ab = ab;
    // d(a/n) = (da − (a/n) dn) / n.
    hit.right = (vec2f(along_a.x, along_b.x) - ab * along_n.x) * (step * per_n);
    hit.down = (vec2f(along_a.y, along_b.y) - ab * along_n.y) * (step * per_n);
    return hit;
}

// What takes normals along, up to a positive factor.
fn cofactors_of(map: array<vec4f, 3>) -> mat3x3f {
    let a = map[0].xyz;
    let b = map[1].xyz;
    let c = map[2].xyz;
    return transpose(mat3x3f(cross(b, c), cross(c, a), cross(a, b)));
}

// Factors of the instance's texture at the hit.
fn textured(instance: Instance, facing: u32, p0: vec3f, p1: vec3f, p2: vec3f, hit: Hit) -> vec3f {
    let t0 = projected(facing, p0 * instance.tiles);
    let e = projected(facing, p1 * instance.tiles) - t0;
    let f = projected(facing, p2 * instance.tiles) - t0;
    let right = hit.right.x * e + hit.right.y * f;
    let down = hit.down.x * e + hit.down.y * f;
    let footprint = max(dot(right, right), dot(down, down)) * f32(TILE_SIDE * TILE_SIDE);
    return factor(instance.texture, t0 + hit.ab.x * e + hit.ab.y * f, footprint);
}

// A point without the axis that its triangle faces.
fn projected(facing: u32, p: vec3f) -> vec2f {
    switch facing {
        case 0u: { return p.zy; }
        case 1u: { return p.xz; }
        default: { return p.xy; }
    }
}

// Linear light towards the eye.
fn lit(view: View, color: vec3f, specular: f32, point: vec3f, normal: vec3f, to_eye: vec3f) -> vec3f {
    let sky = 0.775 + 0.225 * dot(normal, view.up.xyz);
    var scattered = view.ambient.rgb * sky;
    var mirrored = vec3f(0.0);
    for (var i = 0u; i < 2u; i++) {
        let sun = view.suns[i];
        let facing = dot(normal, sun.towards.xyz);
        if facing > 0.0 {
            var light = sun.color.rgb;
            if i == 0u {
                light *= shadow(view, point, normal);
            }
            scattered += light * (facing / 3.14159265);
            let m = max(0.0, 2.0 * facing * dot(normal, to_eye) - dot(sun.towards.xyz, to_eye));
            let m4 = (m * m) * (m * m);
            mirrored += light * ((m4 * m4) * (m4 * m4));
        }
    }
    return color * scattered + specular * 0.4 * mirrored;
}

// Distance in m by which a point is moved off its surface before it is looked up in the map.
const OFF_SURFACE_M: f32 = 0.008;

// Share of the first sun's light that reaches a point.
fn shadow(view: View, point: vec3f, normal: vec3f) -> f32 {
    if view.map == NONE {
        return 1.0;
    }
    let map = views[view.map];
    let p = moved(view.map_from_view, point + OFF_SURFACE_M * normal);
    let texel = floor(p.xy - 0.5);
    let fraction = p.xy - 0.5 - texel;
    let left_upper = vec2i(texel);
    let upper = mix(open(map, left_upper, p.z), open(map, left_upper + vec2i(1, 0), p.z), fraction.x);
    let lower = mix(open(map, left_upper + vec2i(0, 1), p.z), open(map, left_upper + 1, p.z), fraction.x);
    return mix(upper, lower, fraction.y);
}

// Whether nothing in a texel of the map is above a height; outside of the map nothing is.
fn open(map: View, texel: vec2i, height: f32) -> f32 {
    if any(texel < vec2i(0)) || any(texel >= vec2i(i32(map.side))) {
        return 1.0;
    }
    return select(0.0, 1.0, height >= height_at(map, vec2u(texel)));
}
