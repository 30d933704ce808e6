// Visibility by integer edge functions and atomic maxima. What a view is and what is kept of it say camera_target.wgsl and
// map_target.wgsl.

@group(0) @binding(0) var<storage, read> views: array<View>;
@group(0) @binding(1) var<storage, read> instances: array<Instance>;
@group(0) @binding(2) var<storage, read> vertices: array<Vertex>;
// Three vertices each, then the axis it faces.
@group(0) @binding(3) var<storage, read> triangles: array<vec4u>;
// An instance and the first of up to 64 of its triangles.
@group(0) @binding(4) var<storage, read> blocks: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> large: Large;

// Triangles that are left to the second pass.
struct Large {
    n: atomic<u32>,
    // Instance and triangle.
    triangles: array<vec2u>,
}

// Pixels that one thread fills alone; a triangle whose rectangle holds more is filled by a workgroup.
const SMALL_PX: i32 = 64;
// A triangle cut by five planes has at most eight corners.
const MAX_CORNERS: u32 = 8u;

// Where a point appears.
struct Corner {
    // In 1/256 sample.
    at: vec2i,
    depth: f32,
}

// The rectangle of samples whose centres may lie in a triangle, both ends included.
struct Extent {
    least: vec2i,
    greatest: vec2i,
}

fn extent(corners: array<Corner, 3>, side: u32) -> Extent {
    let least = min(min(corners[0].at, corners[1].at), corners[2].at);
    let greatest = max(max(corners[0].at, corners[1].at), corners[2].at);
    // Sample i has its centre at 256 i + 128.
    let last = vec2i(i32(side * ZOOM) - 1);
    return Extent(max((least + 127) >> vec2u(8u), vec2i(0)), min((greatest - 128) >> vec2u(8u), last));
}

// Twice the signed area, positive where the corners run clockwise on the image.
fn area(p: vec2i, q: vec2i, r: vec2i) -> i64 {
    let e = q - p;
    let f = r - p;
    return i64(e.x) * i64(f.y) - i64(f.x) * i64(e.y);
}

// An edge function: at the centre of sample (0, 0), and its steps right and down. In units of 256/256² sample².
fn edge(p: vec2i, q: vec2i) -> vec3i {
    let d = q - p;
    // A centre on the edge belongs to the triangle if the edge is at its top or left.
    let owned = d.y < 0 || (d.y == 0 && d.x > 0);
    let origin = i64(d.x) * i64(128 - p.y) - i64(d.y) * i64(128 - p.x) - select(1li, 0li, owned);
    return vec3i(i32(origin >> 8u), -d.y, d.x);
}

// Every stride-th sample of a triangle in x and y, from the offset on.
fn fill(view: View, id: u32, triangle: array<Corner, 3>, offset: vec2i, stride: i32) {
    let p = triangle[0];
    let q = triangle[SECOND];
    let r = triangle[3 - SECOND];
    let doubled = area(p.at, q.at, r.at);
    if doubled <= 0li {
        return;
    }
    let e0 = edge(p.at, q.at);
    let e1 = edge(q.at, r.at);
    let e2 = edge(r.at, p.at);
    let e = vec2f(q.at - p.at);
    let f = vec2f(r.at - p.at);
    let rise = vec2f(q.depth - p.depth, r.depth - p.depth);
    let slope = vec2f(rise.x * f.y - rise.y * e.y, rise.y * e.x - rise.x * f.x) * (256.0 / f32(doubled));
    let from_corner = vec2f(128 - p.at) / 256.0;
    let least = min(min(p.depth, q.depth), r.depth);
    let greatest = max(max(p.depth, q.depth), r.depth);
    let box = extent(triangle, view.side);
    for (var y = box.least.y + offset.y; y <= box.greatest.y; y += stride) {
        for (var x = box.least.x + offset.x; x <= box.greatest.x; x += stride) {
            let at0 = e0.x + e0.y * x + e0.z * y;
            let at1 = e1.x + e1.y * x + e1.z * y;
            let at2 = e2.x + e2.y * x + e2.z * y;
            if (at0 | at1 | at2) >= 0 {
                let run = vec2f(vec2i(x, y)) + from_corner;
                let depth = clamp(p.depth + slope.x * run.x + slope.y * run.y, least, greatest);
                keep(view, vec2u(vec2i(x, y)), depth, id);
            }
        }
    }
}

// A triangle given in the view frame, cut to what can be projected.
fn draw(view: View, id: u32, points: array<vec3f, 3>, offset: vec2i, stride: i32) {
    var corners: array<vec3f, MAX_CORNERS>;
    corners[0] = points[0];
    corners[1] = points[1];
    corners[2] = points[2];
    var n = 3u;
    if must_be_cut(view, points[0]) || must_be_cut(view, points[1]) || must_be_cut(view, points[2]) {
        for (var plane = 0u; plane < 5u; plane++) {
            n = cut(view, plane, &corners, n);
        }
    }
    for (var i = 2u; i < n; i++) {
        let fan = array<Corner, 3>(
            project(view, corners[0]), project(view, corners[i - 1u]), project(view, corners[i]));
        fill(view, id, fan, offset, stride);
    }
}

// Keeps the part of a polygon on the inner side of a plane. Each cut runs from the corner inside to the one outside, so
// that two triangles that share the edge cut it at the same point.
fn cut(view: View, plane: u32, corners: ptr<function, array<vec3f, MAX_CORNERS>>, n: u32) -> u32 {
    var kept: array<vec3f, MAX_CORNERS>;
    var n_kept = 0u;
    for (var i = 0u; i < n; i++) {
        let p = (*corners)[i];
        let q = (*corners)[select(i + 1u, 0u, i + 1u == n)];
        let p_height = height_above(view, plane, p);
        let q_height = height_above(view, plane, q);
        if p_height >= 0.0 {
            kept[n_kept] = p;
            n_kept++;
        }
        if (p_height >= 0.0) != (q_height >= 0.0) {
            let p_inside = p_height >= 0.0;
            let inside = select(q, p, p_inside);
            let outside = select(p, q, p_inside);
            let above = select(q_height, p_height, p_inside);
            let below = select(p_height, q_height, p_inside);
            kept[n_kept] = inside + (outside - inside) * (above / (above - below));
            n_kept++;
        }
    }
    *corners = kept;
    return n_kept;
}

fn points_of(instance: Instance, triangle: u32) -> array<vec3f, 3> {
    let corners = triangles[instance.first_triangle + triangle];
    return array<vec3f, 3>(
        moved(instance.view_from_mesh, vertices[corners.x].position.xyz),
        moved(instance.view_from_mesh, vertices[corners.y].position.xyz),
        moved(instance.view_from_mesh, vertices[corners.z].position.xyz));
}

// One thread per triangle.
@compute @workgroup_size(64)
fn draw_small(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) n_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let block_idx = group.y * n_groups.x + group.x;
    if block_idx >= arrayLength(&blocks) || blocks[block_idx].x == NONE {
        return;
    }
    let block = blocks[block_idx];
    let instance = instances[block.x];
    let triangle = block.y + lane;
    if triangle >= instance.n_triangles {
        return;
    }
    let view = views[instance.view];
    let points = points_of(instance, triangle);
    if (missed(view, points[0]) & missed(view, points[1]) & missed(view, points[2])) != 0u {
        return;
    }
    if !must_be_cut(view, points[0]) && !must_be_cut(view, points[1]) && !must_be_cut(view, points[2]) {
        let corners = array<Corner, 3>(project(view, points[0]), project(view, points[1]), project(view, points[2]));
        if area(corners[0].at, corners[SECOND].at, corners[3 - SECOND].at) <= 0li {
            return;
        }
        let box = extent(corners, view.side);
        let size = max(box.greatest - box.least + 1, vec2i(0));
        if size.x * size.y <= SMALL_PX {
            fill(view, instance.first_id + triangle, corners, vec2i(0), 1);
            return;
        }
    }
    let place = atomicAdd(&large.n, 1u);
    if place < arrayLength(&large.triangles) {
        large.triangles[place] = vec2u(block.x, triangle);
    } else {
        draw(view, instance.first_id + triangle, points, vec2i(0), 1);
    }
}

// One workgroup per triangle.
@compute @workgroup_size(16, 16)
fn draw_large(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) n_groups: vec3u,
    @builtin(local_invocation_id) lane: vec3u,
) {
    let n = min(atomicLoad(&large.n), arrayLength(&large.triangles));
    for (var i = group.x; i < n; i += n_groups.x) {
        let instance = instances[large.triangles[i].x];
        let triangle = large.triangles[i].y;
        let id = instance.first_id + triangle;
        draw(views[instance.view], id, points_of(instance, triangle), vec2i(lane.xy), 16);
    }
}
