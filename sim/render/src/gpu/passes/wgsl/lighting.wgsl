// Lighting of surface points, and shadow map lookup for the first sun.

// Result of visibility.wgsl in shadow maps: the bits of the height per texel.
@group(0) @binding(6) var<storage, read> shadow_heights: array<u32>;

// Returns the linear radiance towards the eye.
fn illuminate(view: View, color: vec3f, specular: f32, metallic: f32, point: vec3f, normal: vec3f, to_eye: vec3f) -> vec3f {
    var diffuse = vec3f(0.0);
    var highlight = vec3f(0.0);
    for (var i = 0u; i < 2u; i++) {
        let sun = view.suns[i];
        let facing = dot(normal, sun.towards.xyz);
        if facing > 0.0 {
            var light = sun.color.rgb * facing;
            if i == 0u {
                light *= sun_visibility(view, point, normal);
            }
            diffuse += light / 3.14159265;
            let aligned = 2.0 * facing * dot(normal, to_eye) - dot(sun.towards.xyz, to_eye);
            let width = 1.0 + SPECULAR_FALLOFF - SPECULAR_FALLOFF * aligned;
            highlight += light / (width * width * mix(SPECULAR_VISIBILITY, 1.0, facing));
        }
    }
    let reflected = color * (view.ambient.rgb + (1.0 - metallic) * diffuse);
    return reflected + highlight * (specular + metallic * color);
}

// Returns the fraction of the first sun's light that reaches a point.
fn sun_visibility(view: View, point: vec3f, normal: vec3f) -> f32 {
    if view.shadow_map == NONE {
        return 1.0;
    }
    let map = views[view.shadow_map];
    let p = transform_point(view.shadow_from_view, point + SHADOW_NORMAL_OFFSET_M * normal);
    let texel = floor(p.xy - 0.5);
    let fraction = p.xy - 0.5 - texel;
    let left_upper = vec2i(texel);
    let upper = mix(is_lit(map, left_upper, p.z), is_lit(map, left_upper + vec2i(1, 0), p.z), fraction.x);
    let lower = mix(is_lit(map, left_upper + vec2i(0, 1), p.z), is_lit(map, left_upper + 1, p.z), fraction.x);
    return mix(upper, lower, fraction.y);
}

// Returns 1 if no surface in a texel of the shadow map is at least one depth level above a height, otherwise
// 0. Points outside of the map are lit.
fn is_lit(map: View, texel: vec2i, height: f32) -> f32 {
    if any(texel < vec2i(0)) || any(texel >= vec2i(map.size)) {
        return 1.0;
    }
    return select(0.0, 1.0, floor(height * SHADOW_DEPTH_LEVELS) >= floor(height_at(map, vec2u(texel)) * SHADOW_DEPTH_LEVELS));
}

fn height_at(map: View, at: vec2u) -> f32 {
    return bitcast<f32>(shadow_heights[map.first_pixel + at.y * map.size.x + at.x]);
}
