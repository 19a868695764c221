// Perspective depth map of the casters from one lamp. The instance index holds the view in its
// lowest twelve bits, and above them the caster's number.

struct Views {
    clip_from_world: array<mat4x4f, MAX_LAMP_VIEWS>,
}

@group(0) @binding(0) var<uniform> views: Views;

@group(1) @binding(0) var<storage, read> caster_places: array<mat4x4f>;

@vertex
fn lamp_caster(@location(0) own: vec3f, @builtin(instance_index) instance: u32) -> @builtin(position) vec4f {
    let world = caster_places[instance >> 12u] * vec4f(own, 1.0);
    return views.clip_from_world[instance & 0xfffu] * world;
}
