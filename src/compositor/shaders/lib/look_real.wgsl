// Linear light of a texel of the real picture, in the exposure of the frame.
fn real_light(texel: vec3f) -> vec3f {
    if EXPOSED && !DISTORTED {
        return texel;
    }
    if EXPOSED {
        return linear_from_code(texel) * look.read.w;
    }
    return linear_from_code(texel);
}

// Whether a composed pixel shows the real picture without a change. In another exposure a lens
// with distortion leaves no picture to compare with.
fn is_unchanged(code: vec3f, texel: vec3f) -> bool {
    if EXPOSED && DISTORTED {
        return true;
    }
    if EXPOSED {
        return all(abs(code_from_linear(texel) - code) < vec3f(0.6 / 255.0));
    }
    return all(code == texel);
}
