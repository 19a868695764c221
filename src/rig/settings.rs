//! The configuration in the compositor's and the dashboard's words.

use penumbra_compositor::exposure::AutoLimits;
use penumbra_compositor::{CompositorSettings, Exposure};
use penumbra_config::{Antialias, Config, ExposureMode, ReplaySpeed, ShadowResolution};
use penumbra_rig_model::RigCalibration;
use penumbra_status::Settings;
use penumbra_sync::PairingConfig;

/// The settings that the dashboard may change, as the configuration has them.
#[must_use]
pub fn live_settings(config: &Config) -> Settings {
    Settings {
        technique: config.shadows.technique,
        light_count: config.environment.light_count,
        light_placement: config.environment.light_placement,
        shadow_mode: config.shadows.mode,
        shadow_strength: config.shadows.strength,
        virtual_object_visible: true,
        reflections: config.shading.reflections,
        indirect_light: config.shading.indirect_light,
        lamp_response: config.shading.lamp_response,
        planes_skip_below: config.planes.skip_below,
        planes_recompute_above: config.planes.recompute_above,
        planes_shading: config.planes.shading,
        exposure_mode: config.exposure.mode,
        exposure_ev: config.exposure.ev,
        exposure_highlights: config.exposure.highlights,
        exposure_min_ev: config.exposure.min_ev,
        exposure_max_ev: config.exposure.max_ev,
        exposure_key: config.exposure.key,
        exposure_adaptation_s: config.exposure.adaptation_seconds,
    }
}

/// The exposure of a picture that was taken at `seconds`.
pub(super) const fn exposure(settings: &Settings, seconds: f64) -> Exposure {
    match settings.exposure_mode {
        ExposureMode::Off => Exposure::Camera,
        ExposureMode::Manual => Exposure::Stops(settings.exposure_ev),
        ExposureMode::Auto => Exposure::Automatic {
            limits: AutoLimits {
                darkest: settings.exposure_min_ev,
                brightest: settings.exposure_max_ev,
                key: settings.exposure_key,
                adaptation_seconds: settings.exposure_adaptation_s,
            },
            seconds,
        },
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

/// How the streams of `rig` are paired: its latencies and brackets, and defaults for the rest.
#[must_use]
pub fn pairing_config(rig: &RigCalibration) -> PairingConfig {
    let environment = rig.environment.as_ref();
    let tracker = rig.tracker.as_ref();
    PairingConfig {
        scene_latency_nanos: rig.scene_camera.latency_nanos,
        environment_latency_nanos: environment.map_or(0, |e| e.latency_nanos),
        tracker_latency_nanos: tracker.map_or(0, |t| t.latency_nanos),
        brackets: environment.map_or(0, |e| e.brackets_ev.len()),
        station: tracker.map(|_| 1),
        ..PairingConfig::default()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    #[test]
    fn the_dashboards_defaults_are_the_configurations() {
        assert_eq!(live_settings(&Config::default()), Settings::default());
    }
}
