// The finished picture from the pose at which it is displayed, as if it were painted on a wall.

@group(0) @binding(0) var picture: texture_2d<f32>;
// Direction that each pixel shows, on the plane z = 1; below -1e5: none.
@group(0) @binding(1) var directions: texture_2d<f32>;
struct Reprojection {
    // Columns of the homography from directions of the eye to directions of the camera.
    x: vec4f,
    y: vec4f,
    z: vec4f,
    // Focal lengths and principal point, pixels.
    intrinsics: vec4f,
    // k1, k2, k3, p1.
    distortion: vec4f,
    // p2, and the squared tangent up to which the distortion model is valid.
    more: vec4f,
}
@group(0) @binding(2) var<uniform> reprojection: Reprojection;

// Brown's model (1966), with OpenCV's parameters.
fn distorted(undistorted: vec2f) -> vec2f {
    let k = reprojection.distortion;
    let p = vec2f(k.w, reprojection.more.x);
    let r2 = dot(undistorted, undistorted);
    let radial = 1.0 + r2 * (k.x + r2 * (k.y + r2 * k.z));
    let xy = undistorted.x * undistorted.y;
    let tangential = 2.0 * p * xy + p.yx * (vec2f(r2) + 2.0 * undistorted * undistorted);
    return undistorted * radial + tangential;
}

@fragment
fn reprojected(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(position.xy);
    let own = textureLoad(picture, pixel, 0);
    let shown = textureLoad(directions, pixel, 0).xy;
    let there = reprojection.x.xyz * shown.x + reprojection.y.xyz * shown.y + reprojection.z.xyz;
    if shown.x < -1e5 || there.z < 1e-3 {
        return own;
    }
    let direction = there.xy / there.z;
    let limit = sqrt(reprojection.more.y / max(dot(direction, direction), 1e-12));
    let at = distorted(direction * min(limit, 1.0)) * reprojection.intrinsics.xy + reprojection.intrinsics.zw;
    // Positions outside the picture are clamped to its border: a bar of another colour would
    // flicker.
    let last = vec2f(textureDimensions(picture)) - vec2f(1.0);
    return vec4f(smooth_at(picture, clamp(at, vec2f(0.0), last)), 1.0);
}
