// Depth map of the casters from one dome light, orthographic in its space. The instance index is the light. The
// placement is a uniform of its own: software drivers read an array at a varying index element by element.

@group(1) @binding(0) var<uniform> world_from_caster: mat4x4f;

struct Out {
    @builtin(position) position: vec4f,
}

fn projected(i: u32, fit: vec4f, depth: vec2f, world: vec3f) -> Out {
    let at = in_light_space(i, world);
    let uv = at.xy * fit.xy + fit.zw * at.w;
    // Texture v runs down, clip y runs up.
    return Out(vec4f(uv.x * 2.0 - at.w, at.w - 2.0 * uv.y, at.z * depth.x + depth.y * at.w, at.w));
}

// Static casters are in world coordinates; their placement is exactly the identity.
@vertex
fn virtual_caster(@location(0) own: vec3f, @builtin(instance_index) i: u32) -> Out {
    let world = (world_from_caster * vec4f(own, 1.0)).xyz;
    return projected(i, lights[i].virtual_fit, lights[i].depths.xy, world);
}

@vertex
fn phantom_caster(@location(0) world: vec3f, @builtin(instance_index) i: u32) -> Out {
    return projected(i, lights[i].phantom_fit, lights[i].depths.zw, world);
}
