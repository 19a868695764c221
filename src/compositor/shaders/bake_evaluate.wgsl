// Light lost between a light and the texels of all planes, cosθ · (1 − V): `add` adds one direction
// of light, `finish` converts the sums to 8-bit images. In `finish` four texels of a row share an
// invocation, because they share a word.

struct Direction {
    model_u: vec4f,
    model_v: vec4f,
    model_depth: vec4f,
    phantom_u: vec4f,
    phantom_v: vec4f,
    phantom_depth: vec4f,
    // Direction to the light; w = its fraction of the face.
    towards: vec4f,
    // Texel sizes of both maps, metres; 1 if the map exists.
    texels: vec4f,
    // Number of the first plane of this dispatch; 0; 0; 0.
    planes: vec4u,
}

struct Plane {
    // Centre of the rectangle; w = depth of the slab, metres.
    centre: vec4f,
    // Unit vectors; w = half extent of the rectangle along them, metres.
    right: vec4f,
    up: vec4f,
    // x: 1 if the receiver is the plane itself; y: 1 on virtual parts.
    kind: vec4u,
}

@group(0) @binding(0) var<uniform> light: Direction;
@group(0) @binding(1) var<storage, read> planes: array<Plane>;
// Per texel: octahedral normal as two signed 16 bits; depth, 16 bits.
@group(0) @binding(2) var<storage, read> receivers: array<vec2u>;
@group(0) @binding(3) var model_map: texture_depth_2d;
@group(0) @binding(4) var phantom_map: texture_depth_2d;
@group(0) @binding(5) var compare: sampler_comparison;
// Per texel: Σ w cos (1 − V) past all casters, past phantoms alone, and Σ w cos.
@group(0) @binding(6) var<storage, read_write> sums: array<vec4f>;
// Per four texels: light lost past all casters; then, for all planes, past phantoms.
@group(0) @binding(7) var<storage, read_write> lost: array<u32>;
// Per plane, whether any light arrives and whether any is blocked: the bits of `flags_of`.
@group(0) @binding(8) var<storage, read_write> flags: array<atomic<u32>>;

fn seen(map: texture_depth_2d, u: vec4f, v: vec4f, d: vec4f, world: vec3f) -> f32 {
    let p = vec4f(world, 1.0);
    let uv = vec2f(dot(u, p), dot(v, p));
    let open = textureSampleCompareLevel(map, compare, uv, clamp(dot(d, p), 0.0, 1.0));
    return select(1.0, open, all(abs(uv - vec2f(0.5)) < vec2f(0.5)));
}

// A receiver that is in a map itself is lifted off its own surface by the map's texel size.
fn lift(n: vec3f, n_dot_l: f32, texel: f32) -> vec3f {
    let slope = sqrt(max(1.0 - n_dot_l * n_dot_l, 0.0));
    return n * (texel * (1.0 + 2.0 * slope));
}

@compute @workgroup_size(64)
fn add(@builtin(global_invocation_id) id: vec3u) {
    let side = RESOLUTION;
    let texel = id.x;
    let k = id.y + light.planes.x;
    if texel >= side * side {
        return;
    }
    let plane = planes[k];
    let receiver = receivers[k * side * side + texel];
    let out = cross(plane.right.xyz, plane.up.xyz);
    let flat = plane.kind.x == 1u;
    let n = select(normal_from_octahedron(unpack2x16snorm(receiver.x)), out, flat);
    let n_dot_l = dot(n, light.towards.xyz);
    let nothing = !flat & (receiver.y == 65535u);
    if n_dot_l <= 0.0 || nothing {
        return;
    }
    let depth = select(f32(receiver.y) / 65534.0 * plane.centre.w, 0.0, flat);
    let size = vec2f(plane.right.w, plane.up.w) * 2.0 / f32(side);
    let at = vec2f(f32(texel % side) + 0.5, f32(texel / side) + 0.5) * size - vec2f(plane.right.w, plane.up.w);
    // A texel is an area: four of its points are sampled, no two in a row or column, on the
    // receiver's own slope.
    let steep = max(dot(n, out), 0.25);
    let slope = vec2f(dot(n, plane.right.xyz), dot(n, plane.up.xyz)) / steep;
    let own = lift(n, n_dot_l, 1.0) * select(1.0, 0.0, flat);
    let off_model = own * light.texels.x * f32(plane.kind.y);
    let off_phantom = own * light.texels.y * f32(1u - plane.kind.y);
    var closed = vec2f(0.0);
    for (var i = 0u; i < 4u; i++) {
        let o = vec2f(vec2i(4 * i32(i & 1u) - 2 * i32(i >> 1u) - 1, 2 * i32(i) - 3)) / 8.0 * size;
        let across = plane.right.xyz * (at.x + o.x) - plane.up.xyz * (at.y + o.y);
        let behind = depth + dot(slope, vec2f(o.x, -o.y));
        let world = plane.centre.xyz + across - out * behind;
        let m = seen(model_map, light.model_u, light.model_v, light.model_depth, world + off_model);
        let p = seen(phantom_map, light.phantom_u, light.phantom_v, light.phantom_depth, world + off_phantom);
        let past_phantoms = select(1.0, p, light.texels.w > 0.0);
        let past_all = past_phantoms * select(1.0, m, light.texels.z > 0.0);
        closed += vec2f(1.0) - vec2f(past_all, past_phantoms);
    }
    let weight = light.towards.w * n_dot_l;
    sums[k * side * side + texel] += vec4f(closed * (0.25 * weight), weight, 0.0);
}

fn lost_at(k: u32, texel: u32) -> vec2f {
    let s = sums[texel];
    if s.z <= 0.0 {
        return vec2f(0.0);
    }
    atomicOr(&flags[k], flags_of(s));
    return clamp(s.xy, vec2f(0.0), vec2f(1.0));
}

@compute @workgroup_size(64)
fn finish(@builtin(global_invocation_id) id: vec3u) {
    let words = RESOLUTION * RESOLUTION / 4u;
    if id.x >= words {
        return;
    }
    let word = id.y * words + id.x;
    let a = lost_at(id.y, 4u * word);
    let b = lost_at(id.y, 4u * word + 1u);
    let c = lost_at(id.y, 4u * word + 2u);
    let d = lost_at(id.y, 4u * word + 3u);
    lost[word] = pack4x8unorm(vec4f(a.x, b.x, c.x, d.x));
    lost[arrayLength(&lost) / 2u + word] = pack4x8unorm(vec4f(a.y, b.y, c.y, d.y));
}
