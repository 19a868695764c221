//! Exposures and tone curve of photographs.

use crate::photograph::Photograph;
use glam::IVec2;
use penumbra_calibration::radiometric::curve::{SeriesGatherer, fit};
use penumbra_camera::Response;
use penumbra_numerics::median;
use penumbra_picture::Picture;

/// Relative standard deviation of the exposure that EXIF states: shutters are named by rounded
/// numbers (1/60 s is 1/64 s).
const EXIF_SIGMA: f64 = 0.04;

/// Every so many-th pixel tells the difference of two exposures.
const STEP: usize = 7;

/// The tone curve, and what tells it.
#[derive(Clone, Debug)]
pub struct Tone {
    /// The curve.
    pub response: Response,
    /// Number of exposures from which it was measured; 0 if sRGB is assumed.
    pub exposures: usize,
    /// Root mean square difference from sRGB, relative.
    pub from_srgb: f64,
    /// Why it could not be measured from several exposures.
    pub refused: Option<String>,
}

/// Measures the tone curve from pictures of the same scene under exposures that differ by half a stop
/// at least, each with its exposure (stops) and its shift (pixels). sRGB's curve is assumed if there is
/// one exposure only.
#[must_use]
pub fn tone(pictures: &[(&Picture, f64, IVec2)]) -> Tone {
    let assumed = |refused| Tone {
        response: Response::srgb(),
        exposures: 0,
        from_srgb: 0.0,
        refused,
    };
    let (low, high) = pictures.iter().fold((f64::MAX, f64::MIN), |range, p| {
        (range.0.min(p.1), range.1.max(p.1))
    });
    if pictures.len() < 2 || high - low < 0.5 {
        return assumed(None);
    }
    let moved: Vec<Picture> = pictures
        .iter()
        .map(|(p, _, shift)| moved(p, *shift))
        .collect();
    let series: Vec<(&Picture, f64)> = moved
        .iter()
        .zip(pictures)
        .map(|(picture, (_, ev, _))| (picture, ev * std::f64::consts::LN_2))
        .collect();
    let mut gathered = SeriesGatherer::default();
    gathered.add(&series);
    match fit(&gathered, EXIF_SIGMA) {
        Ok(curve) => Tone {
            from_srgb: curve.difference(&Response::srgb()).0,
            response: curve.response,
            exposures: pictures.len(),
            refused: None,
        },
        Err(reason) => assumed(Some(reason.to_string())),
    }
}

/// Returns the picture moved back by `shift`; what was outside is clipped white, which no measurement
/// uses.
fn moved(picture: &Picture, shift: IVec2) -> Picture {
    if shift == IVec2::ZERO {
        return picture.clone();
    }
    let (width, height) = (picture.width as i32, picture.height as i32);
    let rgba = (0..width * height).flat_map(|i| {
        let (x, y) = (i % width + shift.x, i / width + shift.y);
        let is_inside = (0..width).contains(&x) && (0..height).contains(&y);
        let [r, g, b] = if is_inside {
            picture.rgb(x as u32, y as u32)
        } else {
            [255; 3]
        };
        [r, g, b, 255]
    });
    Picture {
        width: picture.width,
        height: picture.height,
        rgba: rgba.collect(),
    }
}

/// What tells the exposures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExposuresFrom {
    /// EXIF, or the user.
    Stated,
    /// The pictures, because EXIF tells none.
    Pictures,
    /// The pictures, because EXIF's contradict them.
    Contradicted,
}

/// Returns the exposures of photographs, stops relative to the first: EXIF's, if all have them and the
/// pictures do not contradict them, else estimated from the pictures with sRGB's curve.
#[must_use]
pub fn exposures(photographs: &[&Photograph]) -> (Vec<f64>, ExposuresFrom) {
    let stated: Option<Vec<f64>> = photographs.iter().map(|p| p.exposure_ev).collect();
    let Some(first) = photographs.first() else {
        return (Vec::new(), ExposuresFrom::Stated);
    };
    let estimated = || {
        let between = |p: &&Photograph| difference(&first.picture, &p.picture);
        photographs.iter().map(between).collect()
    };
    let Some(stated) = stated else {
        return (estimated(), ExposuresFrom::Pictures);
    };
    let relative: Vec<f64> = stated.iter().map(|ev| ev - stated[0]).collect();
    let contradicts = |(p, ev): (&&Photograph, &f64)| !agrees(&first.picture, &p.picture, *ev);
    if photographs.iter().zip(&relative).any(contradicts) {
        (estimated(), ExposuresFrom::Contradicted)
    } else {
        (relative, ExposuresFrom::Stated)
    }
}

/// Whether the second picture is as much brighter than the first as a difference of exposures (stops) tells,
/// as far as a camera's tone curve may differ from sRGB's. What is nearly black or white counts as
/// being at that limit, expected or shown.
fn agrees(a: &Picture, b: &Picture, stated: f64) -> bool {
    let srgb = Response::srgb();
    let linear = srgb.linear_from_code();
    let within = |light: f32| light.clamp(linear[40], linear[200]);
    let pixels = a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4));
    let beside = pixels.step_by(STEP).filter_map(|(a, b)| {
        let expected = within(linear[usize::from(a[1])] * stated.exp2() as f32);
        let shown = within(linear[usize::from(b[1])]);
        let is_exposed = (20..245).contains(&a[1]);
        is_exposed.then(|| f64::from(shown / expected).log2())
    });
    median(beside).unwrap_or(0.0).abs() <= 1.0 + 0.5 * stated.abs()
}

/// Returns the stops between two pictures of the same scene: the median over pixels that are well
/// exposed in both; 0 if none is.
fn difference(a: &Picture, b: &Picture) -> f64 {
    let srgb = Response::srgb();
    let linear = srgb.linear_from_code();
    let pixels = a
        .rgba
        .chunks_exact(4)
        .zip(b.rgba.chunks_exact(4))
        .step_by(STEP);
    let stops = pixels.filter_map(|(a, b)| {
        let is_exposed = |code: u8| (20..245).contains(&code);
        let both = is_exposed(a[1]) && is_exposed(b[1]);
        let ratio = linear[usize::from(b[1])] / linear[usize::from(a[1])];
        both.then(|| f64::from(ratio).log2())
    });
    let stops = median(stops).unwrap_or(0.0);
    // Pictures of one exposure differ by less than this.
    if stops.abs() < 0.15 { 0.0 } else { stops }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A field of smooth shades under an exposure, by a gamma of 1 / 1.6.
    fn shades(stops: f64) -> Picture {
        let rgba = (0..320u32 * 240).flat_map(|i| {
            let (x, y) = (f64::from(i % 320), f64::from(i / 320));
            let light = 0.02 + 0.9 * (x / 320.0) * (0.3 + 0.7 * y / 240.0);
            let code = (255.0 * (light * stops.exp2()).min(1.0).powf(1.0 / 1.6)).round() as u8;
            [code, code, code, 255]
        });
        Picture {
            width: 320,
            height: 240,
            rgba: rgba.collect(),
        }
    }

    #[test]
    fn curve_is_measured_from_three_exposures() {
        let pictures = [shades(0.0), shades(-2.0), shades(-4.0)];
        let series: Vec<(&Picture, f64, IVec2)> = pictures
            .iter()
            .zip([0.0, -2.0, -4.0])
            .map(|(p, ev)| (p, ev, IVec2::ZERO))
            .collect();
        let found = tone(&series);
        assert_eq!(found.exposures, 3, "{:?}", found.refused);
        let curve = found.response.linear_from_code();
        let truth = |code: usize| (code as f32 / 255.0).powf(1.6);
        for code in [40, 80, 200] {
            let ratio = curve[code] / curve[128] / (truth(code) / truth(128));
            assert!((ratio - 1.0).abs() < 0.06, "code {code}: {ratio}");
        }
    }

    #[test]
    fn exposures_that_the_pictures_contradict_are_not_believed() {
        let taken = |stops: f64, exif: f64| Photograph {
            path: "a.jpg".into(),
            picture: shades(stops),
            exposure_ev: Some(exif),
            focal: None,
            profile: None,
        };
        let (first, darker) = (taken(0.0, 3.0), taken(-3.0, 0.0));
        let (told, from) = exposures(&[&first, &darker]);
        assert_eq!((told, from), (vec![0.0, -3.0], ExposuresFrom::Stated));
        for exif in [3.0, 6.0, 9.0] {
            let (told, from) = exposures(&[&first, &taken(-3.0, exif)]);
            assert_eq!(from, ExposuresFrom::Contradicted, "{exif}");
            // The curve is not sRGB's.
            assert!((-5.0..-2.0).contains(&told[1]), "{exif}: {told:?}");
        }
        let six = exposures(&[&first, &taken(-6.0, 3.0)]).1;
        assert_eq!(six, ExposuresFrom::Contradicted);
        let black = exposures(&[&first, &taken(-9.0, -6.0)]).1;
        assert_eq!(black, ExposuresFrom::Stated, "too dark to be compared");
    }

    #[test]
    fn one_exposure_is_srgb_and_contradictions_are_told() {
        let picture = shades(0.0);
        let same = [(&picture, 0.0, IVec2::ZERO), (&picture, 0.0, IVec2::ZERO)];
        assert!(tone(&same).refused.is_none());
        let lying = [(&picture, 0.0, IVec2::ZERO), (&picture, -2.0, IVec2::ZERO)];
        assert!(tone(&lying).refused.is_some());
    }
}
