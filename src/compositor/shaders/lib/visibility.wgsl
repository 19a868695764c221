// Visibility of a dome light from a point.

@group(1) @binding(0) var virtual_maps: texture_depth_2d_array;
@group(1) @binding(1) var phantom_maps: texture_depth_2d_array;
@group(1) @binding(2) var compare: sampler_comparison;

fn inside(uv: vec2f) -> bool {
    return all(abs(uv - vec2f(0.5)) < vec2f(0.5));
}

// A point of a surface that is in the map itself is lifted along the normal by the size of the
// texel that it might share with its own caster; otherwise surfaces shadow themselves in stripes.
fn lifted(i: u32, world: vec3f, n: vec3f, texel: f32, own: f32) -> vec3f {
    if own == 0.0 {
        return world;
    }
    let n_dot_l = dot(n, normalize(towards_light(i, world)));
    let slope = sqrt(max(1.0 - n_dot_l * n_dot_l, 0.0));
    return world + n * (texel * (0.5 + 1.5 * slope));
}

// Evenly distributed points of a disc (Vogel 1979), rotated by the angle of cosine and sine
// `rotation`: compilers precompute all but the rotation.
fn disc(k: i32, count: i32, rotation: vec2f) -> vec2f {
    let angle = 2.39996323 * f32(k);
    let p = sqrt((f32(k) + 0.5) / f32(count)) * vec2f(cos(angle), sin(angle));
    return vec2f(p.x * rotation.x - p.y * rotation.y, p.x * rotation.y + p.y * rotation.x);
}

// Shadow-map coordinates around a point of a surface.
struct MapPoint {
    at: vec3f,
    // Change of u and v per metre across the light.
    across: vec2f,
    // Change of depth per unit of u and of v on the plane.
    slope: vec2f,
    // Metres per unit of depth.
    depth: f32,
}

// A point with a normal: a plane's depth changes by n_u/n_d, n_v/n_d, where n_d is the product of the
// normal with the vector to the light.
fn map_point(i: u32, fit: vec4f, depth: vec2f, p: vec3f, n: vec3f) -> MapPoint {
    let across = vec2f(dot(lights[i].right.xyz, n), dot(lights[i].up.xyz, n));
    let towards = dot(towards_light(i, p), n);
    let steep = select(towards, 1e-3, abs(towards) < 1e-3);
    let slope = clamp(across / steep, vec2f(-4.0), vec2f(4.0)) * (depth.x / max(fit.xy, vec2f(1e-9)));
    return MapPoint(in_shadow_map(in_light_space(i, p), fit, depth), fit.xy, slope, 1.0 / max(depth.x, 1e-9));
}

// Visible fraction of the light's disc by percentage-closer soft shadows (Fernando 2005): the mean
// distance of the blockers within the light's cone gives the penumbra's width, over which the map
// is then filtered.
fn soft(maps: texture_depth_2d_array, i: u32, f: MapPoint, rotation: vec2f) -> f32 {
    let spread = lights[i].more.w;
    let size = vec2f(textureDimensions(maps));
    let widest = spread * max(f.at.z, 0.0) * f.depth * f.across;
    var blockers = 0.0;
    var sum = 0.0;
    for (var k = 0; k < SOFT; k++) {
        let o = disc(k, SOFT, rotation) * widest;
        let uv = f.at.xy + o;
        let texel = clamp(vec2i(uv * size), vec2i(0), vec2i(size) - vec2i(1));
        let z = textureLoad(maps, texel, i, 0);
        let surface = f.at.z + dot(f.slope, o) - 2e-3;
        if inside(uv) && z < surface {
            blockers += 1.0;
            sum += surface - z;
        }
    }
    if blockers == 0.0 {
        return 1.0;
    }
    let width = max(spread * (sum / blockers) * f.depth * f.across, vec2f(0.7) / size);
    var seen = 0.0;
    for (var k = 0; k < SOFT; k++) {
        let o = disc(k, SOFT, rotation) * width;
        let uv = f.at.xy + o;
        let d = clamp(f.at.z + dot(f.slope, o), 0.0, 1.0);
        seen += select(1.0, textureSampleCompareLevel(maps, compare, uv, i, d), inside(uv));
    }
    return seen / f32(SOFT);
}

fn hard(maps: texture_depth_2d_array, i: u32, at: vec3f) -> f32 {
    if !inside(at.xy) {
        return 1.0;
    }
    return textureSampleCompareLevel(maps, compare, at.xy, i, clamp(at.z, 0.0, 1.0));
}

// A rotation that differs between pixels and lights and is the same in every frame.
fn rotation_at(world: vec3f, i: u32) -> vec2f {
    let angle = 6.2831853 * fract(52.9829189 * fract(dot(pixel_of(world).xy, vec2f(0.06711056, 0.00583715))) + 0.618034 * f32(i));
    return vec2f(cos(angle), sin(angle));
}

// `own` = 1 on virtual surfaces, 0 on others.
fn virtual_visibility(i: u32, world: vec3f, n: vec3f, own: f32) -> f32 {
    let p = lifted(i, world, n, lights[i].more.y, own);
    let f = map_point(i, lights[i].virtual_fit, lights[i].depths.xy, p, n);
    if SOFT > 1 {
        return soft(virtual_maps, i, f, rotation_at(world, i));
    }
    return hard(virtual_maps, i, f.at);
}

// `own` = 1 on phantoms, 0 on others. A shift along the light by the depth change of the surface's
// plane across a texel prevents self-shadowing: lifting along the normal would move the rims of
// real shadows by pixels where phantoms are wide and the sun is low.
fn phantom_visibility(i: u32, world: vec3f, n: vec3f, own: f32) -> f32 {
    var f = map_point(i, lights[i].phantom_fit, lights[i].depths.zw, world, n);
    let slope = dot(abs(f.slope), vec2f(1.0) / vec2f(textureDimensions(phantom_maps)));
    f.at.z -= own * (slope + 0.5 * lights[i].more.z * lights[i].depths.z);
    if SOFT > 1 {
        return soft(phantom_maps, i, f, rotation_at(world, i));
    }
    return hard(phantom_maps, i, f.at);
}
