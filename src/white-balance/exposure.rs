//! Changes of the gains by the exposures that the cameras report per frame.

use penumbra_interface::Exposure;

/// Reported exposures of both cameras. Gains hold for the reference exposures, the first that
/// were reported; [`Self::factor`] converts them to the current ones.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExposureRatio {
    scene: Reported,
    environment: Reported,
}

/// Shutter time × gain of one camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Reported {
    reference: Option<f64>,
    latest: Option<f64>,
}

impl ExposureRatio {
    /// Creates the ratio with reference exposures (shutter time × gain, seconds).
    #[must_use]
    pub fn at(scene: f64, environment: f64) -> Self {
        let reported = |seconds: f64| Reported {
            reference: Some(1e6 * seconds),
            latest: None,
        };
        Self {
            scene: reported(scene),
            environment: reported(environment),
        }
    }

    /// Sets the exposures of the current frames. A missing or invalid exposure leaves that
    /// camera's value unchanged.
    pub fn update(&mut self, scene: Option<Exposure>, environment: Option<Exposure>) {
        self.scene.update(scene);
        self.environment.update(environment);
    }

    /// Ratio of the current gain to the gain at the reference exposures.
    #[must_use]
    pub fn factor(&self) -> f64 {
        self.scene.change() / self.environment.change()
    }
}

impl Reported {
    fn update(&mut self, exposure: Option<Exposure>) {
        let product = exposure.map(|e| e.exposure_micros * e.gain);
        if let Some(product) = product.filter(|p| p.is_finite() && *p > 0.0) {
            self.reference.get_or_insert(product);
            self.latest = Some(product);
        }
    }

    fn change(&self) -> f64 {
        match (self.latest, self.reference) {
            (Some(latest), Some(reference)) => latest / reference,
            _ => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exposure(exposure_micros: f64, gain: f64) -> Option<Exposure> {
        Some(Exposure {
            exposure_micros,
            gain,
        })
    }

    #[test]
    fn gain_rises_with_scene_exposure_and_falls_with_environment_exposure() {
        let mut ratio = ExposureRatio::default();
        assert_eq!(ratio.factor(), 1.0);
        ratio.update(exposure(1000.0, 1.0), exposure(500.0, 2.0));
        assert_eq!(ratio.factor(), 1.0);
        ratio.update(exposure(2000.0, 1.5), None);
        assert_eq!(ratio.factor(), 3.0);
        ratio.update(None, exposure(500.0, 8.0));
        assert_eq!(ratio.factor(), 0.75);
    }

    #[test]
    fn ignores_invalid_exposures() {
        let mut ratio = ExposureRatio::default();
        ratio.update(exposure(1000.0, 1.0), None);
        for (micros, gain) in [
            (0.0, 1.0),
            (-5.0, 1.0),
            (f64::NAN, 1.0),
            (f64::INFINITY, 1.0),
        ] {
            ratio.update(exposure(micros, gain), exposure(micros, gain));
            assert_eq!(ratio.factor(), 1.0);
        }
    }
}
