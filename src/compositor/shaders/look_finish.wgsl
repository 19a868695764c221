// Puts the filtered layers over the camera's picture and adds the noise that it lacks.

@group(1) @binding(0) var camera: texture_2d<f32>;
@group(1) @binding(2) var surface: texture_2d<f32>;
@group(1) @binding(3) var change: texture_2d<f32>;
@group(1) @binding(4) var grain: texture_2d<f32>;

@vertex
fn shade_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return unfiltered_corner(v);
}

@vertex
fn finish_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return look_corner(v, look.reach.w);
}

fn filtered_at(pixel: vec2i) -> Layers {
    if SPREAD {
        return spread_along(surface, change, pixel, vec2i(0, 1), look.down, look.soft_down);
    }
    return Layers(textureLoad(surface, pixel, 0), textureLoad(change, pixel, 0));
}

fn variance(linear: vec3f) -> vec3f {
    return look.read.rgb + look.shot.rgb * max(linear, vec3f(0.0));
}

// Noise for a pixel that shows `linear` and holds the noise of `camera` times `share` already.
fn noise(pixel: vec2i, linear: vec3f, camera: vec3f, share: vec3f) -> vec3f {
    if !GRAIN {
        return vec3f(0.0);
    }
    let missing = variance(linear) - share * share * variance(camera);
    let at = (vec2u(pixel) + look.grain.xy) & vec2u(GRAIN_SIDE - 1u);
    return sqrt(max(missing, vec3f(0.0))) * textureLoad(grain, at, 0).rgb * GRAIN_SIGMAS;
}

@fragment
fn finish(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(position.xy);
    let shown = filtered_at(pixel);
    let ratio = select(vec3f(1.0), shown.change.rgb / shown.change.a, shown.change.a > 1e-4);
    // Less than any code can show. The composed picture holds the camera's code there.
    let same = all(abs(ratio - vec3f(1.0)) < vec3f(1.0 / 2048.0));
    if same && all(abs(shown.surface) < vec4f(1.0 / 4096.0)) {
        discard;
    }
    let real = real_light(textureLoad(camera, pixel, 0).rgb);
    let behind = max((real + DARK) * ratio - DARK, vec3f(0.0));
    let open = 1.0 - shown.surface.a;
    let linear = max(shown.surface.rgb + open * behind, vec3f(0.0));
    let grainy = linear + noise(pixel, linear, real, open * ratio);
    return vec4f(code_from_linear(grainy), 1.0);
}

// The noise that shadows lack away from virtual objects; `surface` is the composed picture.
@fragment
fn shade(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(position.xy);
    let code = textureLoad(surface, pixel, 0).rgb;
    let texel = textureLoad(camera, pixel, 0).rgb;
    if is_unchanged(code, texel) {
        discard;
    }
    let shown = linear_from_code(code);
    let real = real_light(texel);
    let grainy = shown + noise(pixel, shown, real, (shown + DARK) / (real + DARK));
    return vec4f(code_from_linear(grainy), 1.0);
}
