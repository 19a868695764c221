// Surroundings of clipped areas: sums over blocks of the picture, a summed-area table of them (Crow
// 1984), and from it, for each block, the mean of a region around it.
//
// Sums are integers modulo 2^32: differences are exact wherever the sum over the region itself
// fits, regardless of the picture's size.

@group(0) @binding(0) var<uniform> exposure: Exposure;
// By block: red, green and blue of unclipped pixels, times their luminance; clipped pixels.
@group(0) @binding(1) var<storage, read_write> colours: array<vec4u>;
// By block: luminance where any channel is unclipped, and its square; for the paper's rule the
// intensity of all pixels.
@group(0) @binding(2) var<storage, read_write> brightness: array<vec2u>;
// By block: colour of the surroundings, whose greatest channel is its confidence; height above
// white, or, by the paper's rule, mean intensity.
@group(0) @binding(3) var around: texture_storage_2d_array<rgba16float, write>;
@group(1) @binding(0) var camera: texture_2d<f32>;

const LANES = 64u;
// Fixed-point value 1 of a pixel; a block of 16 pixels is rounded once.
const UNIT = 4096.0;

struct Sums {
    colours: vec4u,
    brightness: vec2u,
}

@compute @workgroup_size(8, 8)
fn sum_blocks(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(camera);
    let blocks = blocks_of(size);
    var colour = vec4f(0.0);
    var bright = vec2f(0.0);
    for (var k = 0u; k < 16u; k++) {
        let pixel = (id.xy << vec2u(BLOCK_LOG)) + vec2u(k & 3u, k >> 2u);
        let code = textureLoad(camera, pixel, 0).rgb;
        let c = clipped(code);
        let linear = linear_from_code(code);
        let y = luminance(linear);
        let inside = select(0.0, 1.0, all(pixel < size));
        let any_clipped = max(max(c.r, c.g), c.b);
        let intensity = dot(linear, vec3f(1.0 / 3.0));
        let reliable = inside * select((1.0 - min(min(c.r, c.g), c.b)) * y, intensity, by_paper());
        colour += inside * vec4f(linear * (y * (1.0 - any_clipped)), any_clipped);
        bright += reliable * vec2f(1.0, y);
    }
    if all(id.xy < blocks) {
        let at = id.y * blocks.x + id.x;
        colours[at] = vec4u(round(colour * UNIT));
        brightness[at] = vec2u(round(bright * UNIT));
    }
}

fn by_paper() -> bool {
    return exposure.near.y == 1.0;
}

var<workgroup> totals: array<Sums, LANES>;

fn sum_of(a: Sums, b: Sums) -> Sums {
    return Sums(a.colours + b.colours, a.brightness + b.brightness);
}

// Replaces `count` entries, `stride` apart, by their running sums: each lane sums its own segment,
// then adds the total of all lanes before it (Hillis and Steele 1986).
fn scan(first: u32, stride: u32, count: u32, lane: u32) {
    let each = (count + LANES - 1u) / LANES;
    let begin = min(lane * each, count);
    let end = min(begin + each, count);
    var sum = Sums(vec4u(0u), vec2u(0u));
    for (var i = begin; i < end; i++) {
        let at = first + i * stride;
        sum = sum_of(sum, Sums(colours[at], brightness[at]));
    }
    totals[lane] = sum;
    workgroupBarrier();
    for (var step = 1u; step < LANES; step *= 2u) {
        var reached = totals[lane];
        if lane >= step {
            reached = sum_of(reached, totals[lane - step]);
        }
        workgroupBarrier();
        totals[lane] = reached;
        workgroupBarrier();
    }
    var running = Sums(vec4u(0u), vec2u(0u));
    if lane > 0u {
        running = totals[lane - 1u];
    }
    for (var i = begin; i < end; i++) {
        let at = first + i * stride;
        running = sum_of(running, Sums(colours[at], brightness[at]));
        colours[at] = running.colours;
        brightness[at] = running.brightness;
    }
}

@compute @workgroup_size(LANES)
fn scan_rows(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let blocks = blocks_of(textureDimensions(camera));
    scan(group.x * blocks.x, 1u, blocks.x, lane);
}

@compute @workgroup_size(LANES)
fn scan_columns(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let blocks = blocks_of(textureDimensions(camera));
    scan(group.x, blocks.x, blocks.y, lane);
}

// Sums over all blocks left of and above a corner between blocks.
fn corner(at: vec2i, across: u32) -> Sums {
    let k = u32(max(at.y - 1, 0)) * across + u32(max(at.x - 1, 0));
    if all(at > vec2i(0)) {
        return Sums(colours[k], brightness[k]);
    }
    return Sums(vec4u(0u), vec2u(0u));
}

struct Region {
    colours: vec4f,
    brightness: vec2f,
    pixels: f32,
}

// Sums within `reach` blocks of `block`, by four look-ups.
fn region(block: vec2i, reach: i32, blocks: vec2u, size: vec2u) -> Region {
    let low = max(block - vec2i(reach), vec2i(0));
    let high = min(block + vec2i(reach + 1), vec2i(blocks));
    let a = corner(low, blocks.x);
    let b = corner(vec2i(high.x, low.y), blocks.x);
    let c = corner(vec2i(low.x, high.y), blocks.x);
    let d = corner(high, blocks.x);
    let extent = min(high << vec2u(BLOCK_LOG), vec2i(size)) - (low << vec2u(BLOCK_LOG));
    return Region(
        vec4f((d.colours - b.colours) - (c.colours - a.colours)) / UNIT,
        vec2f((d.brightness - b.brightness) - (c.brightness - a.brightness)) / UNIT,
        f32(extent.x * extent.y),
    );
}

// Estimated light above white of a clipped area, from the region around it: dark surroundings
// indicate a source or its image, and small ones are the brightest: lamps and specular highlights,
// not windows.
fn excess(reliable: vec2f, clipped_share: f32) -> f32 {
    // Weighted by luminance itself, so that the pixels next to the clipped area count and not the
    // dark ones.
    let surround = (reliable.y + MIN_LIGHT * DEFAULT_LUMINANCE) / (reliable.x + MIN_LIGHT);
    let edge = clamp(1.0 - surround, 0.0, 1.0);
    return edge * edge * mix(SMALL_EXCESS, LARGE_EXCESS, smoothstep(SMALL_SHARE, LARGE_SHARE, clipped_share));
}

// 1 where light rises gradually to the clipped area, as around a glow slightly above white; 0 at a
// source's sharp edge, and amid clipped pixels. From the neighbourhood's luminance and clipped
// fraction.
fn gentleness(reliable: f32, clipped_share: f32) -> f32 {
    let free = 1.0 - clipped_share;
    return smoothstep(SHARP, GENTLE, reliable / (free + 1e-3)) * clamp(free * (1.0 / MIN_UNCLIPPED_FRACTION), 0.0, 1.0);
}

@compute @workgroup_size(8, 8)
fn region_means(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(camera);
    let blocks = blocks_of(size);
    let block = vec2i(id.xy);
    let reach = i32(exposure.change.y);
    let inner = region(block, reach, blocks, size);
    let outer = region(block, reach + 1, blocks, size);
    let near = region(block, i32(exposure.near.x), blocks, size);
    let share = exposure.change.z;
    let pixels = mix(inner.pixels, outer.pixels, share);
    let far_colours = mix(inner.colours, outer.colours, share) / pixels;
    let reliable = mix(inner.brightness, outer.brightness, share) / pixels;
    let near_colours = near.colours / near.pixels;
    let colours = near_colours.rgb + FAR_COLOUR * far_colours.rgb;
    let greatest = max(max(colours.r, colours.g), colours.b);
    let gentle = gentleness(near.brightness.x / near.pixels, near_colours.a);
    let above_white = excess(reliable, far_colours.a) * (1.0 - gentle);
    let mean = reliable.x;
    if all(id.xy < blocks) {
        let above = select(above_white, mean, by_paper());
        textureStore(around, id.xy, 0, vec4f(colours / (greatest + FAR_COLOUR * MIN_LIGHT), above));
    }
}
