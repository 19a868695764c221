// Linear light of a texel of the picture: decoded from the camera's code, or unchanged where the
// exposure was changed and the picture is linear already.
fn linear_of(texel: vec3f) -> vec3f {
    if EXPOSED {
        return texel;
    }
    return linear_from_code(texel);
}

// Converts light in the scene camera's units to the changed exposure.
fn in_exposure(linear: vec3f) -> vec3f {
    if EXPOSED {
        return linear * frame.ground.w;
    }
    return linear;
}
