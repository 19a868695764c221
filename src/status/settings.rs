//! Settings that can be changed while the rig runs.

use penumbra_config::{
    ADAPTATION_SECONDS, EXPOSURE_KEYS, EXPOSURE_STOPS, ExposureConfig, ExposureMode, Filtering,
    Highlights, LampResponse, LightPlacement, MAX_EV_STOPS, MIN_EV_STOPS, PlaneShading, ShadowMode,
    Technique,
};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The light counts a dome can have (Supan 2006, section V C).
pub const LIGHT_COUNTS: [u32; 6] = [8, 24, 48, 64, 96, 384];

/// Settings that had another name up to version 0.1: old and new.
const RENAMED: [(&str, &str); 4] = [
    ("lights_mode", "light_placement"),
    ("bounced_light", "indirect_light"),
    ("exposure_darkest_ev", "exposure_min_ev"),
    ("exposure_brightest_ev", "exposure_max_ev"),
];

/// All live settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// How virtual objects are lit and shadowed.
    pub technique: Technique,
    /// Budget of dome lights, one of [`LIGHT_COUNTS`].
    pub light_count: u32,
    /// How dome lights are placed.
    pub light_placement: LightPlacement,
    /// How shadows are combined with the camera's picture.
    pub shadow_mode: ShadowMode,
    /// 0 = no shadow, 1 = the measured one.
    pub shadow_strength: f32,
    /// Whether the virtual objects are composited at all.
    pub virtual_object_visible: bool,
    /// How the environment is filtered for reflections on virtual objects.
    pub reflections: Filtering,
    /// Whether virtual objects and real surfaces reflect light onto each other.
    pub indirect_light: bool,
    /// How real surfaces respond to virtual lamps.
    pub lamp_response: LampResponse,
    /// Planes: lights that contribute less than this share of all light are skipped, 0..=1.
    pub planes_skip_below: f32,
    /// Planes: a light is summed again when it changes by more than this share of all light,
    /// 0..=1.
    pub planes_recompute_above: f32,
    /// Planes: shading of virtual objects.
    pub planes_shading: PlaneShading,
    /// How the exposure of the output is chosen.
    pub exposure_mode: ExposureMode,
    /// Manual: stops relative to the camera's exposure, −8..=3.
    pub exposure_ev: f32,
    /// How clipped areas appear in a shorter exposure.
    pub exposure_highlights: Highlights,
    /// Automatic: minimum, stops, −8..=0.
    pub exposure_min_ev: f32,
    /// Automatic: maximum, stops, 0..=3.
    pub exposure_max_ev: f32,
    /// Automatic: mean linear brightness below which a picture counts as dark, 0..=1.
    pub exposure_key: f32,
    /// Automatic: time constant, seconds, 0..=60.
    pub exposure_adaptation_s: f32,
}

impl Default for Settings {
    fn default() -> Self {
        let exposure = ExposureConfig::default();
        Self {
            technique: Technique::default(),
            light_count: 64,
            light_placement: LightPlacement::default(),
            shadow_mode: ShadowMode::default(),
            shadow_strength: 1.0,
            virtual_object_visible: true,
            reflections: Filtering::default(),
            indirect_light: true,
            lamp_response: LampResponse::default(),
            planes_skip_below: 0.002,
            planes_recompute_above: 0.01,
            planes_shading: PlaneShading::default(),
            exposure_mode: exposure.mode,
            exposure_ev: exposure.ev,
            exposure_highlights: exposure.highlights,
            exposure_min_ev: exposure.min_ev,
            exposure_max_ev: exposure.max_ev,
            exposure_key: exposure.key,
            exposure_adaptation_s: exposure.adaptation_seconds,
        }
    }
}

/// A change of settings, the body of `POST /settings`; omitted settings keep their values.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SettingsChange {
    /// See [`Settings::technique`].
    pub technique: Option<Technique>,
    /// See [`Settings::light_count`].
    pub light_count: Option<u32>,
    /// See [`Settings::light_placement`].
    pub light_placement: Option<LightPlacement>,
    /// See [`Settings::shadow_mode`].
    pub shadow_mode: Option<ShadowMode>,
    /// See [`Settings::shadow_strength`].
    pub shadow_strength: Option<f32>,
    /// See [`Settings::virtual_object_visible`].
    pub virtual_object_visible: Option<bool>,
    /// See [`Settings::reflections`].
    pub reflections: Option<Filtering>,
    /// See [`Settings::indirect_light`].
    pub indirect_light: Option<bool>,
    /// See [`Settings::lamp_response`].
    pub lamp_response: Option<LampResponse>,
    /// See [`Settings::planes_skip_below`].
    pub planes_skip_below: Option<f32>,
    /// See [`Settings::planes_recompute_above`].
    pub planes_recompute_above: Option<f32>,
    /// See [`Settings::planes_shading`].
    pub planes_shading: Option<PlaneShading>,
    /// See [`Settings::exposure_mode`].
    pub exposure_mode: Option<ExposureMode>,
    /// See [`Settings::exposure_ev`].
    pub exposure_ev: Option<f32>,
    /// See [`Settings::exposure_highlights`].
    pub exposure_highlights: Option<Highlights>,
    /// See [`Settings::exposure_min_ev`].
    pub exposure_min_ev: Option<f32>,
    /// See [`Settings::exposure_max_ev`].
    pub exposure_max_ev: Option<f32>,
    /// See [`Settings::exposure_key`].
    pub exposure_key: Option<f32>,
    /// See [`Settings::exposure_adaptation_s`].
    pub exposure_adaptation_s: Option<f32>,
}

/// Why a change was refused; nothing of it is applied.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SettingsError {
    /// The body is no JSON object of known settings with values of the right kind.
    #[error("settings: {reason}; send a JSON object such as {{\"light_count\": 64}}")]
    Malformed {
        /// The parser's message, with line and column.
        reason: String,
    },
    /// There is no dome with this number of lights.
    #[error("light_count: {count} is not a number of dome lights; choose 8, 24, 48, 64, 96 or 384")]
    LightCount {
        /// The requested value.
        count: u32,
    },
    /// Out of range or not a number.
    #[error("shadow_strength: {strength} is not between 0 (no shadow) and 1 (as measured)")]
    ShadowStrength {
        /// The requested value.
        strength: f32,
    },
    /// Out of range or not a number.
    #[error("{setting}: {share} is not a share of all light; choose a number from 0 to 1")]
    Share {
        /// Name of the setting.
        setting: &'static str,
        /// The requested value.
        share: f32,
    },
    /// Out of range or not a number.
    #[error("{setting}: {value} is out of range; choose a number from {low} to {high}")]
    OutOfRange {
        /// Name of the setting.
        setting: &'static str,
        /// The requested value.
        value: f32,
        /// Minimum.
        low: f32,
        /// Maximum.
        high: f32,
    },
}

impl SettingsChange {
    /// Reads the body of a request.
    ///
    /// # Errors
    /// [`SettingsError::Malformed`], with the place in the text.
    pub fn from_json(body: &[u8]) -> Result<Self, SettingsError> {
        serde_json::from_slice(body).map_err(|e| {
            let message = e.to_string();
            let renamed = RENAMED
                .iter()
                .find(|(old, _)| message.contains(&format!("unknown field `{old}`")));
            let reason = renamed.map_or(message, |(old, new)| {
                format!("`{old}` is now called `{new}`")
            });
            SettingsError::Malformed { reason }
        })
    }

    /// Returns `settings` with this change applied.
    ///
    /// # Errors
    /// The first invalid value.
    pub fn apply_to(&self, settings: &Settings) -> Result<Settings, SettingsError> {
        let wanted = Settings {
            technique: self.technique.unwrap_or(settings.technique),
            light_count: self.light_count.unwrap_or(settings.light_count),
            light_placement: self.light_placement.unwrap_or(settings.light_placement),
            shadow_mode: self.shadow_mode.unwrap_or(settings.shadow_mode),
            shadow_strength: self.shadow_strength.unwrap_or(settings.shadow_strength),
            virtual_object_visible: self
                .virtual_object_visible
                .unwrap_or(settings.virtual_object_visible),
            reflections: self.reflections.unwrap_or(settings.reflections),
            indirect_light: self.indirect_light.unwrap_or(settings.indirect_light),
            lamp_response: self.lamp_response.unwrap_or(settings.lamp_response),
            planes_skip_below: self.planes_skip_below.unwrap_or(settings.planes_skip_below),
            planes_recompute_above: self
                .planes_recompute_above
                .unwrap_or(settings.planes_recompute_above),
            planes_shading: self.planes_shading.unwrap_or(settings.planes_shading),
            exposure_mode: self.exposure_mode.unwrap_or(settings.exposure_mode),
            exposure_ev: self.exposure_ev.unwrap_or(settings.exposure_ev),
            exposure_highlights: self
                .exposure_highlights
                .unwrap_or(settings.exposure_highlights),
            exposure_min_ev: self.exposure_min_ev.unwrap_or(settings.exposure_min_ev),
            exposure_max_ev: self.exposure_max_ev.unwrap_or(settings.exposure_max_ev),
            exposure_key: self.exposure_key.unwrap_or(settings.exposure_key),
            exposure_adaptation_s: self
                .exposure_adaptation_s
                .unwrap_or(settings.exposure_adaptation_s),
        };
        wanted.validated()
    }
}

impl Settings {
    /// Describes what differs from `before`.
    pub(crate) fn changes_from(&self, before: &Self) -> String {
        let json = |settings: &Self| serde_json::to_value(settings).unwrap_or_default();
        let (old, new) = (json(before), json(self));
        let values = new.as_object().into_iter().flatten();
        let changed = values.filter(|(name, value)| old[name.as_str()] != **value);
        let changed = changed.map(|(name, value)| format!("{name} = {value}"));
        format!("settings: {}", changed.collect::<Vec<_>>().join(", "))
    }

    /// Returns `self` if every value is valid.
    ///
    /// # Errors
    /// The first invalid value.
    pub fn validated(self) -> Result<Self, SettingsError> {
        if !LIGHT_COUNTS.contains(&self.light_count) {
            let count = self.light_count;
            return Err(SettingsError::LightCount { count });
        }
        if !(0.0..=1.0).contains(&self.shadow_strength) {
            let strength = self.shadow_strength;
            return Err(SettingsError::ShadowStrength { strength });
        }
        let shares = [
            ("planes_skip_below", self.planes_skip_below),
            ("planes_recompute_above", self.planes_recompute_above),
        ];
        let wrong = shares.iter().find(|(_, s)| !(0.0..=1.0).contains(s));
        if let Some(&(setting, share)) = wrong {
            return Err(SettingsError::Share { setting, share });
        }
        self.exposure_in_range()?;
        Ok(self)
    }

    fn exposure_in_range(&self) -> Result<(), SettingsError> {
        let numbers = [
            ("exposure_ev", self.exposure_ev, EXPOSURE_STOPS),
            ("exposure_min_ev", self.exposure_min_ev, MIN_EV_STOPS),
            ("exposure_max_ev", self.exposure_max_ev, MAX_EV_STOPS),
            ("exposure_key", self.exposure_key, EXPOSURE_KEYS),
            (
                "exposure_adaptation_s",
                self.exposure_adaptation_s,
                ADAPTATION_SECONDS,
            ),
        ];
        for (setting, value, range) in numbers {
            if !range.contains(&value) {
                let (low, high) = range.into_inner();
                return Err(SettingsError::OutOfRange {
                    setting,
                    value,
                    low,
                    high,
                });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn change(json: &str) -> Result<Settings, SettingsError> {
        SettingsChange::from_json(json.as_bytes())?.apply_to(&Settings::default())
    }

    #[test]
    fn omitted_settings_are_unchanged() {
        let changed = change(r#"{"light_count": 96, "light_placement": "grid"}"#).unwrap();
        let expected = Settings {
            light_count: 96,
            light_placement: LightPlacement::Grid,
            ..Settings::default()
        };
        assert_eq!(changed, expected);
        assert_eq!(change("{}").unwrap(), Settings::default());
    }

    #[test]
    fn refusals_name_valid_values() {
        let text = |json: &str| change(json).unwrap_err().to_string();
        assert_eq!(
            text(r#"{"light_count": 50}"#),
            "light_count: 50 is not a number of dome lights; choose 8, 24, 48, 64, 96 or 384"
        );
        assert_eq!(
            text(r#"{"shadow_strength": 1.5}"#),
            "shadow_strength: 1.5 is not between 0 (no shadow) and 1 (as measured)"
        );
        assert_eq!(
            text(r#"{"planes_skip_below": -0.1}"#),
            "planes_skip_below: -0.1 is not a share of all light; choose a number from 0 to 1"
        );
        assert!(
            text(r#"{"planes_shading": "all"}"#)
                .contains("expected one of `irradiance`, `lights`, `six`")
        );
        assert!(text(r#"{"reflections": "soft"}"#).contains("expected `prefiltered` or `box`"));
        assert!(text(r#"{"lamp_response": "flat"}"#).contains("expected `intrinsic` or `paper`"));
        assert!(text(r#"{"shadow_strenght": 1}"#).contains("unknown field `shadow_strenght`"));
        assert!(text(r#"{"light_placement": "random"}"#).contains("expected `adaptive` or `grid`"));
        assert_eq!(
            text(r#"{"exposure_ev": -9}"#),
            "exposure_ev: -9 is out of range; choose a number from -8 to 3"
        );
        assert_eq!(
            text(r#"{"exposure_min_ev": 0.5}"#),
            "exposure_min_ev: 0.5 is out of range; choose a number from -8 to 0"
        );
        assert!(
            text(r#"{"exposure_mode": "dark"}"#)
                .contains("expected one of `off`, `manual`, `auto`")
        );
        assert!(
            text(r#"{"exposure_highlights": "kept"}"#).contains("expected `estimated` or `paper`")
        );
        assert!(text(r#"{"exposure_ev": NaN}"#).starts_with("settings: "));
        assert!(text("").starts_with("settings: EOF"));
        assert!(text(r#"{"shadow_strength": 1e999}"#).contains("number out of range"));
    }

    #[test]
    fn refuses_former_names_with_the_new_ones() {
        for (body, expected) in [
            (r#"{"technique": "planes"}"#, "`shadowing-planes`"),
            (
                r#"{"lights_mode": "grid"}"#,
                "`lights_mode` is now called `light_placement`",
            ),
            (
                r#"{"bounced_light": true}"#,
                "`bounced_light` is now called `indirect_light`",
            ),
        ] {
            let text = change(body).unwrap_err().to_string();
            assert!(text.contains(expected), "{text}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_refused_or_give_valid_settings(body in proptest::collection::vec(any::<u8>(), 0..200)) {
            let granted = SettingsChange::from_json(&body).and_then(|c| c.apply_to(&Settings::default()));
            if let Ok(settings) = granted {
                prop_assert!(settings.validated().is_ok());
            }
        }

        #[test]
        fn any_numbers_are_refused_or_give_valid_settings(count in any::<i64>(), strength in any::<f64>()) {
            let body = format!(r#"{{"light_count": {count}, "shadow_strength": {strength}, "planes_skip_below": {strength}}}"#);
            if let Ok(settings) = change(&body) {
                prop_assert!(LIGHT_COUNTS.contains(&settings.light_count));
                prop_assert!(settings.shadow_strength >= 0.0 && settings.shadow_strength <= 1.0);
                prop_assert!(settings.planes_skip_below >= 0.0 && settings.planes_skip_below <= 1.0);
            }
        }
    }
}
