// Perspective depth map of the casters from one lamp. The instance index is the view.

struct Views {
    clip_from_world: array<mat4x4f, MAX_LAMP_VIEWS>,
}

@group(0) @binding(0) var<uniform> views: Views;

@group(1) @binding(0) var<uniform> world_from_caster: mat4x4f;

@vertex
fn lamp_caster(@location(0) own: vec3f, @builtin(instance_index) i: u32) -> @builtin(position) vec4f {
    return views.clip_from_world[i] * (world_from_caster * vec4f(own, 1.0));
}
