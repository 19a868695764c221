//! The limits that an adapter must have.

/// Returns the limits with which all passes, pictures of up to 4096 pixels a side and 256 dome
/// lights work: those that WebGPU guarantees and less where less is enough, but more textures (the
/// composite pass reads 25) and storage buffers (shadowing planes use 9). Nothing else is required:
/// no push constants, no optional feature. The compositor's tests run on a device with no more than
/// these limits.
#[must_use]
pub fn required_limits() -> wgpu::Limits {
    wgpu::Limits {
        max_texture_dimension_1d: 1024,
        max_texture_dimension_2d: 4096,
        max_texture_dimension_3d: 256,
        max_sampled_textures_per_shader_stage: 32,
        max_storage_buffers_per_shader_stage: 12,
        max_color_attachments: 4,
        ..wgpu::Limits::default()
    }
}

/// Returns what `adapter` lacks of [`required_limits`], e.g. "texture array layers 128 of 256".
#[must_use]
pub fn shortfalls(adapter: &wgpu::Limits) -> Vec<String> {
    let mut lacking = Vec::new();
    required_limits().check_limits_with_fail_fn(adapter, false, |name, needed, has| {
        let words = name.trim_start_matches("max_").replace('_', " ");
        lacking.push(format!("{words} {has} of {needed}"));
    });
    lacking
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_required_limit_is_named_if_it_is_missing() {
        assert_eq!(shortfalls(&required_limits()), [""; 0]);
        let few = wgpu::Limits {
            max_texture_array_layers: 128,
            max_storage_buffers_per_shader_stage: 2,
            ..required_limits()
        };
        let named = shortfalls(&few).join(", ");
        assert_eq!(
            named,
            "texture array layers 128 of 256, storage buffers per shader stage 2 of 12"
        );
        assert!(!shortfalls(&wgpu::Limits::downlevel_defaults()).is_empty());
    }

    #[test]
    fn push_constants_are_not_required() {
        assert_eq!(required_limits().max_immediate_size, 0);
    }
}
