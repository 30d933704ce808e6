// Visibility pass with integer edge functions and atomic maxima. camera_target.wgsl and
// shadow_map_target.wgsl define the projection and the result per sample.

@group(0) @binding(0) var<storage, read> views: array<View>;
@group(0) @binding(1) var<storage, read> instances: array<Instance>;
@group(0) @binding(2) var<storage, read> vertices: array<Vertex>;
// Three vertex indices and the texture projection axis per triangle.
@group(0) @binding(3) var<storage, read> triangles: array<vec4u>;
@group(0) @binding(4) var<storage, read> list: BlockList;
@group(0) @binding(5) var<storage, read_write> large: LargeTriangles;

// Blocks of up to 64 triangles, written by placement.wgsl.
struct BlockList {
    n: u32,
    padding: u32,
    // Instance index and first triangle.
    blocks: array<vec2u>,
}

// Triangles that rasterise_large processes.
struct LargeTriangles {
    n: atomic<u32>,
    // Instance index and triangle index.
    triangles: array<vec2u>,
}

// Maximum bounding box area in samples of a triangle that a single thread rasterises; larger ones take a
// workgroup.
const MAX_SMALL_AREA: i32 = 64;
// A triangle clipped by five planes has at most eight vertices.
const MAX_VERTICES: u32 = 8u;

// A projected vertex.
struct ProjectedVertex {
    // Position in 1/256 sample.
    at: vec2i,
    // 1/z in images, height in shadow maps.
    depth: f32,
}

// Bounding box of the samples whose centres may lie inside a triangle; both ends are inclusive.
struct BoundingBox {
    lower: vec2i,
    upper: vec2i,
}

fn bounding_box(triangle: array<ProjectedVertex, 3>, size: vec2u) -> BoundingBox {
    let lower = min(min(triangle[0].at, triangle[1].at), triangle[2].at);
    let upper = max(max(triangle[0].at, triangle[1].at), triangle[2].at);
    // Sample i has its centre at 256 i + 128.
    let last = vec2i(size * SAMPLES_PER_AXIS) - 1;
    return BoundingBox(max((lower + 127) >> vec2u(8u), vec2i(0)), min((upper - 128) >> vec2u(8u), last));
}

// Twice the signed area, positive if the vertices are in clockwise order on the image.
fn doubled_area(p: vec2i, q: vec2i, r: vec2i) -> i64 {
    let e = q - p;
    let f = r - p;
    return i64(e.x) * i64(f.y) - i64(f.x) * i64(e.y);
}

// Edge function: value at the centre of sample (0, 0), and increments per sample right and down, in units of
// 1/256 sample².
fn edge_function(p: vec2i, q: vec2i) -> vec3i {
    let d = q - p;
    // Top-left rule: a centre on a top or left edge is inside.
    let is_top_left = d.y < 0 || (d.y == 0 && d.x > 0);
    let origin = i64(d.x) * i64(128 - p.y) - i64(d.y) * i64(128 - p.x) - select(1li, 0li, is_top_left);
    return vec3i(i32(origin >> 8u), -d.y, d.x);
}

// Rasterises every stride-th sample of a triangle in x and y, starting at an offset.
fn rasterise(view: View, id: u32, triangle: array<ProjectedVertex, 3>, offset: vec2i, stride: i32) {
    let p = triangle[0];
    let q = triangle[SECOND_VERTEX];
    let r = triangle[3 - SECOND_VERTEX];
    let area2 = doubled_area(p.at, q.at, r.at);
    if area2 <= 0li {
        return;
    }
    let e0 = edge_function(p.at, q.at);
    let e1 = edge_function(q.at, r.at);
    let e2 = edge_function(r.at, p.at);
    let e = vec2f(q.at - p.at);
    let f = vec2f(r.at - p.at);
    let depth_delta = vec2f(q.depth - p.depth, r.depth - p.depth);
    let gradient = vec2f(
        depth_delta.x * f.y - depth_delta.y * e.y,
        depth_delta.y * e.x - depth_delta.x * f.x) * (256.0 / f32(area2));
    let from_vertex = vec2f(128 - p.at) / 256.0;
    let min_depth = min(min(p.depth, q.depth), r.depth);
    let max_depth = max(max(p.depth, q.depth), r.depth);
    let box = bounding_box(triangle, view.size);
    for (var y = box.lower.y + offset.y; y <= box.upper.y; y += stride) {
        for (var x = box.lower.x + offset.x; x <= box.upper.x; x += stride) {
            let at0 = e0.x + e0.y * x + e0.z * y;
            let at1 = e1.x + e1.y * x + e1.z * y;
            let at2 = e2.x + e2.y * x + e2.z * y;
            if (at0 | at1 | at2) >= 0 {
                let offset_px = vec2f(vec2i(x, y)) + from_vertex;
                let depth = clamp(p.depth + gradient.x * offset_px.x + gradient.y * offset_px.y, min_depth, max_depth);
                write_sample(view, vec2u(vec2i(x, y)), depth, id);
            }
        }
    }
}

// Clips a triangle given in the view frame and rasterises the resulting polygon as a fan.
fn clip_and_rasterise(view: View, id: u32, points: array<vec3f, 3>, offset: vec2i, stride: i32) {
    var polygon: array<vec3f, MAX_VERTICES>;
    polygon[0] = points[0];
    polygon[1] = points[1];
    polygon[2] = points[2];
    var n = 3u;
    if needs_clipping(view, points[0]) || needs_clipping(view, points[1]) || needs_clipping(view, points[2]) {
        for (var plane = 0u; plane < 5u; plane++) {
            n = clip(view, plane, &polygon, n);
        }
    }
    for (var i = 2u; i < n; i++) {
        let fan = array<ProjectedVertex, 3>(
            project(view, polygon[0]), project(view, polygon[i - 1u]), project(view, polygon[i]));
        rasterise(view, id, fan, offset, stride);
    }
}

// Clips a polygon by a plane (Sutherland-Hodgman). Intersections are always computed from the inside to the
// outside vertex, so that two triangles that share an edge are clipped at the same point. Returns the number
// of vertices.
fn clip(view: View, plane: u32, polygon: ptr<function, array<vec3f, MAX_VERTICES>>, n: u32) -> u32 {
    var clipped: array<vec3f, MAX_VERTICES>;
    var n_clipped = 0u;
    for (var i = 0u; i < n; i++) {
        let p = (*polygon)[i];
        let q = (*polygon)[select(i + 1u, 0u, i + 1u == n)];
        let p_distance = clip_distance(view, plane, p);
        let q_distance = clip_distance(view, plane, q);
        if p_distance >= 0.0 {
            clipped[n_clipped] = p;
            n_clipped++;
        }
        if (p_distance >= 0.0) != (q_distance >= 0.0) {
            let p_inside = p_distance >= 0.0;
            let inside = select(q, p, p_inside);
            let outside = select(p, q, p_inside);
            let inside_distance = select(q_distance, p_distance, p_inside);
            let outside_distance = select(p_distance, q_distance, p_inside);
            let fraction = inside_distance / (inside_distance - outside_distance);
            clipped[n_clipped] = inside + (outside - inside) * fraction;
            n_clipped++;
        }
    }
    *polygon = clipped;
    return n_clipped;
}

fn triangle_points(instance: Instance, triangle: u32) -> array<vec3f, 3> {
    let indices = triangles[instance.first_triangle + triangle];
    return array<vec3f, 3>(
        transform_point(instance.view_from_mesh, vertices[indices.x].position.xyz),
        transform_point(instance.view_from_mesh, vertices[indices.y].position.xyz),
        transform_point(instance.view_from_mesh, vertices[indices.z].position.xyz));
}

// One workgroup per block, one thread per triangle. Appends triangles that are large or need clipping to the
// list of large triangles.
@compute @workgroup_size(64)
fn rasterise_small(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) n_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    for (var i = group.x; i < list.n; i += n_groups.x) {
        let block = list.blocks[i];
        let instance = instances[block.x];
        let triangle = block.y + lane;
        if triangle < instance.n_triangles {
            rasterise_if_small(instance, block.x, triangle);
        }
    }
}

fn rasterise_if_small(instance: Instance, instance_idx: u32, triangle: u32) {
    let view = views[instance.view];
    let points = triangle_points(instance, triangle);
    if (outcode(view, points[0]) & outcode(view, points[1]) & outcode(view, points[2])) != 0u {
        return;
    }
    if !needs_clipping(view, points[0]) && !needs_clipping(view, points[1]) && !needs_clipping(view, points[2]) {
        let projected = array<ProjectedVertex, 3>(
            project(view, points[0]), project(view, points[1]), project(view, points[2]));
        if doubled_area(projected[0].at, projected[SECOND_VERTEX].at, projected[3 - SECOND_VERTEX].at) <= 0li {
            return;
        }
        let box = bounding_box(projected, view.size);
        let size = max(box.upper - box.lower + 1, vec2i(0));
        if size.x * size.y <= MAX_SMALL_AREA {
            rasterise(view, instance.first_id + triangle, projected, vec2i(0), 1);
            return;
        }
    }
    let list_idx = atomicAdd(&large.n, 1u);
    if list_idx < arrayLength(&large.triangles) {
        large.triangles[list_idx] = vec2u(instance_idx, triangle);
    } else {
        clip_and_rasterise(view, instance.first_id + triangle, points, vec2i(0), 1);
    }
}

// One workgroup per large triangle.
@compute @workgroup_size(16, 16)
fn rasterise_large(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) n_groups: vec3u,
    @builtin(local_invocation_id) lane: vec3u,
) {
    let n = min(atomicLoad(&large.n), arrayLength(&large.triangles));
    for (var i = group.x; i < n; i += n_groups.x) {
        let instance = instances[large.triangles[i].x];
        let triangle = large.triangles[i].y;
        let id = instance.first_id + triangle;
        clip_and_rasterise(views[instance.view], id, triangle_points(instance, triangle), vec2i(lane.xy), 16);
    }
}
