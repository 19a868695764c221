// Octahedral unit vectors (Cigolle et al. 2014).

fn octahedron_from_normal(n: vec3f) -> vec2f {
    let p = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
    let s = select(vec2f(-1.0), vec2f(1.0), p >= vec2f(0.0));
    return select((vec2f(1.0) - abs(p.yx)) * s, p, n.z >= 0.0);
}

fn normal_from_octahedron(p: vec2f) -> vec3f {
    var n = vec3f(p, 1.0 - abs(p.x) - abs(p.y));
    let t = max(-n.z, 0.0);
    n.x += select(t, -t, n.x >= 0.0);
    n.y += select(t, -t, n.y >= 0.0);
    return normalize(n);
}
