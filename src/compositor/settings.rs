//! The settings of a compositor.

/// Settings that are chosen before the first frame.
#[derive(Clone, Debug, PartialEq)]
pub struct CompositorSettings {
    /// Maximum number of dome lights, with one shadow map each.
    pub light_budget: u32,
    /// Texels a side of a shadow map.
    pub shadow_map_size: u32,
    /// Samples a pixel at the edges of virtual objects: 1 or 4.
    pub samples: u32,
    /// Look-ups of a shadow map per light and point, distributed over the extent of the light;
    /// 1 = hard shadows, the cheapest. Where light is kept on surfaces, only virtual lights have maps.
    pub soft_samples: u32,
    /// Whether the light of the dome is kept on surfaces, which costs as much for many lights as for one.
    pub cached: bool,
    /// Maximum number of pages of 16×16 texels on which light is kept.
    pub cache_pages: usize,
    /// Whether kept light is renewed and a new exposure compiled in the background: pictures never
    /// wait for it, but they are not reproducible.
    pub in_background: bool,
    /// Whether a picture by shadowing planes waits for the images of compact sources that have moved.
    pub waits_for_sources: bool,
    /// Pixels from one mirror ray to the next, 1, 2 or 4: what glossy surfaces reflect of their
    /// neighbourhood is interpolated between them.
    pub reflection_step: u32,
}

/// Number of lights above which shadow maps are smaller: more lights share the work of drawing the
/// shapes of shadows, and 384 maps of full size would take 800 MB.
const MANY_LIGHTS: u32 = 96;

impl CompositorSettings {
    /// The settings of the live picture on a real GPU or, with `software`, on a software driver.
    #[must_use]
    pub const fn for_adapter(software: bool) -> Self {
        Self {
            light_budget: 64,
            shadow_map_size: 512,
            samples: 4,
            soft_samples: if software { 1 } else { 8 },
            cached: true,
            cache_pages: 1500,
            in_background: false,
            waits_for_sources: false,
            reflection_step: 2,
        }
    }

    /// The settings of the best picture, which takes the time that it needs, on a real GPU or, with
    /// `software`, on a software driver.
    #[must_use]
    pub const fn best(software: bool) -> Self {
        Self {
            soft_samples: if software { 4 } else { 8 },
            cached: false,
            waits_for_sources: true,
            reflection_step: 1,
            ..Self::for_adapter(false)
        }
    }

    /// Texels a side of the shadow maps for the current light budget.
    pub(crate) const fn map_size(&self) -> u32 {
        if self.light_budget > MANY_LIGHTS {
            self.shadow_map_size / 2
        } else {
            self.shadow_map_size
        }
    }
}
