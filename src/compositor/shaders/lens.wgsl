// Conversion between the camera's distorted picture and the undistorted one into which virtual
// objects are drawn.

// The camera's picture.
@group(0) @binding(0) var camera: texture_2d<f32>;
// Position of each pixel in the other picture, pixels.
@group(0) @binding(1) var positions: texture_2d<f32>;
// The undistorted picture: from the camera, and composited.
@group(1) @binding(0) var before: texture_2d<f32>;
@group(1) @binding(2) var after: texture_2d<f32>;
@group(1) @binding(3) var virtual_shape: VIRTUAL_TEXTURE;

// The camera's picture without its lens' distortion.
@fragment
fn undistorted(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let at = textureLoad(positions, vec2i(position.xy), 0).xy;
    return vec4f(smooth_at(camera, at), 1.0);
}

// Fraction of an undistorted pixel that virtual surfaces cover.
fn coverage(pixel: vec2i) -> f32 {
    var covered = 0;
    for (var s = 0; s < SAMPLES; s++) {
        covered += select(0, 1, is_surface(textureLoad(virtual_shape, pixel, s)));
    }
    return f32(covered) / f32(SAMPLES);
}

// Linear, interpolated between the four nearest pixels.
struct Undistorted {
    before: vec3f,
    after: vec3f,
    covered: f32,
    same: bool,
}

fn undistorted_at(at: vec2f) -> Undistorted {
    let corner = floor(at);
    let part = at - corner;
    let last = vec2i(textureDimensions(after)) - vec2i(1);
    var found = Undistorted(vec3f(0.0), vec3f(0.0), 0.0, true);
    for (var k = 0; k < 4; k++) {
        let o = vec2i(k & 1, k >> 1u);
        let pixel = clamp(vec2i(corner) + o, vec2i(0), last);
        let weights = mix(vec2f(1.0) - part, part, vec2f(o));
        let w = weights.x * weights.y;
        let b = textureLoad(before, pixel, 0).rgb;
        let a = textureLoad(after, pixel, 0).rgb;
        found.before += w * linear_from_code(b);
        found.after += w * linear_from_code(a);
        found.covered += w * coverage(pixel);
        found.same &= all(a == b);
    }
    return found;
}

fn is_outside(at: vec2f) -> bool {
    return any(at < vec2f(-0.5)) | any(at > vec2f(textureDimensions(after)) - vec2f(0.5));
}

struct Distorted {
    colour: vec4f,
    // Share of the pixel that virtual surfaces leave open.
    open: f32,
}

// The composite with the camera's distortion. Unchanged pixels are the camera's, bit for bit;
// pixels that shadows darken keep the camera's own detail, sharper than the undistorted picture's.
fn distorted_at(position: vec4f) -> Distorted {
    let pixel = vec2i(position.xy);
    let own = textureLoad(camera, pixel, 0);
    let at = textureLoad(positions, pixel, 0).xy;
    if is_outside(at) {
        return Distorted(own, 1.0);
    }
    let undistorted = undistorted_at(at);
    if undistorted.same {
        return Distorted(own, 1.0);
    }
    let ratio = clamp(undistorted.after / max(undistorted.before, vec3f(1e-4)), vec3f(0.0), vec3f(1.5));
    let detail = (linear_from_code(own.rgb) - undistorted.before) * mix(ratio, vec3f(1.0), undistorted.covered);
    let open = 1.0 - undistorted.covered;
    return Distorted(vec4f(code_from_linear(undistorted.after + open * detail), 1.0), open);
}

// The same in another exposure, where no pixel is the camera's.
fn distorted_exposed_at(position: vec4f) -> Distorted {
    let at = textureLoad(positions, vec2i(position.xy), 0).xy;
    let undistorted = undistorted_at(at);
    return Distorted(vec4f(code_from_linear(undistorted.after), 1.0), 1.0 - undistorted.covered);
}

@fragment
fn distorted(@builtin(position) position: vec4f) -> @location(0) vec4f {
    return distorted_at(position).colour;
}

@fragment
fn distorted_exposed(@builtin(position) position: vec4f) -> @location(0) vec4f {
    return distorted_exposed_at(position).colour;
}

// For the camera's look, which reads the open share from alpha.
@fragment
fn distorted_covered(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let shown = distorted_at(position);
    return vec4f(shown.colour.rgb, shown.open);
}

@fragment
fn distorted_exposed_covered(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let shown = distorted_exposed_at(position);
    return vec4f(shown.colour.rgb, shown.open);
}
