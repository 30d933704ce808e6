// Triangles as resolve.wgsl sees them: where rays meet them.

// The ray through a point of the image, from the eye to z 1.
fn ray_through(view: View, px: vec2f) -> vec3f {
    return vec3f((px - view.half_px) / view.focal_px, 1.0);
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
    ab: vec2f,
    // Changes of a and b with a step of one pixel right and down.
    right: vec2f,
    down: vec2f,
}

// Möller and Trumbore, "Fast, minimum storage ray/triangle intersection" (1997).
fn meet(view: View, p: vec3f, e: vec3f, f: vec3f, px: vec2f) -> Hit {
    let ray = ray_through(view, px);
    let along_a = cross(p, f);
    let along_b = cross(e, p);
    let along_n = cross(f, e);
    let n = dot(ray, along_n);
    let per_n = select(1.0 / n, 0.0, n == 0.0);
    let ab = vec2f(dot(ray, along_a), dot(ray, along_b)) * per_n;
    // d(a/n) = (da − (a/n) dn) / n.
    let per_px = per_n / view.focal_px;
    let right = (vec2f(along_a.x, along_b.x) - ab * along_n.x) * per_px;
    let down = (vec2f(along_a.y, along_b.y) - ab * along_n.y) * per_px;
    return Hit(ab, right, down);
}

// What takes normals along, up to a positive factor.
fn cofactors_of(map: array<vec4f, 3>) -> mat3x3f {
    let a = map[0].xyz;
    let b = map[1].xyz;
    let c = map[2].xyz;
    return transpose(mat3x3f(cross(b, c), cross(c, a), cross(a, b)));
}
