// Light on a surface, and what of the first sun's light reaches it.

// Linear light towards the eye.
fn lit(view: View, color: vec3f, specular: f32, point: vec3f, normal: vec3f, to_eye: vec3f) -> vec3f {
    let sky = (1.0 + GROUND_AMBIENT) / 2.0 + (1.0 - GROUND_AMBIENT) / 2.0 * dot(normal, view.up.xyz);
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
            let aligned = 2.0 * facing * dot(normal, to_eye) - dot(sun.towards.xyz, to_eye);
            let gleam = max(0.0, SPECULAR_FALLOFF * aligned - (SPECULAR_FALLOFF - 1.0));
            mirrored += light * (gleam * gleam);
        }
    }
    return color * scattered + specular * SPECULAR_GAIN * mirrored;
}

// Share of the first sun's light that reaches a point.
fn shadow(view: View, point: vec3f, normal: vec3f) -> f32 {
    if view.map == NONE {
        return 1.0;
    }
    let map = views[view.map];
    let p = moved(view.map_from_view, point + SHADOW_NORMAL_OFFSET_M * normal);
    let texel = floor(p.xy - 0.5);
    let fraction = p.xy - 0.5 - texel;
    let left_upper = vec2i(texel);
    let upper = mix(open(map, left_upper, p.z), open(map, left_upper + vec2i(1, 0), p.z), fraction.x);
    let lower = mix(open(map, left_upper + vec2i(0, 1), p.z), open(map, left_upper + 1, p.z), fraction.x);
    return mix(upper, lower, fraction.y);
}

// Whether nothing in a texel of the map is a step or more above a height; outside of the map nothing is.
fn open(map: View, texel: vec2i, height: f32) -> f32 {
    if any(texel < vec2i(0)) || any(texel >= vec2i(i32(map.side))) {
        return 1.0;
    }
    return select(0.0, 1.0, floor(height * SHADOW_DEPTH_LEVELS) >= floor(height_at(map, vec2u(texel)) * SHADOW_DEPTH_LEVELS));
}
