//! Converts the configuration to settings of the compositor, the dashboard and the pairing.

use crate::frame::PreparedFrame;
use penumbra_compositor::exposure::AutoLimits;
use penumbra_compositor::{CompositorSettings, Exposure, Look};
use penumbra_config::{Antialias, Config, ExposureMode, LookConfig, Quality, Technique};
use penumbra_rig_model::RigCalibration;
use penumbra_status::Settings;
use penumbra_sync::PairingConfig;

/// Returns the configured values of the settings that the dashboard may change.
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

/// Returns the exposure of a picture taken at `seconds` after the session began.
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

/// Returns the camera's look on the virtual objects of a frame, as far as it is switched on and
/// known.
pub(super) fn look(config: &LookConfig, rig: &RigCalibration, prepared: &PreparedFrame) -> Look {
    let camera = &rig.scene_camera;
    Look {
        // Equal in the live rig and in every replay.
        picture: prepared.frame.scene.captured_at.as_nanos().unsigned_abs(),
        noise: camera.noise.filter(|_| config.grain),
        spread: camera.spread.filter(|_| config.softness),
        depth_of_field: config.depth_of_field,
        motion: prepared.exposure_motion,
    }
}

/// Returns the compositor's settings. `software`: the adapter renders on the CPU; `reproducible`:
/// the same input must give the same bytes.
pub(super) fn compositor_settings(
    config: &Config,
    software: bool,
    reproducible: bool,
) -> CompositorSettings {
    let automatic = match config.picture.quality {
        Quality::Live => CompositorSettings::for_adapter(software),
        Quality::Best => CompositorSettings::best(software),
    };
    // On surfaces, planes leave compact sources to shadow maps, which know where near lamps are.
    let by_planes = config.shadows.technique == Technique::ShadowingPlanes;
    CompositorSettings {
        cached: automatic.cached || by_planes,
        light_budget: config.environment.light_count,
        shadow_map_size: config.shadows.map_size,
        samples: match config.picture.antialias {
            Antialias::Msaa4 => 4,
            Antialias::Off => 1,
        },
        soft_samples: if config.shadows.soft {
            automatic.soft_samples
        } else {
            1
        },
        in_background: !reproducible,
        ..automatic
    }
}

/// Returns the pairing settings with the latencies and brackets of `rig`, defaults otherwise.
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
    use super::*;

    #[test]
    fn dashboard_defaults_equal_configuration_defaults() {
        assert_eq!(live_settings(&Config::default()), Settings::default());
    }
}
