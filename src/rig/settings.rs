//! The configuration in the compositor's and the dashboard's words.

use crate::compositor::CompositorSettings;
use crate::config::{Antialias, Config, LightPlacement, ReplaySpeed, ShadowResolution};
use crate::status::{self, LightsMode, Settings, Technique};

/// The settings that the dashboard may change, as the configuration has them.
#[must_use]
pub fn live_settings(config: &Config) -> Settings {
    Settings {
        technique: if config.shadows.enabled {
            Technique::ImageBasedShadowing
        } else {
            Technique::ImageBasedLighting
        },
        light_count: config.environment.light_count,
        lights_mode: match config.environment.lights {
            LightPlacement::Adaptive => LightsMode::Adaptive,
            LightPlacement::Grid => LightsMode::Grid,
        },
        shadow_mode: match config.shadows.mode {
            crate::config::ShadowMode::Ratio => status::ShadowMode::Ratio,
            crate::config::ShadowMode::Subtract => status::ShadowMode::Subtract,
        },
        shadow_strength: config.shadows.strength,
        virtual_object_visible: true,
    }
}

/// Look-ups per light and point for soft shadows where there is time for them: with twice as
/// many the shadows' error falls by another 2 % only.
const SOFT_SAMPLES: u32 = 4;

/// `is_live`: somebody waits for each picture.
pub(super) fn compositor_settings(
    config: &Config,
    is_live: bool,
    software: bool,
) -> CompositorSettings {
    let automatic = CompositorSettings::for_adapter(software);
    // Nobody waits for a frame of a replay at full speed.
    let unhurried = !is_live && config.replay.speed == ReplaySpeed::Max;
    CompositorSettings {
        light_budget: config.environment.light_count,
        shadow_map_size: config.shadows.map_size,
        shadow_step: match config.shadows.resolution {
            ShadowResolution::Auto if unhurried => 1,
            ShadowResolution::Auto => automatic.shadow_step,
            ShadowResolution::Full => 1,
            ShadowResolution::Half => 2,
            ShadowResolution::Quarter => 4,
        },
        samples: match config.picture.antialias {
            Antialias::Msaa4 => 4,
            Antialias::Off => 1,
        },
        soft_samples: if config.shadows.soft {
            automatic
                .soft_samples
                .max(if unhurried { SOFT_SAMPLES } else { 1 })
        } else {
            1
        },
    }
}
