// Linear light of a texel of the picture: of the camera's code, or as it is where the exposure
// was changed and the picture is linear already.
fn linear_of(texel: vec3f) -> vec3f {
    if EXPOSED {
        return texel;
    }
    return linear_from_code(texel);
}

// Light in the scene camera's units as the changed exposure shows it.
fn in_exposure(linear: vec3f) -> vec3f {
    if EXPOSED {
        return linear * frame.ground.w;
    }
    return linear;
}
