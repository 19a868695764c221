// Depth of the casters seen from one lamp, in perspective. The view is the instance.

struct Views {
    clip_from_world: array<mat4x4f, MAX_LAMP_VIEWS>,
}

@group(0) @binding(0) var<uniform> views: Views;

@vertex
fn lamp_caster(@location(0) world: vec3f, @builtin(instance_index) i: u32) -> @builtin(position) vec4f {
    return views.clip_from_world[i] * vec4f(world, 1.0);
}
