// Simulates a shorter or longer exposure of the camera's picture: linear, and as codes.

@group(0) @binding(0) var<uniform> exposure: Exposure;
@group(0) @binding(1) var<storage, read> colours: array<vec4u>;
@group(0) @binding(2) var around: texture_2d<f32>;
@group(0) @binding(3) var around_sampler: sampler;
@group(1) @binding(0) var camera: texture_2d<f32>;

// Side of a tile, pixels, as a power of two.
const TILE_LOG = 5u;

fn clipped_before(corner: vec2u, across: u32) -> u32 {
    let at = max(corner, vec2u(1u)) - vec2u(1u);
    return select(0u, colours[at.y * across + at.x].w, all(corner > vec2u(0u)));
}

// Whether any channel of any pixel in a tile is clipped. The integer sums are exact.
fn tile_is_clipped(tile: vec2u) -> bool {
    let blocks = blocks_of(textureDimensions(camera));
    let low = min(tile << vec2u(TILE_LOG - BLOCK_LOG), blocks);
    let high = min((tile + vec2u(1u)) << vec2u(TILE_LOG - BLOCK_LOG), blocks);
    let above = clipped_before(vec2u(high.x, low.y), blocks.x) - clipped_before(low, blocks.x);
    let below = clipped_before(high, blocks.x) - clipped_before(vec2u(low.x, high.y), blocks.x);
    return below != above;
}

fn corner_of_tile(v: u32, clipped_tiles: bool) -> vec4f {
    let size = textureDimensions(camera);
    let across = (size.x + (1u << TILE_LOG) - 1u) >> TILE_LOG;
    let tile = vec2u((v / 6u) % across, (v / 6u) / across);
    let k = v % 6u;
    let o = vec2u(select(0u, 1u, k == 1u || k == 2u || k == 4u), select(0u, 1u, k >= 2u && k != 3u));
    let pixel = vec2f((tile + o) << vec2u(TILE_LOG)) / vec2f(size);
    let ndc = vec4f(pixel.x * 2.0 - 1.0, 1.0 - pixel.y * 2.0, 0.0, 1.0);
    return select(vec4f(2.0, 2.0, 2.0, 1.0), ndc, tile_is_clipped(tile) == clipped_tiles);
}

@vertex
fn plain_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return corner_of_tile(v, false);
}

@vertex
fn clipped_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return corner_of_tile(v, true);
}

struct Exposed {
    @location(0) linear: vec4f,
    @location(1) code: vec4f,
}

// The codes are computed from the half floats, so that later passes find the same.
fn exposed(linear: vec3f) -> Exposed {
    let kept = vec3f(
        unpack2x16float(pack2x16float(linear.rg)),
        unpack2x16float(pack2x16float(vec2f(linear.b, 0.0))).x,
    );
    return Exposed(vec4f(kept, 1.0), vec4f(code_from_linear(kept), 1.0));
}

@fragment
fn scaled(@builtin(position) position: vec4f) -> Exposed {
    let c = vec3u(textureLoad(camera, vec2i(position.xy), 0).rgb * 255.0 + 0.5);
    let at = c >> vec3u(2u);
    let k = c & vec3u(3u);
    let linear = vec3f(exposure.linear[at.r][k.r], exposure.linear[at.g][k.g], exposure.linear[at.b][k.b]);
    let code = vec3f(exposure.codes[at.r][k.r], exposure.codes[at.g][k.g], exposure.codes[at.b][k.b]);
    return Exposed(vec4f(linear, 1.0), vec4f(code, 1.0));
}

// Section 4.3 of the paper: "we adjust the factor by which intensities are scaled, based on the
// average intensity of surrounding pixels": the full change of exposure where the surroundings are
// black, none where they are white.
@fragment
fn scaled_by_region(@builtin(position) position: vec4f) -> Exposed {
    let linear = linear_from_code(textureLoad(camera, vec2i(position.xy), 0).rgb);
    let uv = position.xy / vec2f(textureDimensions(around) << vec2u(BLOCK_LOG));
    let mean = textureSampleLevel(around, around_sampler, uv, 0.0).a;
    return exposed(linear * mix(exposure.change.x, 1.0, mean));
}

// A clipped channel gets at least the light that its pixel's unclipped channels imply in the colour
// of the surroundings; where none is reliable, the estimate for clipped areas of the region.
@fragment
fn highlights(@builtin(position) position: vec4f) -> Exposed {
    let code = textureLoad(camera, vec2i(position.xy), 0).rgb;
    let c = clipped(code);
    let linear = linear_from_code(code);
    // A block's centre lies on a texel's.
    let uv = position.xy / vec2f(textureDimensions(around) << vec2u(BLOCK_LOG));
    let there = textureSampleLevel(around, around_sampler, uv, 0.0);
    let reliable = vec3f(1.0) - c;
    let scale = dot(reliable, linear) / max(dot(reliable, there.rgb), 1e-6);
    let by_colour = clamp(scale * there.rgb, vec3f(1.0), vec3f(MAX_BY_COLOUR));
    let by_region = vec3f(1.0 + there.a);
    let confidence = max(max(there.r, there.g), there.b);
    let known = clamp(reliable.r + reliable.g + reliable.b, 0.0, 1.0) * confidence;
    let level = exp2(mix(log2(by_region), log2(by_colour), vec3f(known)));
    return exposed(mix(linear, max(level, linear), c * exposure.change.w) * exposure.change.x);
}
