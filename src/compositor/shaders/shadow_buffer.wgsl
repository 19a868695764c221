// The shadow buffer (Supan 2006, eq. 3), for both layers of the picture.
//
//   R = Σ C_i · N·L_i · (1 − S_i)        the light that virtual casters keep away
//   E = Σ C_i · N·L_i · S_i(phantoms)    the light that arrives in the real scene
//
// On phantoms the result is the factor (E − R) / E, or R / π for the paper's own
// subtraction; on virtual objects it is the irradiance that is left.

@group(2) @binding(0) var phantom_normal: texture_2d<f32>;
@group(2) @binding(1) var phantom_depth: texture_depth_2d;
@group(2) @binding(2) var virtual_base: VIRTUAL_TEXTURE;
@group(2) @binding(3) var virtual_normal: VIRTUAL_TEXTURE;
@group(2) @binding(4) var virtual_depth: VIRTUAL_DEPTH;

const PI = 3.14159265;

// Light of the lower hemisphere, which no dome light stands for where there is a ground.
fn ground_irradiance(n: vec3f) -> vec3f {
    return frame.params.z * frame.ground.rgb * (PI * 0.5 * (1.0 - n.z));
}

fn lost_behind_virtual(world: vec3f, n: vec3f) -> vec3f {
    var lost = vec3f(0.0);
    for (var i = 0u; i < frame.counts.x; i++) {
        let n_dot_l = dot(n, lights[i].direction.xyz);
        if n_dot_l <= 0.0 {
            continue;
        }
        let blocked = 1.0 - virtual_visibility(i, world, n, n_dot_l);
        if blocked > 0.0 {
            let real = phantom_visibility(i, world, n, n_dot_l);
            lost += lights[i].irradiance.rgb * (n_dot_l * blocked * real);
        }
    }
    return lost;
}

fn arriving_in_real(world: vec3f, n: vec3f) -> vec3f {
    var sum = ground_irradiance(n);
    for (var i = 0u; i < frame.counts.x; i++) {
        let n_dot_l = dot(n, lights[i].direction.xyz);
        if n_dot_l > 0.0 {
            let real = phantom_visibility(i, world, n, n_dot_l);
            sum += lights[i].irradiance.rgb * (n_dot_l * real);
        }
    }
    return sum;
}

@fragment
fn phantom_shadow(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(at.xy) * i32(frame.counts.z);
    let unshadowed = vec4f(vec3f(select(1.0, 0.0, frame.counts.y == 1u)), 1.0);
    let surface = textureLoad(phantom_normal, pixel, 0);
    if surface.z != 1.0 {
        return unshadowed;
    }
    let n = normal_from_octahedron(surface.xy);
    let world = world_at(vec2f(pixel), textureLoad(phantom_depth, pixel, 0));
    let lost = lost_behind_virtual(world, n) * frame.params.x;
    if all(lost == vec3f(0.0)) {
        return unshadowed;
    }
    if frame.counts.y == 1u {
        return vec4f(lost / PI, 1.0);
    }
    let arriving = arriving_in_real(world, n);
    return vec4f(max(arriving - lost, vec3f(0.0)) / max(arriving, vec3f(1e-6)), 1.0);
}

// First covered sample in the block of pixels that this texel stands for:
// x, y = pixel, z = sample; z < 0 = none.
fn covered_sample(corner: vec2i) -> vec3i {
    let step = i32(frame.counts.z);
    for (var k = 0; k < step * step; k++) {
        let pixel = corner + vec2i(k % step, k / step);
        for (var s = 0; s < SAMPLES; s++) {
            if textureLoad(virtual_base, pixel, s).a > 0.5 {
                return vec3i(pixel, s);
            }
        }
    }
    return vec3i(0, 0, -1);
}

@fragment
fn virtual_light(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let found = covered_sample(vec2i(at.xy) * i32(frame.counts.z));
    if found.z < 0 {
        return vec4f(0.0);
    }
    let n = normal_from_octahedron(textureLoad(virtual_normal, found.xy, found.z).xy);
    let world = world_at(vec2f(found.xy), textureLoad(virtual_depth, found.xy, found.z));
    var left = sky_irradiance(n);
    for (var i = 0u; i < frame.counts.x; i++) {
        let n_dot_l = dot(n, lights[i].direction.xyz);
        if n_dot_l <= 0.0 {
            continue;
        }
        let seen = virtual_visibility(i, world, n, n_dot_l)
            * phantom_visibility(i, world, n, n_dot_l);
        // Compact sources are not in the sky's polynomial, cells are.
        left += lights[i].irradiance.rgb * (n_dot_l * (seen - 1.0 + lights[i].irradiance.w));
    }
    return vec4f(max(left, vec3f(0.0)), 1.0);
}
