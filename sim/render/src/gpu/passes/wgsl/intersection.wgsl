// Ray-triangle intersection for shading.wgsl.

// Returns the ray from the eye through a point of the image, with z = 1.
fn ray_through(view: View, px: vec2f) -> vec3f {
    return vec3f((px - view.half_px) / view.focal_px, 1.0);
}

// Moves a vertex to the 1/256 px grid of the visibility pass, so that every pixel covered by a triangle lies
// inside it. Points in front of the near plane are returned unchanged.
fn snap_vertex(view: View, p: vec3f) -> vec3f {
    if p.z < view.near_m {
        return p;
    }
    let px = snap_to_grid(view.half_px + p.xy * view.focal_px / p.z);
    return vec3f((px - view.half_px) * (p.z / view.focal_px), p.z);
}

// Returns the barycentric coordinates (a, b) of the intersection of a ray with the plane of a triangle: the
// point p + a e + b f, for the vertices p, p + e and p + f (Möller and Trumbore, "Fast, minimum storage
// ray/triangle intersection", 1997).
fn intersect(view: View, p: vec3f, e: vec3f, f: vec3f, px: vec2f) -> vec2f {
    let ray = ray_through(view, px);
    let n = dot(ray, cross(f, e));
    let inverse_n = select(1.0 / n, 0.0, n == 0.0);
    return vec2f(dot(ray, cross(p, f)), dot(ray, cross(e, p))) * inverse_n;
}

// Returns the cofactor matrix of the linear part, which transforms normals up to a positive factor.
fn cofactor_matrix(map: array<vec4f, 3>) -> mat3x3f {
    let a = map[0].xyz;
    let b = map[1].xyz;
    let c = map[2].xyz;
    return transpose(mat3x3f(cross(b, c), cross(c, a), cross(a, b)));
}
