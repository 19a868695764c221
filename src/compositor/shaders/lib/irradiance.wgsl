// Irradiance on a surface besides the shadowed light of the dome: from the ground, indirect light,
// and the unshadowed light of the dome.

const PI = 3.14159265;

// Irradiance from the lower hemisphere, which dome lights do not cover where there is a ground.
fn ground_irradiance(n: vec3f) -> vec3f {
    return frame.params.z * frame.ground.rgb * (PI * 0.5 * (1.0 - n.z));
}

// Irradiance on surfaces: kinds of its grids.
const ON_VIRTUAL = 0.0;
const CHANGE = 1.0;
const WITHOUT_VIRTUAL = 2.0;
const SURFACE_KINDS = 3.0;

fn on_surfaces_facing(kind: f32, face: f32, at: vec3f) -> vec4f {
    let share = vec3f(1.0 / 6.0, 1.0, 1.0 / SURFACE_KINDS);
    let size = vec3f(textureDimensions(on_surfaces)) * share;
    // Half a cell from the walls, so that neighbouring grids do not mix.
    let inside = clamp(at, 0.5 / size, 1.0 - 0.5 / size);
    let uvw = (inside + vec3f(face, 0.0, kind)) * share;
    return textureSampleLevel(on_surfaces, table_sampler, uvw, 0.0);
}

// Irradiance at a place in a grid, and in w the share to which it is known. Twin of
// `SurfaceIrradiance::on`.
fn on_surface(kind: f32, low: vec4f, high: vec4f, world: vec3f, n: vec3f) -> vec4f {
    let at = (world - low.xyz) / (high.xyz - low.xyz);
    if (low.w == 0.0) | any(at < vec3f(0.0)) | any(at > vec3f(1.0)) {
        return vec4f(0.0);
    }
    let face = select(vec3f(0.0, 2.0, 4.0), vec3f(1.0, 3.0, 5.0), n < vec3f(0.0));
    let w = n * n;
    let sum = w.x * on_surfaces_facing(kind, face.x, at) + w.y * on_surfaces_facing(kind, face.y, at)
        + w.z * on_surfaces_facing(kind, face.z, at);
    // On a surface that continues to all sides, the weight is about five times 0.1.
    return vec4f(sum.rgb / max(sum.a, 1e-6), min(sum.a / 0.1, 1.0));
}

// Place in the region of indirect light, from 0 to 1; w = 0 outside.
fn in_region(world: vec3f) -> vec4f {
    let at = (world - frame.indirect_low.xyz) / (frame.indirect_high.xyz - frame.indirect_low.xyz);
    let margin = vec3f(0.0, 0.0, 0.02);
    let outside = (frame.indirect_low.w == 0.0) | any(at < -margin) | any(at > vec3f(1.0));
    return vec4f(at, select(1.0, 0.0, outside));
}

fn is_on_ground(at: vec4f, n: vec3f) -> bool {
    return n.z > 0.99 && at.z < 0.02;
}

// Irradiance on the ground. `kind` 0: the change that virtual objects cause (negative where they block
// light); 1: light that phantoms reflect without virtual objects; 2: with them.
fn on_ground(kind: f32, at: vec4f) -> vec3f {
    let half = 0.5 / f32(textureDimensions(indirect_ground).y);
    let in_grid = ground_uv(at.xy);
    let uv = vec2f((clamp(in_grid.x, half, 1.0 - half) + kind) / 3.0, in_grid.y);
    return textureSampleLevel(indirect_ground, table_sampler, uv, 0.0).rgb;
}

// Indirect irradiance on a real surface: the change that virtual objects cause, or what arrives without
// them. Twin of `on_real` in the surface cache.
fn indirect_on_real(kind: f32, world: vec3f, n: vec3f) -> vec3f {
    let at = in_region(world);
    if at.w == 0.0 {
        return vec3f(0.0);
    }
    if is_on_ground(at, n) {
        return on_ground(kind - CHANGE, at);
    }
    let found = on_surface(kind, frame.on_real_low, frame.on_real_high, world, n);
    return found.rgb * found.w;
}

fn from_phantoms_facing(face: f32, at: vec3f) -> vec3f {
    let size = vec3f(textureDimensions(indirect_volume)) * vec3f(1.0 / 6.0, 1.0, 1.0);
    // Half a probe from the walls, so that neighbouring volumes do not mix.
    let inside = clamp(at, 0.5 / size, 1.0 - 0.5 / size);
    let uvw = vec3f((inside.x + face) / 6.0, inside.yz);
    return textureSampleLevel(indirect_volume, table_sampler, uvw, 0.0).rgb;
}

// Irradiance on a virtual surface by light that phantoms reflect.
fn from_phantoms(world: vec3f, n: vec3f) -> vec3f {
    let at = in_region(world);
    if at.w == 0.0 {
        return vec3f(0.0);
    }
    if is_on_ground(at, n) {
        return on_ground(2.0, at);
    }
    let face = select(vec3f(0.0, 2.0, 4.0), vec3f(1.0, 3.0, 5.0), n < vec3f(0.0));
    let w = n * n;
    // Sample half a probe off the surface: probes behind it are inside objects or on their far
    // side.
    let in_grid = vec3f(ground_uv(at.xy), at.z);
    let off = in_grid + 0.5 * n / (vec3f(textureDimensions(indirect_volume)) * vec3f(1.0 / 6.0, 1.0, 1.0));
    return w.x * from_phantoms_facing(face.x, off) + w.y * from_phantoms_facing(face.y, off)
        + w.z * from_phantoms_facing(face.z, off);
}

// Indirect irradiance on a virtual surface, and in w the share to which that includes light of other
// virtual surfaces. Twin of `on_virtual` in the surface cache.
fn indirect_light_on_virtual(world: vec3f, n: vec3f) -> vec4f {
    let found = on_surface(ON_VIRTUAL, frame.on_virtual_low, frame.on_virtual_high, world, n);
    return vec4f(mix(from_phantoms(world, n), found.rgb, found.w), found.w);
}

// Irradiance where no phantom shadows the point.
fn open_in_real(world: vec3f, n: vec3f) -> vec3f {
    return ground_irradiance(n) + by_normal(irradiance_of_lights, n) + indirect_on_real(WITHOUT_VIRTUAL, world, n);
}

// Factor on the camera's picture: (E - R + V) / E, where `lost` of the irradiance `arriving` is
// missing and lamps add `added`; 1 in a channel without light. In the subtracting technique (eq. 4
// of the paper), the radiance to subtract instead.
fn change_of_picture(lost: vec3f, arriving: vec3f, added: vec3f, n: vec3f) -> vec3f {
    // The lower bound avoids glow where the estimated light says that a pixel is in full shadow and
    // the picture shows that it is not.
    var lowest = vec3f(1e-6);
    if LAMPED {
        lowest = max(0.05 * by_normal(irradiance_of_lights, n), vec3f(1e-4));
    }
    let factor = vec3f(1.0) - lost / max(arriving, vec3f(1e-6)) + added / max(arriving, lowest);
    let change = select(factor, (lost - added) / PI, frame.counts.y == 1u);
    // Half floats hold it; infinite ones would become NaN where they are averaged with weight 0.
    return clamp(change, vec3f(-6e4), vec3f(6e4));
}
