// Writes the light of shadowing planes into the surface cache, page by page. Every texel knows the
// two planes that serve it, so that it takes two look-ups whatever the number of planes. Equations
// as in `planes_shadow`.

// Fractions of the dome's light on an open surface: past all casters, and past phantoms alone.
@group(1) @binding(1) var share_all: texture_2d_array<f32>;
@group(1) @binding(2) var share_real: texture_2d_array<f32>;
@group(1) @binding(3) var plane_sampler: sampler;
// Points and normals of the texels, world.
@group(2) @binding(0) var points: texture_2d<f32>;
@group(2) @binding(1) var normals: texture_2d<f32>;
// A plane each: coordinates on it, its layer, its weight; the rest of the weight is unshadowed.
@group(2) @binding(2) var first_plane: texture_2d<f32>;
@group(2) @binding(3) var second_plane: texture_2d<f32>;
// Indirect light: on real surfaces the change that virtual objects cause, and the light in the real
// scene; on virtual ones all of it, and nothing.
@group(2) @binding(4) var indirect_first: texture_2d<f32>;
@group(2) @binding(5) var indirect_second: texture_2d<f32>;
// The light of compact sources, as in the surface cache, where planes leave it out.
@group(2) @binding(6) var compact_first: texture_2d<f32>;
@group(2) @binding(7) var compact_second: texture_2d<f32>;

// Texels along a side of a page with its border, and logarithm of the number of pages in a row.
const BORDERED = 18u;
const PAGES_LOG = 6u;

// A texel of each of the cache's textures.
struct Kept {
    @location(0) first: vec4f,
    @location(1) second: vec4f,
}

// The rectangle of pages side by side, two triangles. `run`: number of the first, number of pages.
@vertex
fn page_run(@builtin(vertex_index) v: u32, @location(0) run: vec2u) -> @builtin(position) vec4f {
    let row = 1u << PAGES_LOG;
    let corner = vec2u(u32(v == 1u || v == 2u || v == 4u), u32(v == 2u || v == 4u || v == 5u));
    let first = vec2u(run.x & (row - 1u), run.x >> PAGES_LOG);
    let texel = (first + corner * vec2u(run.y, 1u)) * BORDERED;
    let uv = vec2f(texel) / vec2f(textureDimensions(points));
    return vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, 0.0, 1.0);
}

fn shares_of(layers: texture_2d_array<f32>, a: vec4f, b: vec4f) -> vec3f {
    let of_a = textureSampleLevel(layers, plane_sampler, a.xy, u32(a.z), 0.0).rgb * a.w;
    let of_b = textureSampleLevel(layers, plane_sampler, b.xy, u32(b.z), 0.0).rgb * b.w;
    return of_a + of_b + vec3f(1.0 - a.w - b.w);
}

// Unshadowed irradiance of the dome that planes shadow, and of the compact sources that they leave
// out.
struct Dome {
    planes: vec3f,
    apart: vec3f,
}

fn dome_on(n: vec3f) -> Dome {
    let apart = by_normal(irradiance_of_compact, n) * f32(frame.counts.z);
    return Dome(by_normal(irradiance_of_lights, n) - apart, apart);
}

// Indirect light is written when it changes, because it costs more than all other light.
@fragment
fn indirect_on_real(@builtin(position) at: vec4f) -> Kept {
    let n = textureLoad(normals, vec2i(at.xy), 0).xyz;
    let world = textureLoad(points, vec2i(at.xy), 0).xyz;
    let change = indirect_irradiance(0.0, world, n);
    return Kept(vec4f(change, 0.0), vec4f(indirect_irradiance(1.0, world, n), 0.0));
}

@fragment
fn indirect_on_virtual(@builtin(position) at: vec4f) -> Kept {
    let n = textureLoad(normals, vec2i(at.xy), 0).xyz;
    let world = textureLoad(points, vec2i(at.xy), 0).xyz;
    return Kept(vec4f(indirect_light_on_virtual(world, n).rgb, 0.0), vec4f(0.0));
}

@fragment
fn light_on_real(@builtin(position) at: vec4f) -> Kept {
    let texel = vec2i(at.xy);
    let a = textureLoad(first_plane, texel, 0);
    let b = textureLoad(second_plane, texel, 0);
    let n = textureLoad(normals, texel, 0).xyz;
    let dome = dome_on(n);
    let real = shares_of(share_real, a, b);
    let kept = dome.planes * max(real - shares_of(share_all, a, b), vec3f(0.0));
    let apart = f32(frame.counts.z);
    let kept_apart = textureLoad(compact_first, texel, 0).rgb * apart;
    // Minus the indirect light from virtual objects.
    let lost = kept + kept_apart - textureLoad(indirect_first, texel, 0).rgb;
    let other = ground_irradiance(n) + textureLoad(indirect_second, texel, 0).rgb;
    let open = other + dome.planes + dome.apart;
    let arriving = other + dome.planes * real + textureLoad(compact_second, texel, 0).rgb * apart;
    let bounded = max(max(arriving, lost), vec3f(1e-6));
    return Kept(vec4f(lost, 1.0), vec4f(bounded, bounded.g / max(open.g, 1e-6)));
}

@fragment
fn light_on_virtual(@builtin(position) at: vec4f) -> Kept {
    let texel = vec2i(at.xy);
    let a = textureLoad(first_plane, texel, 0);
    let b = textureLoad(second_plane, texel, 0);
    let n = textureLoad(normals, texel, 0).xyz;
    let dome = dome_on(n);
    let sky = sky_irradiance(n) + by_normal(irradiance_of_compact, n);
    let compact = textureLoad(compact_first, texel, 0);
    let remaining_apart = f32(frame.counts.z) * compact.rgb / max(compact.a, 1e-4);
    let hidden = dome.planes * (1.0 - shares_of(share_all, a, b)) + dome.apart - remaining_apart;
    let light = max(sky - hidden + textureLoad(indirect_first, texel, 0).rgb, vec3f(0.0));
    // Texels inside other objects are black; the weight keeps them out of interpolation.
    let share = dot(light, vec3f(1.0)) / max(dot(sky, vec3f(1.0)), 1e-6);
    let weight = clamp(8.0 * share, 0.01, 1.0);
    return Kept(vec4f(light * weight, weight), vec4f(0.0));
}
