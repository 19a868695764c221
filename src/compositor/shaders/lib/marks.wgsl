// Marks the texels of the shadow buffer that need work, on real and on virtual surfaces.

@group(2) @binding(0) var phantom_normal: texture_2d<f32>;
@group(2) @binding(1) var phantom_depth: texture_depth_2d;
@group(2) @binding(2) var virtual_shape: VIRTUAL_TEXTURE;
@group(2) @binding(3) var virtual_depth: VIRTUAL_DEPTH;
@group(2) @binding(4) var phantom_tiles: texture_2d<u32>;
@group(2) @binding(5) var virtual_tiles: texture_2d<u32>;
@group(2) @binding(6) var covered_tiles: texture_2d<u32>;
@group(2) @binding(7) var phantom_lamps: texture_2d<u32>;
@group(2) @binding(8) var virtual_lamps: texture_2d<u32>;
IF_CACHED @group(2) @binding(9) var phantom_place: texture_2d<u32>;

// Texels that need work are first marked in a depth buffer, and the work is drawn with a depth
// test: software drivers run both sides of every branch, but skip fragments that fail the test.
const MARK = 1.0;

@vertex
fn behind_marks(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(f32(i32(i & 1u) * 4 - 1), f32(i32(i >> 1u) * 4 - 1), 0.5 * MARK, 1.0);
}

// Marks real surfaces in tiles that may lose some light.
@fragment
fn mark_phantoms(@builtin(position) at: vec4f) -> @builtin(frag_depth) f32 {
    let pixel = vec2i(at.xy);
    let there = textureLoad(phantom_normal, pixel, 0).z == 1.0;
    let loses_light = any(textureLoad(phantom_tiles, tile_of(pixel), 0).xy != vec2u(0u));
    return select(0.0, MARK, there & loses_light);
}

// Marks texels that virtual surfaces cover at least partly.
@fragment
fn mark_virtual(@builtin(position) at: vec4f) -> @builtin(frag_depth) f32 {
    return select(0.0, MARK, covered_sample(vec2i(at.xy)).z >= 0);
}

// The pixel and its first covered sample; z < 0 = none.
fn covered_sample(pixel: vec2i) -> vec3i {
    let last = select(-1, SAMPLES - 1, tile_is_covered(tile_of(pixel)));
    for (var i = 0; i <= last; i++) {
        if is_surface(textureLoad(virtual_shape, pixel, i)) {
            return vec3i(pixel, i);
        }
    }
    return vec3i(0, 0, -1);
}
