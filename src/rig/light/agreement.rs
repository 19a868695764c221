//! How well the estimated light explains the real shadows in the scene camera's picture.

use penumbra_lighting::lamp_distance::SurfaceAgreement;
use penumbra_scene::RayCaster;

/// Share of the newest look in what is known of a surface.
const SHARE: f32 = 0.3;
/// Difference of the logarithms of contrasts from which a surface disagrees, and in standard errors.
const DISAGREES: f32 = 0.1;
const SIGNIFICANT: f32 = 3.0;

/// The real surfaces on which predicted and seen shadows were compared.
#[derive(Debug, Default)]
pub(crate) struct Agreements(Vec<SurfaceAgreement>);

/// How well the estimated light explains the shadows and the shading of real surfaces in the scene
/// camera's picture.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureAgreement {
    /// By how much contrasts in the picture differ from the predicted ones: root mean square over the
    /// surfaces, relative.
    pub difference: f64,
    /// Its standard error, relative.
    pub sigma: f64,
    /// A line for each surface that disagrees significantly.
    pub disagreeing: Vec<String>,
}

impl Agreements {
    /// Takes over what one look at the picture has shown.
    pub fn add(&mut self, seen: &[SurfaceAgreement]) {
        for new in seen {
            match self.0.iter_mut().find(|known| known.surface == new.surface) {
                Some(known) => {
                    known.difference += SHARE * (new.difference - known.difference);
                    known.sigma += SHARE * (new.sigma - known.sigma);
                    known.pairs = new.pairs;
                }
                None => self.0.push(*new),
            }
        }
    }

    /// Forgets the surfaces, because they have been replaced.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// The whole picture; `None` if no surface shows a shadow. `rays` names the surfaces.
    pub fn picture(&self, rays: &RayCaster) -> Option<PictureAgreement> {
        let pairs: f32 = self.0.iter().map(|s| s.pairs as f32).sum();
        let mean = |of: fn(&SurfaceAgreement) -> f32| {
            let squares = self.0.iter().map(|s| s.pairs as f32 * of(s).powi(2));
            f64::from((squares.sum::<f32>() / pairs).sqrt()).exp_m1()
        };
        (pairs > 0.0).then(|| PictureAgreement {
            difference: mean(|s| s.difference),
            sigma: mean(|s| s.sigma),
            disagreeing: (self.0.iter()).filter_map(|s| line(s, rays)).collect(),
        })
    }
}

/// What the user is told of a surface, if it disagrees.
fn line(surface: &SurfaceAgreement, rays: &RayCaster) -> Option<String> {
    let size = surface.difference.abs();
    if size < DISAGREES || size < SIGNIFICANT * surface.sigma {
        return None;
    }
    let how = if surface.difference > 0.0 {
        "deeper"
    } else {
        "weaker"
    };
    let (name, percent) = (rays.name(surface.surface), 100.0 * size.exp_m1());
    Some(format!(
        "{name}: its shadows in the picture are {percent:.0} % {how} than the light predicts"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_scene::raycast::GROUND;

    fn ground(difference: f32) -> SurfaceAgreement {
        SurfaceAgreement {
            surface: GROUND,
            difference,
            sigma: 0.02,
            pairs: 200,
        }
    }

    #[test]
    fn only_what_differs_significantly_is_named() {
        let rays = RayCaster::default();
        let mut all = Agreements::default();
        assert_eq!(all.picture(&rays), None);
        all.add(&[ground(0.04)]);
        let good = all.picture(&rays).unwrap();
        assert!((good.difference - 0.0408).abs() < 1e-3 && good.disagreeing.is_empty());
        for _ in 0..20 {
            all.add(&[ground(-0.25)]);
        }
        let bad = all.picture(&rays).unwrap();
        let line = "ground: its shadows in the picture are 28 % weaker than the light predicts";
        assert_eq!(bad.disagreeing, [line]);
        all.clear();
        assert_eq!(all.picture(&rays), None);
    }
}
