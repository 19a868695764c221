// The composite: the camera's picture, darkened where virtual objects block light, with the virtual
// objects over it. A pixel without virtual contribution is the camera's own code.

@group(1) @binding(0) var camera: texture_2d<f32>;
@group(1) @binding(2) var shadow: texture_2d<f32>;
@group(1) @binding(3) var light: texture_2d<u32>;
@group(1) @binding(4) var phantom_tiles: texture_2d<u32>;
@group(1) @binding(5) var covered_tiles: texture_2d<u32>;
@group(1) @binding(6) var virtual_lamps: texture_2d<u32>;
@group(1) @binding(7) var response: texture_2d<f32>;
@group(1) @binding(8) var edge_tiles: texture_2d<u32>;
@group(2) @binding(0) var virtual_shape: VIRTUAL_TEXTURE;
@group(2) @binding(1) var virtual_material: VIRTUAL_TEXTURE;
@group(2) @binding(2) var virtual_depth: VIRTUAL_DEPTH;
IF_CACHED @group(2) @binding(3) var virtual_place: VIRTUAL_TEXTURE;
@group(3) @binding(0) var smooth_sampler: sampler;
@group(3) @binding(1) var radiance: texture_cube<f32>;
@group(3) @binding(2) var surroundings: texture_2d<f32>;
@group(3) @binding(3) var gloss_table: texture_2d<f32>;
@group(3) @binding(4) var phong_radiance: texture_cube<f32>;

const PI = 3.14159265;

// Irradiance of the virtual surface under a sample, `z` metres along the view. The texel of a pixel
// holds its first sample's surface: `own` = whether this is that surface.
fn light_at(pixel: vec2i, n: vec3f, z: f32, own: bool) -> vec3f {
    if own {
        return unpacked_light(textureLoad(light, pixel, 0)).irradiance;
    }
    let last = vec2i(textureDimensions(light)) - vec2i(1);
    var sum = vec3f(0.0);
    var weight = 0.0;
    // The pixel's own texel shows another surface.
    for (var k = 1; k < 4; k++) {
        let o = vec2i(k & 1, k >> 1u);
        let there = unpacked_light(textureLoad(light, min(pixel + o, last), 0));
        let same_direction = max(dot(n, there.normal), 0.0);
        let fourth = same_direction * same_direction * same_direction * same_direction;
        let same_depth = 1.0 / (1e-2 + abs(there.z - z) / z);
        let w = select(0.0, 0.3 * fourth * same_depth + 1e-6, there.z > 0.0);
        sum += there.irradiance * w;
        weight += w;
    }
    return sum / max(weight, 1e-9);
}

// Share of the edge's colour beside the picture that mirrors show, and the part of the picture's
// size over which it fades. Diffuse surfaces see far more of the ground than the edge stands for.
const BESIDE = 0.7;
const BESIDE_FADE = 0.4;

// Irradiance of the ground where nothing blocks it.
fn irradiance_of_ground(world: vec3f) -> vec3f {
    let up = vec3f(0.0, 0.0, 1.0);
    return by_normal(irradiance_of_lights, up) + near_irradiance(world, up);
}

// Largest ratio that `brighter` returns: below a lamp that is close to the ground, or is thought to be, it
// would be a spot.
const BRIGHTEST = 4.0;

// By how much the ground at `there` is brighter than at `here`: near lights fall off.
fn brighter(there: vec3f, here: vec3f) -> vec3f {
    if non_uniform(frame.counts.z, here.x) == 0u {
        return vec3f(1.0);
    }
    let ratio = irradiance_of_ground(there) / max(irradiance_of_ground(here), vec3f(1e-6));
    return min(ratio, vec3f(BRIGHTEST));
}

// The same between a point beside the picture and the edge, at `uv`, whose colour it gets.
fn brighter_than_edge(there: vec3f, uv: vec2f) -> vec3f {
    let ray = ray_through(uv * frame.size.xy - vec2f(0.5));
    if ray.z > -LEAST_SLOPE {
        return vec3f(1.0);
    }
    return brighter(there, frame.eye.xyz + ray * ((frame.params.y - frame.eye.z) / ray.z));
}

// Level of the surroundings with texels of twice this many pixels: level 0 is half the picture.
fn level_of(blur: f32) -> f32 {
    return clamp(log2(max(blur, 1.0)), 0.0, frame.params.w);
}

// Radiance of a point of a real surface as the picture shows it, blurred over `metres`, beside the
// picture as its edge to the share `beside`; in w, how far that is the ground and known.
fn real_radiance(world: vec3f, metres: f32, beside: f32) -> vec4f {
    let p = pixel_of(world);
    let uv = (p.xy + vec2f(0.5)) * frame.size.zw;
    let edge = min(min(uv.x, 1.0 - uv.x), min(uv.y, 1.0 - uv.y));
    // The ground is foreshortened: by the root, the blur has the area that it has there.
    let towards = frame.eye.xyz - world;
    let facing = sqrt(clamp(towards.z * inverseSqrt(dot(towards, towards)), 0.0, 1.0));
    let pixels = metres * facing * frame.intrinsics.x / max(p.z, 1e-3);
    // Part of so wide a blur may lie beside the picture or behind the camera.
    let reach = min(0.5 * pixels * frame.size.z, 0.5);
    let ahead = smoothstep(frame.eye.w, frame.eye.w + metres, p.z);
    // Beside the picture the ground goes on like its edge, for some way.
    let outside = beside * exp(min(edge, 0.0) / BESIDE_FADE);
    let inside = max(smoothstep(-0.02 - reach, 0.05 + reach, edge), outside) * ahead;
    let blur = max(pixels * 0.5, -edge * frame.size.x * 0.25);
    let shown = clamp(uv, vec2f(0.0), vec2f(1.0));
    var seen = textureSampleLevel(surroundings, smooth_sampler, shown, level_of(blur));
    if edge < 0.0 && beside > 0.0 {
        seen = vec4f(seen.rgb * brighter_than_edge(world, shown), seen.a);
    }
    return vec4f(seen.rgb, seen.a * inside);
}

// Prefiltered radiance of the environment in the lobe about `d`.
fn far_radiance(d: vec3f, level: f32, gloss: Gloss) -> vec3f {
    if PHONG && gloss.phong {
        return textureSampleLevel(phong_radiance, smooth_sampler, d, level).rgb;
    }
    return textureSampleLevel(radiance, smooth_sampler, d, level).rgb;
}

// Parts of a long lobe beside its middle: slope of the half vector as a multiple of the table's step,
// share where n.v is 0, and mip levels above the middle's. Twins of `lobes::PARTS`.
const NEXT = vec3f(0.411, 0.229, 0.0);
const SECOND = vec3f(0.931, 0.161, 0.0);
const LAST = vec3f(2.693, 0.0805, 0.7);

// What a surface's lobe receives from the environment, and the mip level of its map.
struct FarLobe {
    radiance: vec3f,
    level: f32,
}

// GGX's lobe is n.v times as wide across the plane of incidence as along it: round lobes of that width
// lie in a row. Twin of `LongLobe::parts`.
fn radiance_in_row(n: vec3f, v: vec3f, level: f32, step: f32, gloss: Gloss) -> vec3f {
    let n_dot_v = max(dot(n, v), 0.02);
    let flat = v - n * n_dot_v;
    let along = flat * (step / max(length(flat), 1e-4));
    let a2 = gloss.width * gloss.width;
    let beside = max(1.0 - n_dot_v, 0.0);
    let middle = vec3f(0.0, 1.0 - 2.0 * beside * (NEXT.y + SECOND.y + LAST.y), 0.0);
    var sum = vec4f(0.0);
    var k = 0;
    loop {
        let inner = select(NEXT, SECOND, k >= 2);
        let sided = select(inner, LAST, k >= 4) * vec3f(select(1.0, -1.0, (k & 1) != 0), beside, 1.0);
        let part = select(sided, middle, k == 6);
        let h = normalize(n + along * part.x);
        let l = reflect(-v, h);
        let n_dot_l = max(dot(n, l), 0.0);
        let weight = part.y * masked(a2, n_dot_l, n_dot_v) * n_dot_l * max(dot(v, h), 1e-3) / dot(n, h);
        sum += vec4f(textureSampleLevel(radiance, smooth_sampler, l, level + part.z).rgb, 1.0) * weight;
        k++;
        continuing {
            break if k == 7;
        }
    }
    return sum.rgb / max(sum.a, 1e-9);
}

// Prefiltered radiance of the environment in a surface's lobe. `d` and `level` are those of the round
// lobe that is most like it.
fn far_lobe(n: vec3f, v: vec3f, d: vec3f, level: f32, gloss: Gloss) -> FarLobe {
    let at = vec2f(clamp(dot(n, v), 0.02, 1.0), long_row(gloss));
    let row = textureSampleLevel(gloss_table, smooth_sampler, at, 0.0).xyz;
    let long = select(row, vec3f(0.0), gloss.phong);
    var lobe = FarLobe(vec3f(0.0), mix(level, long.x, long.y));
    if long.y < 1.0 {
        lobe.radiance = far_radiance(d, level, gloss) * (1.0 - long.y);
    }
    if long.y > 0.0 {
        lobe.radiance += radiance_in_row(n, v, long.x, long.z, gloss) * long.y;
    }
    return lobe;
}

// Width of lobes from which on wider ones meet the ground like this one.
const WIDEST = 0.1;
// Width of the texels, as a share of the distance times the lobe's width, whose interpolation blurs
// as the lobe does. Half of all directions are within 2 alpha of the mirror direction (GGX), as of a
// Gaussian of the standard deviation 1.7 alpha; that of interpolation is half a texel.
const SPREAD = 3.4;
// Directions of a clear metal's lobe that are followed to the ground: a lobe is far longer there than
// wide where it is nearly level.
const METAL_TAPS = 3;
// F0 from which on a lobe is bright enough for them.
const METAL = 0.2;
// Least slope of a direction that is followed to the ground.
const LEAST_SLOPE = 0.01;
// Share of a lobe above the horizon up to which it counts in part.
const PARTLY = 0.1;
// Share of a lobe that is neglected.
const NEGLECTED = 0.03;

// Share of a lobe that lies below the horizon, which is `x` widths above the mirror direction: half
// vectors have GGX's slopes, of which 1/2 (1 + x / sqrt(1 + x^2)) are less than x alpha in one direction.
fn share_below(x: f32) -> f32 {
    return 0.5 + 0.5 * x * inverseSqrt(1.0 + x * x);
}

// The quantile of these slopes.
fn slope_at(share: f32) -> f32 {
    let u = 2.0 * share - 1.0;
    return u * inverseSqrt(max(1.0 - u * u, 1e-4));
}

// Share of its light that the ground has in the presence of virtual objects.
fn ground_share(world: vec3f) -> f32 {
    let at = (world.xy - frame.indirect_low.xy) / (frame.indirect_high.xy - frame.indirect_low.xy);
    if (frame.indirect_low.w == 0.0) | any(at < vec2f(0.0)) | any(at > vec2f(1.0)) {
        return 1.0;
    }
    let half = 0.5 / f32(textureDimensions(indirect_ground).y);
    let in_grid = ground_uv(at);
    let uv = vec2f(clamp(in_grid.x, half, 1.0 - half) / 3.0, in_grid.y);
    return textureSampleLevel(indirect_ground, table_sampler, uv, 0.0).a;
}

// Prefiltered radiance in the lobe about `d`: `far` from the environment, and from the ground as the
// picture shows it.
fn reflected(world: vec3f, d: vec3f, far: FarLobe, gloss: Gloss) -> vec3f {
    let width = 2.0 * clamp(gloss.width, 0.01, WIDEST);
    let share = share_below(-d.z / width);
    let below = frame.params.z * clamp((share - NEGLECTED) / (1.0 - 2.0 * NEGLECTED), 0.0, 1.0);
    if below == 0.0 {
        return far.radiance;
    }
    // Directions at the middle of equal parts of what is below.
    let is_bright = max(max(gloss.f0.x, gloss.f0.y), gloss.f0.z) > METAL;
    let taps = select(1, METAL_TAPS, is_bright & (gloss.width < WIDEST));
    var height = 0.0;
    var seen = vec4f(0.0);
    var k = 0;
    loop {
        let z = d.z + width * slope_at(share * (f32(k) + 0.5) / f32(taps));
        let low = normalize(vec3f(d.xy, min(z, -LEAST_SLOPE)));
        let t = (world.z - frame.params.y) / -low.z;
        let near = real_radiance(world + low * t, SPREAD * t * gloss.width, BESIDE);
        seen += vec4f(near.rgb * near.a, near.a) / f32(taps);
        height += z / f32(taps);
        k++;
        continuing {
            break if k == taps;
        }
    }
    // What the picture does not show there the environment does.
    let low = normalize(vec3f(d.xy, min(height, -LEAST_SLOPE)));
    var replaced = far.radiance;
    if low.z < d.z {
        replaced = far_radiance(low, far.level, gloss);
    }
    let foot = world + low * ((world.z - frame.params.y) / -low.z);
    let beneath = vec3f(world.xy, frame.params.y);
    let unseen = replaced * brighter(foot, beneath) * ground_share(foot);
    let ground = seen.rgb + unseen * (1.0 - seen.a);
    // Where all of a lobe is below, nothing is left of the difference of two look-ups.
    let above = max(far.radiance - below * replaced, vec3f(0.0)) * min((1.0 - below) / PARTLY, 1.0);
    return above + below * ground;
}

// The same as SPREAD for what stands close by: half as much, because the places of a lobe's rays are
// averaged already, and a wider blur would mix in what is behind.
const SEEN_SPREAD = 0.5 * SPREAD;

// Light that a glossy surface mirrors: `far` from far away and from the ground as far as nothing is
// in between, else of what is close by.
fn mirrored_light(far: vec3f, near: Nearby, gloss: Gloss) -> vec3f {
    let pixels = SEEN_SPREAD * gloss.width * near.place.z * frame.intrinsics.x;
    let seen = textureSampleLevel(surroundings, smooth_sampler, near.place.xy, level_of(0.5 * pixels)).rgb;
    return far * near.open + near.light + seen * near.seen;
}

// Radius over which the ground is blurred at a contact, metres: without any, the picture's weight
// would have no width over which to rise from 0 to 1.
const CONTACT = 0.002;

// Radiance of a part of the ground: its distance ahead, its width for a surface that faces down and
// for one that faces sideways, all in heights.
fn ground_part(world: vec3f, ahead: vec2f, height: f32, part: vec3f) -> vec3f {
    let foot = vec3f(world.xy + ahead * (part.x * height), frame.params.y);
    let width = height * mix(part.y, part.z, length(ahead));
    let seen = real_radiance(foot, width + CONTACT, 0.0);
    return mix(frame.ground.rgb * ground_share(foot), seen.rgb, seen.a);
}

// Correction for light that the nearby ground reflects instead of the mean ground. A surface facing
// sideways receives a share q of it from within sqrt(1 / (1 - q)^2 - 1) heights ahead, spread sideways by
// 1 / (1 - q), one facing down from a disc of radius sqrt(q / (1 - q)): here for q = 1/6, 1/2, 5/6, the
// middles of three parts. The last lies far beyond the height, past the edge of a shadow.
fn bounce(world: vec3f, n: vec3f) -> vec3f {
    let height = max(world.z - frame.params.y, 0.0);
    let share = frame.params.z * 0.5 * (1.0 - n.z);
    let near = ground_part(world, n.xy, height, vec3f(0.663, 0.447, 1.2))
        + ground_part(world, n.xy, height, vec3f(1.732, 1.0, 2.0))
        + ground_part(world, n.xy, height, vec3f(5.916, 2.236, 6.0));
    return share * (PI / 3.0 * near - sky_irradiance(vec3f(0.0, 0.0, -1.0)));
}

// Widest lobe that is looked up several times where the normal turns within a pixel, and the least turn from one pixel
// to the next, as a share of its width.
const WIDEST_TURNED = 0.3;
const TURNED = 0.7;
// Least cosine between the normals of neighbouring pixels of one surface, and largest difference of their distances, as
// a share.
const TURNED_LESS = 0.3;
const BESIDE_EACH_OTHER = 0.02;
// How much faster the normal turns towards an outline than between the pixel and the one within.
const TOWARDS_OUTLINE = 1.5;

// Difference of the normal at a neighbouring pixel to `n`, and whether that pixel shows the same surface.
fn turn_to(pixel: vec2i, n: vec3f, depth: f32) -> vec4f {
    let shape = textureLoad(virtual_shape, pixel, 0);
    let there = normal_from_octahedron(octahedron(shape));
    let apart = abs(textureLoad(virtual_depth, pixel, 0) - depth);
    let same = is_surface(shape) & (dot(there, n) > TURNED_LESS) & (apart < BESIDE_EACH_OTHER * depth);
    return select(vec4f(0.0), vec4f(there - n, 1.0), same);
}

// Change of the normal from one pixel to the next along a direction.
fn turn_along(pixel: vec2i, step: vec2i, n: vec3f, depth: f32) -> vec3f {
    let ahead = turn_to(pixel + step, n, depth);
    let behind = turn_to(pixel - step, n, depth);
    // Across a crease, the normal does not turn; towards an outline, it turns faster and faster.
    let both = ahead.w * behind.w > 0.0;
    let gentler = select(-behind.xyz, ahead.xyz, dot(ahead.xyz, ahead.xyz) < dot(behind.xyz, behind.xyz));
    return select((ahead.xyz - behind.xyz) * TOWARDS_OUTLINE, gentler, both);
}

// What a surface reflects, of what it mirrors and of compact sources.
struct Specular {
    mirrored: vec3f,
    sources: vec3f,
}

// A material's row of the gloss table where it is seen from `v`.
fn gloss_at(n: vec3f, v: vec3f, gloss: Gloss) -> vec4f {
    let at = vec2f(clamp(dot(n, v), 0.02, 1.0), gloss_row(gloss));
    return textureSampleLevel(gloss_table, smooth_sampler, at, 0.0);
}

fn specular_about(world: vec3f, n: vec3f, v: vec3f, gloss: Gloss, table: vec4f) -> Specular {
    let d = tilted(reflect(-v, n), n, table.z);
    let far = far_lobe(n, v, d, table.w, gloss);
    return Specular(reflected(world, d, far, gloss), compact_source_specular(world, n, v, gloss, far.level));
}

// The mean over a pixel in which the normal `n` turns by `x` and `y`.
fn specular_within(world: vec3f, n: vec3f, x: vec3f, y: vec3f, v: vec3f, gloss: Gloss) -> Specular {
    var sum = Specular(vec3f(0.0), vec3f(0.0));
    var weight = 1e-6;
    var k = 0;
    loop {
        let off = vec2f(f32(k & 1), f32(k >> 1u)) * 0.5 - 0.25;
        let there = normalize(n + x * off.x + y * off.y);
        let each = specular_about(world, there, v, gloss, gloss_at(there, v, gloss));
        let w = select(1e-6, 1.0, dot(there, v) > 0.0);
        sum = Specular(sum.mirrored + w * each.mirrored, sum.sources + w * each.sources);
        weight += w;
        k++;
        continuing {
            break if k == 4;
        }
    }
    return Specular(sum.mirrored / weight, sum.sources / weight);
}

// `at` is the place in the picture from which it is seen: within a surface the centre of the pixel, whose normal it has.
fn shade(pixel: vec2i, s: i32, own: bool, at: vec2f) -> vec3f {
    let shape = textureLoad(virtual_shape, pixel, s);
    let material = textureLoad(virtual_material, pixel, s);
    let base = base_colour(shape);
    let properties = properties_of(material);
    let n = normal_from_octahedron(octahedron(shape));
    let depth = textureLoad(virtual_depth, pixel, s);
    let world = world_at(sample_position(pixel, s), depth);
    let v = -normalize(ray_through(at));
    let gloss = gloss_of(shape, properties, base);

    var direct = vec3f(0.0);
    if !CACHED || LAMPED {
        direct = light_at(pixel, n, frame.eye.w / depth, own);
    }
    IF_CACHED direct += cached_irradiance(textureLoad(virtual_place, pixel, s).xy, n);
    // Where virtual surfaces stand still, their indirect light has the ground.
    if frame.on_virtual_low.w == 0.0 {
        direct += bounce(world, n);
    }
    let irradiance = max(direct, vec3f(0.0)) * occlusion_of(shape, properties);
    let table = gloss_at(n, v, gloss);
    let d = tilted(reflect(-v, n), n, table.z);
    var x = vec3f(0.0);
    var y = vec3f(0.0);
    if gloss.width < WIDEST_TURNED {
        x = turn_along(pixel, vec2i(1, 0), n, depth);
        y = turn_along(pixel, vec2i(0, 1), n, depth);
    }
    var about: Specular;
    if max(dot(x, x), dot(y, y)) > TURNED * TURNED * gloss.width * gloss.width {
        about = specular_within(world, n, x, y, v, gloss);
    } else {
        about = specular_about(world, n, v, gloss, table);
    }
    var mirrored = about.mirrored;
    var open = 1.0;
    if NEARBY {
        let near = nearby_at(at, frame.eye.w / depth);
        mirrored = mirrored_light(mirrored, near, gloss);
        open = near.open;
    }
    let scale = gloss.f0 * table.x + vec3f(gloss.f90 * table.y);
    let specular = scale * mirrored;
    let diffuse = base * diffuse_share(shape, properties) * irradiance / PI;
    let sources = open * about.sources;
    let lamps = lamp_highlights(lamps_at(virtual_lamps, pixel), world, n, v, gloss, round_lobe(gloss, scale, d));
    return diffuse + specular + sources + lamps + emissive_of(material);
}

// Difference of encoded normals up to which two samples of a pixel are shaded as one.
const SAME_NORMAL = 0.1;

// Whether two samples of a pixel show the same surface: their normals are nearly the same (unit
// octahedron), and one lies in the tangent plane of the other, to the width of a pixel there. The
// depth of a plane is linear in the picture.
fn same_surface(pixel: vec2i, a: i32, b: i32) -> bool {
    let first = octahedron(textureLoad(virtual_shape, pixel, a));
    let turned = abs(octahedron(textureLoad(virtual_shape, pixel, b)) - first);
    let n = normal_from_octahedron(first);
    let at = sample_position(pixel, a);
    let step = (sample_position(pixel, b) - at) / frame.intrinsics.xy;
    let facing = dot(n, ray_through(at));
    let slope = dot(n, frame.right.xyz * step.x + frame.down.xyz * step.y);
    let depth = textureLoad(virtual_depth, pixel, a);
    let beside = textureLoad(virtual_depth, pixel, b) * facing - depth * (facing + slope);
    return max(turned.x, turned.y) < SAME_NORMAL && abs(beside) * frame.intrinsics.x < depth;
}

fn tile_number(v: u32) -> vec2u {
    let across = textureDimensions(phantom_tiles).x;
    let t = v / 6u;
    return vec2u(t % across, t / across);
}

fn tile_has_edges(tile: vec2u) -> bool {
    let halves = vec2u(tile.x, 2u * tile.y);
    return (textureLoad(edge_tiles, halves, 0).x | textureLoad(edge_tiles, halves + vec2u(0u, 1u), 0).x) != 0u;
}

// Shadowed real surfaces, in tiles without virtual surfaces.
fn real_corner(v: u32, edges: bool) -> vec4f {
    let tile = tile_number(v);
    let shadowed = any(textureLoad(phantom_tiles, tile, 0).xy != vec2u(0u));
    let wanted = shadowed && !tile_is_covered(tile) && tile_has_edges(tile) == edges;
    return tile_corner(v % 6u, tile, NOTHING_VIRTUAL, wanted);
}

@vertex
fn real_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return real_corner(v, false);
}

@vertex
fn real_edge_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return real_corner(v, true);
}

// Kinds of pixels in tiles with virtual surfaces, as depths. A draw for a single kind uses a depth
// between that and the next: software drivers skip pixels by the depth test and not by branches.
const OUTLINE = 0.0;
const NOTHING_VIRTUAL = 0.5;
const INTERIOR = 1.0;

fn covered_tile(v: u32, depth: f32) -> vec4f {
    let tile = tile_number(v);
    return tile_corner(v % 6u, tile, depth, tile_is_covered(tile));
}

fn background_corner(v: u32, edges: bool) -> vec4f {
    let tile = tile_number(v);
    let wanted = tile_is_covered(tile) && tile_has_edges(tile) == edges;
    return tile_corner(v % 6u, tile, NOTHING_VIRTUAL, wanted);
}

@vertex
fn background_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return background_corner(v, false);
}

@vertex
fn background_edge_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return background_corner(v, true);
}

@vertex
fn outline_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return covered_tile(v, 0.5 * (OUTLINE + NOTHING_VIRTUAL));
}

@vertex
fn interior_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return covered_tile(v, 0.5 * (NOTHING_VIRTUAL + INTERIOR));
}

fn encoded(linear: vec3f) -> vec4f {
    return vec4f(code_from_linear(linear), 1.0);
}

@fragment
fn real(@builtin(position) position: vec4f) -> @location(0) vec4f {
    return background_at(vec2i(position.xy), false, false);
}

@fragment
fn real_by_edge(@builtin(position) position: vec4f) -> @location(0) vec4f {
    return background_at(vec2i(position.xy), true, false);
}

struct Background {
    @location(0) colour: vec4f,
    @builtin(frag_depth) kind: f32,
}

// The kind of a pixel as a depth.
fn kind_of(pixel: vec2i) -> f32 {
    var covered = 0;
    var same = true;
    for (var s = 0; s < SAMPLES; s++) {
        covered += select(0, 1, is_surface(textureLoad(virtual_shape, pixel, s)));
        same &= same_surface(pixel, 0, s);
    }
    let kind = select(OUTLINE, INTERIOR, same & (covered == SAMPLES));
    return select(kind, NOTHING_VIRTUAL, covered == 0);
}

// The background of virtual objects, and the kind of the pixel.
@fragment
fn background(@builtin(position) position: vec4f) -> Background {
    let pixel = vec2i(position.xy);
    return Background(background_at(pixel, false, true), kind_of(pixel));
}

@fragment
fn background_by_edge(@builtin(position) position: vec4f) -> Background {
    let pixel = vec2i(position.xy);
    return Background(background_at(pixel, true, true), kind_of(pixel));
}

// Pixels that show one virtual surface.
@fragment
fn interior(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(position.xy);
    return encoded(in_exposure(shade(pixel, 0, true, vec2f(pixel))) * brightness_at(vec2f(pixel)));
}

// Share of a pixel's samples that show something virtual.
fn coverage_of(pixel: vec2i) -> f32 {
    let at = clamp(pixel, vec2i(0), vec2i(textureDimensions(virtual_shape)) - vec2i(1));
    var covered = 0;
    for (var s = 0; s < SAMPLES; s++) {
        covered += select(0, 1, is_surface(textureLoad(virtual_shape, at, s)));
    }
    return f32(covered) / f32(SAMPLES);
}

// Least coverage of the pixel behind an outline, and one less the most of the pixel before it.
const BEHIND_OUTLINE = 0.75;

// Coverage of a pixel of which the samples cover the share `own`. Where a single outline passes, it is
// taken for a straight line through the three pixels around along it, whose place in each is the sum of
// the coverage across it: twelve samples instead of four.
fn smooth_coverage(pixel: vec2i, own: f32) -> f32 {
    let top = vec3f(coverage_of(pixel + vec2i(-1, -1)), coverage_of(pixel + vec2i(0, -1)), coverage_of(pixel + vec2i(1, -1)));
    let middle = vec3f(coverage_of(pixel + vec2i(-1, 0)), own, coverage_of(pixel + vec2i(1, 0)));
    let low = vec3f(coverage_of(pixel + vec2i(-1, 1)), coverage_of(pixel + vec2i(0, 1)), coverage_of(pixel + vec2i(1, 1)));
    let columns = top + middle + low;
    let rows = vec3f(dot(top, vec3f(1.0)), dot(middle, vec3f(1.0)), dot(low, vec3f(1.0)));
    let is_level = abs(rows.z - rows.x) > abs(columns.z - columns.x);
    let line = select(rows, columns, is_level);
    let beside = select(middle.xz, vec2f(top.y, low.y), is_level);
    if max(beside.x, beside.y) < BEHIND_OUTLINE || min(beside.x, beside.y) > 1.0 - BEHIND_OUTLINE {
        return own;
    }
    let place = dot(line, vec3f(1.0 / 3.0)) - 1.0;
    let along = vec4f(-0.375, -0.125, 0.125, 0.375) * (0.5 * (line.z - line.x));
    let covered = dot(clamp(vec4f(place) + along, vec4f(0.0), vec4f(1.0)), vec4f(0.25));
    // The samples know it to half a step.
    let half = 0.5 / f32(SAMPLES);
    return clamp(covered, own - half, own + half);
}

// Pixels that virtual objects cover partly, or that show several surfaces.
@fragment
fn outline(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(position.xy);
    let code = textureLoad(camera, pixel, 0);
    let factor = shadow_at(pixel);
    var left = 0u;
    for (var s = 0; s < SAMPLES; s++) {
        left |= select(0u, 1u << u32(s), is_surface(textureLoad(virtual_shape, pixel, s)));
    }
    let own = f32(countOneBits(left)) / f32(SAMPLES);
    var covered = own;
    if SAMPLES > 1 && own < 1.0 {
        covered = smooth_coverage(pixel, own);
    }
    var mirrored = NO_REFLECTION;
    if NEARBY {
        mirrored = in_real_mirror(pixel);
    }
    let real = with_reflections(shadowed(code.rgb, factor, pixel), mirrored, pixel);
    let behind = real + in_exposure(added_at(pixel));
    var linear = behind * (1.0 - covered);
    let each = covered / max(own * f32(SAMPLES), 1.0);
    // Samples on either side of an outline or a crease are shaded separately. The loop tests its
    // condition at the end, because software drivers would otherwise run its body once more than
    // any pixel needs.
    let pixel_sample = i32(firstTrailingBit(left | (1u << u32(SAMPLES - 1))));
    loop {
        let first = i32(firstTrailingBit(left | (1u << u32(SAMPLES - 1))));
        var same = left & (1u << u32(first));
        for (var s = 0; s < SAMPLES; s++) {
            let is_left = (left >> u32(s) & 1u) != 0u;
            same |= select(0u, 1u << u32(s), is_left & same_surface(pixel, first, s));
        }
        let shown = in_exposure(shade(pixel, first, first == pixel_sample, sample_position(pixel, first))) * brightness_at(vec2f(pixel));
        linear += shown * (f32(countOneBits(same)) * each);
        left &= ~same;
        continuing {
            break if left == 0u;
        }
    }
    return encoded(linear);
}
