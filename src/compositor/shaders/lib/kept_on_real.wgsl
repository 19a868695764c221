// Light that is kept on real surfaces, in the surface cache.

struct KeptOnReal {
    // Irradiance that virtual objects block, times the strength of shadows.
    lost: vec3f,
    // Irradiance in the real scene, and the fraction of the unshadowed irradiance that it is.
    arriving: vec3f,
    share: f32,
}

// Nothing is lost without a page; `open`: what arrives there.
fn kept_or(place: vec2u, open: vec3f) -> KeptOnReal {
    let uv = cache_uv(place);
    let lost = textureSampleLevel(cache_first, table_sampler, uv, 0.0).rgb * frame.params.x;
    let kept = textureSampleLevel(cache_second, table_sampler, uv, 0.0);
    let there = place.x != 0u;
    let arriving = select(vec4f(open, 1.0), kept, there);
    return KeptOnReal(select(vec3f(0.0), lost, there), arriving.rgb, arriving.a);
}

// A texel of the shadow buffer: the change of the picture where the surface receives shadows, and
// the surface's key.
fn shadow_texel(change: vec3f, share: f32, key: f32, receives: bool) -> vec4f {
    let unshadowed = vec4f(vec3f(select(1.0, 0.0, frame.counts.y == 1u)), 0.0);
    return select(unshadowed, vec4f(change, key_with_share(key, share)), receives);
}
