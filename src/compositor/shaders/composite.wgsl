// The picture: the camera's, darkened where virtual objects keep light away, and the
// virtual objects over it. A pixel that nothing virtual touches is the camera's own code.

@group(1) @binding(0) var camera: texture_2d<f32>;
@group(1) @binding(2) var shadow: texture_2d<f32>;
@group(1) @binding(3) var light: texture_2d<u32>;
@group(1) @binding(4) var phantom_normal: texture_2d<f32>;
@group(1) @binding(5) var phantom_tiles: texture_2d<u32>;
@group(1) @binding(6) var covered_tiles: texture_2d<u32>;
@group(2) @binding(0) var virtual_shape: VIRTUAL_TEXTURE;
@group(2) @binding(1) var virtual_material: VIRTUAL_TEXTURE;
@group(2) @binding(2) var virtual_depth: VIRTUAL_DEPTH;
@group(3) @binding(0) var smooth_sampler: sampler;
@group(3) @binding(1) var radiance: texture_cube<f32>;
@group(3) @binding(2) var surroundings: texture_2d<f32>;
@group(3) @binding(3) var specular_table: texture_2d<f32>;

const PI = 3.14159265;

// A texel of the shadow buffer is a point, and its few look-ups of each light are turned from
// texel to texel; a camera's pixel is an area. So the neighbours on the same side of all
// real edges count, too.
fn smooth_shadow_at(pixel: vec2i) -> vec3f {
    let last = vec2i(textureDimensions(shadow)) - vec2i(1);
    let own = textureLoad(shadow, pixel, 0);
    var sum = 4.0 * own.rgb;
    var weight = 4.0;
    for (var k = 0; k < 8; k++) {
        let q = clamp(pixel + vec2i(round(around(k))), vec2i(0), last);
        let there = textureLoad(shadow, q, 0);
        let w = select(select(1.0, 2.0, (k & 1) == 0), 0.0, real_edge(own.a, there.a));
        sum += there.rgb * w;
        weight += w;
    }
    return sum / weight;
}

// The shadow buffer may be coarser than the picture: its texels count where they lie on
// the same surface.
fn shadow_at(pixel: vec2i, position: vec4f) -> vec3f {
    let step = i32(decided_here(frame.counts.z, position.w));
    if FINE {
        return smooth_shadow_at(pixel);
    }
    let surface = textureLoad(phantom_normal, pixel, 0);
    let base = pixel >> vec2u(frame.tiling.z);
    let part = vec2f(pixel - base * step) / f32(step);
    let last = vec2i(textureDimensions(shadow)) - vec2i(1);
    var sum = vec3f(0.0);
    var weight = 0.0;
    for (var k = 0; k < 4; k++) {
        let o = vec2i(k & 1, k >> 1u);
        let there = textureLoad(shadow, min(base + o, last), 0);
        let bilinear = select(1.0 - part.x, part.x, o.x == 1) * select(1.0 - part.y, part.y, o.y == 1);
        let w = bilinear * select(1e-3, 1.0, key_of(there.a) == surface.w);
        sum += there.rgb * w;
        weight += w;
    }
    return select(vec3f(select(1.0, 0.0, frame.counts.y == 1u)), sum / weight, surface.z == 1.0);
}

// Irradiance of the virtual surface under a sample, `z` metres along the view. The texel of
// a pixel is its first sample's: `own` = whether this is that surface.
fn light_at(pixel: vec2i, n: vec3f, z: f32, own: bool) -> vec3f {
    let step = i32(frame.counts.z);
    if (step == 1) & own {
        return unpacked_light(textureLoad(light, pixel, 0)).irradiance;
    }
    let base = pixel >> vec2u(frame.tiling.z);
    let part = vec2f(pixel - base * step) / f32(step);
    let last = vec2i(textureDimensions(light)) - vec2i(1);
    var sum = vec3f(0.0);
    var weight = 0.0;
    for (var k = 0; k < 4; k++) {
        let o = vec2i(k & 1, k >> 1u);
        let there = unpacked_light(textureLoad(light, min(base + o, last), 0));
        let bilinear = select(1.0 - part.x, part.x, o.x == 1) * select(1.0 - part.y, part.y, o.y == 1);
        // At full resolution the pixel's own texel shows another surface here.
        let near = select(bilinear, select(0.3, 0.0, k == 0), step == 1);
        let same_way = max(dot(n, there.normal), 0.0);
        let fourth = same_way * same_way * same_way * same_way;
        let same_depth = 1.0 / (1e-2 + abs(there.z - z) / z);
        let w = select(0.0, near * fourth * same_depth + 1e-6, there.z > 0.0);
        sum += there.irradiance * w;
        weight += w;
    }
    return sum / max(weight, 1e-9);
}

// Radiance of the real ground at a world point, blurred to `metres` across.
fn ground_radiance(world: vec3f, metres: f32) -> vec4f {
    let p = pixel_of(world);
    let uv = (p.xy + vec2f(0.5)) * frame.size.zw;
    let edge = min(min(uv.x, 1.0 - uv.x), min(uv.y, 1.0 - uv.y));
    let inside = smoothstep(-0.02, 0.05, edge) * select(0.0, 1.0, p.z > frame.eye.w);
    // Level 0 of the surroundings is half the picture.
    let pixels = metres * frame.intrinsics.x / max(p.z, 1e-3);
    let lod = clamp(log2(max(pixels * 0.5, 1.0)), 0.0, frame.params.w);
    let seen = textureSampleLevel(surroundings, smooth_sampler, clamp(uv, vec2f(0.0), vec2f(1.0)), lod).rgb;
    return vec4f(seen, inside);
}

// What a ray of the given spread meets: the ground as the picture shows it, or the
// environment.
fn reflected(world: vec3f, r: vec3f, roughness: f32) -> vec3f {
    let far = textureSampleLevel(radiance, smooth_sampler, r, roughness * f32(frame.counts.w)).rgb;
    let below = frame.params.z * smoothstep(0.0, max(0.6 * roughness * roughness, 0.02), -r.z);
    if below == 0.0 {
        return far;
    }
    let t = (world.z - frame.params.y) / max(-r.z, 1e-3);
    let spread = 2.0 * t * roughness * roughness;
    let near = ground_radiance(world + r * t, spread);
    return mix(far, mix(frame.ground.rgb, near.rgb, near.a), below);
}

// Light thrown up by the ground close by instead of the ground at large.
fn bounce(world: vec3f, n: vec3f) -> vec3f {
    let height = max(world.z - frame.params.y, 0.0);
    let share = frame.params.z * 0.5 * (1.0 - n.z);
    let aside = normalize(vec3f(n.xy, -0.7));
    let foot = world + aside * (height / 0.7 * length(vec3f(n.xy, -0.7)));
    let near = ground_radiance(vec3f(foot.xy, frame.params.y), 2.0 * height + 0.01);
    let far = sky_irradiance(vec3f(0.0, 0.0, -1.0));
    return share * (PI * mix(frame.ground.rgb, near.rgb, near.a) - far);
}

fn shade(pixel: vec2i, s: i32, own: bool) -> vec3f {
    let shape = textureLoad(virtual_shape, pixel, s);
    let material = textureLoad(virtual_material, pixel, s);
    let base = base_colour(shape);
    let properties = properties_of(material);
    let n = normal_from_octahedron(octahedron(shape));
    let depth = textureLoad(virtual_depth, pixel, s);
    let world = world_at(sample_place(pixel, s), depth);
    let v = normalize(frame.eye.xyz - world);
    let n_dot_v = clamp(dot(n, v), 0.02, 1.0);
    let metallic = properties.x;
    let roughness = clamp(properties.y, 0.03, 1.0);

    let direct = light_at(pixel, n, frame.eye.w / depth, own);
    let irradiance = max(direct + bounce(world, n), vec3f(0.0)) * properties.w;
    let f0 = mix(vec3f(0.04 * properties.z), base, metallic);
    let table = textureSampleLevel(specular_table, smooth_sampler, vec2f(n_dot_v, roughness), 0.0).rg;
    let mirrored = reflected(world, reflect(-v, n), roughness);
    let f90 = select(0.0, 1.0, properties.z > 0.0 || metallic > 0.0);
    let specular = (f0 * table.x + vec3f(f90 * table.y)) * mirrored;
    let diffuse = base * (1.0 - metallic) * irradiance / PI;
    let lamps = lamp_highlights(world, n, v, f0, f90, roughness);
    return diffuse + specular + lamps + emissive_of(material);
}

// Whether two samples of a pixel see one surface, by their depth and encoded normal.
fn same_surface(pixel: vec2i, a: i32, b: i32) -> bool {
    let turned = abs(octahedron(textureLoad(virtual_shape, pixel, a)) - octahedron(textureLoad(virtual_shape, pixel, b)));
    let d = textureLoad(virtual_depth, pixel, a);
    return max(turned.x, turned.y) < 0.2 && abs(textureLoad(virtual_depth, pixel, b) - d) < 0.02 * d;
}

// Real surfaces in shadow, where nothing virtual is in the tile.
@vertex
fn real_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    let t = v / 6u;
    let across = textureDimensions(phantom_tiles).x;
    let tile = vec2u(t % across, t / across);
    let shadowed = any(textureLoad(phantom_tiles, tile, 0).xy != vec2u(0u));
    return tile_corner(v % 6u, tile, NOTHING_VIRTUAL, shadowed && !tile_is_covered(tile));
}

// Kinds of pixels in tiles that virtual objects reach, as depths; draws for one kind only
// have a depth between them. Testing depth is what software drivers leave pixels out by,
// and not branches.
const OUTLINE = 0.0;
const NOTHING_VIRTUAL = 0.5;
const WHOLE = 1.0;

fn covered_tile(v: u32, depth: f32) -> vec4f {
    let t = v / 6u;
    let across = textureDimensions(phantom_tiles).x;
    let tile = vec2u(t % across, t / across);
    return tile_corner(v % 6u, tile, depth, tile_is_covered(tile));
}

@vertex
fn background_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return covered_tile(v, NOTHING_VIRTUAL);
}

@vertex
fn outline_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return covered_tile(v, 0.5 * (OUTLINE + NOTHING_VIRTUAL));
}

@vertex
fn whole_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return covered_tile(v, 0.5 * (NOTHING_VIRTUAL + WHOLE));
}

fn shadowed(code: vec3f, factor: vec3f) -> vec3f {
    let linear = linear_from_code(code);
    return select(linear * factor, max(linear - factor, vec3f(0.0)), frame.counts.y == 1u);
}

fn encoded(linear: vec3f) -> vec4f {
    return vec4f(code_from_linear(linear), 1.0);
}

// The range of what is shown on both sides of a real edge near `pixel`; empty (low > high)
// where there is none. A texel is certain where no edge is close by.
struct Range {
    low: vec3f,
    high: vec3f,
}

// Key of the surface across a real edge near `pixel`, its own at the rim of a real shadow;
// -1 where there is no edge, or one that makes no difference.
fn across_real_edge(pixel: vec2i, own: vec4f, last: vec2i) -> f32 {
    var other = -1.0;
    for (var k = 0; k < 16; k++) {
        let r = DOUBT * select(1.0, 0.5, k >= 8);
        let q = clamp(pixel + vec2i(round(around(k) * r)), vec2i(0), last);
        let there = textureLoad(shadow, q, 0);
        let differs = any(abs(there.rgb - own.rgb) > vec3f(0.15));
        other = select(other, key_of(there.a), differs & real_edge(own.a, there.a));
    }
    return other;
}

fn is_certain(q: vec2i, there: vec4f, last: vec2i) -> bool {
    var certain = true;
    for (var k = 0; k < 8; k += 2) {
        let beside = clamp(q + vec2i(round(around(k) * 2.0)), vec2i(0), last);
        certain &= !real_edge(there.a, textureLoad(shadow, beside, 0).a);
    }
    return certain;
}

fn beside_edge(pixel: vec2i) -> Range {
    let last = vec2i(textureDimensions(shadow)) - vec2i(1);
    let own = textureLoad(shadow, pixel, 0);
    let other = across_real_edge(pixel, own, last);
    var range = Range(vec3f(1e9), vec3f(-1e9));
    if other < 0.0 {
        return range;
    }
    var on_own = false;
    var across = false;
    for (var k = 0; k < 16; k++) {
        let r = DOUBT * select(1.5, 2.5, k >= 8);
        let q = clamp(pixel + vec2i(round(around(k) * r)), vec2i(0), last);
        let there = textureLoad(shadow, q, 0);
        let key = key_of(there.a);
        let counts = ((key == key_of(own.a)) | (key == other)) && is_certain(q, there, last);
        let linear = linear_from_code(textureLoad(camera, q, 0).rgb);
        // On the pixel's own side its own factor counts too: the shadow of something thin,
        // or in a corner, may lie between the texels looked at.
        let same = !real_edge(own.a, there.a);
        let least = select(there.rgb, min(there.rgb, own.rgb), same);
        let most = select(there.rgb, max(there.rgb, own.rgb), same);
        range.low = select(range.low, min(range.low, linear * least), counts);
        range.high = select(range.high, max(range.high, linear * most), counts);
        on_own |= counts & (key == key_of(own.a));
        across |= counts & (key == other);
    }
    if !(on_own & across) {
        return Range(vec3f(1e9), vec3f(-1e9));
    }
    return range;
}

fn background_at(pixel: vec2i, position: vec4f) -> vec4f {
    let code = textureLoad(camera, pixel, 0);
    let factor = shadow_at(pixel, position);
    var range = Range(vec3f(1.0), vec3f(0.0));
    if FINE && frame.counts.y == 0u {
        range = beside_edge(pixel);
    }
    let free = range.low.r > range.high.r;
    if free && all(factor == vec3f(select(1.0, 0.0, frame.counts.y == 1u))) {
        return code;
    }
    let linear = shadowed(code.rgb, factor);
    return encoded(select(clamp(linear, range.low, range.high), linear, free));
}

@fragment
fn real(@builtin(position) position: vec4f) -> @location(0) vec4f {
    return background_at(vec2i(position.xy), position);
}

struct Background {
    @location(0) colour: vec4f,
    @builtin(frag_depth) kind: f32,
}

// What is behind virtual objects, and of which kind the pixel is.
@fragment
fn background(@builtin(position) position: vec4f) -> Background {
    let pixel = vec2i(position.xy);
    var covered = 0;
    var alike = true;
    for (var s = 0; s < SAMPLES; s++) {
        covered += select(0, 1, is_surface(textureLoad(virtual_shape, pixel, s)));
        alike &= same_surface(pixel, 0, s);
    }
    let kind = select(OUTLINE, WHOLE, alike & (covered == SAMPLES));
    return Background(background_at(pixel, position), select(kind, NOTHING_VIRTUAL, covered == 0));
}

// Pixels that show one virtual surface.
@fragment
fn whole(@builtin(position) position: vec4f) -> @location(0) vec4f {
    return encoded(shade(vec2i(position.xy), 0, true));
}

// Pixels of which virtual objects cover a part, or show several surfaces.
@fragment
fn outline(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(position.xy);
    let code = textureLoad(camera, pixel, 0);
    let factor = shadow_at(pixel, position);
    var covered = 0;
    var first = 0;
    for (var s = SAMPLES - 1; s >= 0; s--) {
        if is_surface(textureLoad(virtual_shape, pixel, s)) {
            first = s;
            covered += 1;
        }
    }
    var linear = shadowed(code.rgb, factor) * (f32(SAMPLES - covered) / f32(SAMPLES));
    // Samples on either side of an outline or a crease are lit apart. The condition is at
    // the loop's end, because software drivers run what a loop holds once more than any
    // pixel asks for.
    let of_pixel = first;
    loop {
        var alike = 0;
        var other = first;
        for (var s = SAMPLES - 1; s >= 0; s--) {
            if s >= first && is_surface(textureLoad(virtual_shape, pixel, s)) {
                if same_surface(pixel, first, s) {
                    alike += 1;
                } else {
                    other = s;
                }
            }
        }
        linear += shade(pixel, first, first == of_pixel) * (f32(alike) / f32(SAMPLES));
        covered -= alike;
        first = other;
        continuing {
            break if covered <= 0 || alike == 0;
        }
    }
    return encoded(linear);
}
