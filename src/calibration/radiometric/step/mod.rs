//! The radiometric step: charts, exposure series and pictures at rest, as they come, become
//! gains between the cameras, tone curves, fall-off and noise.

mod colours;
mod eye;
mod gains;
mod judge;
mod judge_cameras;
mod page;

pub use eye::ChartSeen;
use penumbra_camera::vignetting::frame;

use super::curve;
use super::noise::Noise;
use super::reference::Edition;
use super::vignetting;
use crate::step::{Eye, Finished, Made, Progress, Shown, Step, Wants};
use eye::EyeState;
use glam::DVec2;
use penumbra_camera::Response;
use penumbra_picture::Picture;
use penumbra_rig_model::Grade;
use penumbra_rig_model::radiometric_file::{
    CameraRecord, GainsRecord, NoiseRecord, RadiometricRecord, ResponseRecord, STEP,
    VignettingRecord,
};
use penumbra_white_balance::GainEstimate;

/// What is known before, and wanted.
#[derive(Clone, Debug)]
pub struct Options {
    /// Tone curves of scene and environment camera, as far as known.
    pub responses: [Response; 2],
    /// Sizes of their pictures, where known.
    pub sizes: [Option<(u32, u32)>; 2],
    /// Where their lenses' axes meet the picture, where known, pixels.
    pub centres: [Option<DVec2>; 2],
    /// Which chart.
    pub edition: Edition,
    /// Where a grey card lies in their pictures, x, y, width, height.
    pub greys: [Option<[u32; 4]>; 2],
    /// How well exposures are known, relative.
    pub exposure_sigma: f64,
    /// Look for a 3×3 matrix too.
    pub matrix: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            responses: [Response::srgb(), Response::srgb()],
            sizes: [None; 2],
            centres: [None; 2],
            edition: Edition::default(),
            greys: [None; 2],
            exposure_sigma: 0.01,
            matrix: true,
        }
    }
}

/// The step.
pub struct Radiometric {
    options: Options,
    eyes: [EyeState; 2],
    scene_gains: Option<(GainEstimate, String)>,
}

/// What was found of one camera.
#[derive(Clone, Debug, Default)]
struct CameraFound {
    curve: Option<Result<curve::Curve, curve::NoCurve>>,
    /// The curve in force from here on, and how it is called.
    response: Option<(Response, String)>,
    replaces: bool,
    noise: Option<Noise>,
    /// And whether it is from flat pictures, which alone it is taken over from.
    fall_off: Option<(vignetting::Fit, bool)>,
    size: (u32, u32),
}

const fn index(eye: Eye) -> usize {
    match eye {
        Eye::Scene => 0,
        Eye::Environment => 1,
    }
}

/// Names of the cameras, in the order of all that is kept for both.
const EYES: [Eye; 2] = [Eye::Scene, Eye::Environment];

impl Radiometric {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(options: Options) -> Self {
        Self {
            eyes: [EyeState::default(), EyeState::default()],
            options,
            scene_gains: None,
        }
    }

    /// Takes pictures of the same thing at rest with the logarithm (base e) of their exposures.
    pub fn add_series(&mut self, eye: Eye, series: &[(&Picture, f64)]) {
        let state = &mut self.eyes[index(eye)];
        state.series.add(series);
        state.size = series
            .first()
            .map_or(state.size, |p| (p.0.width, p.0.height));
    }

    /// Takes a picture of an evenly lit, even surface that fills it.
    pub fn add_flat(&mut self, eye: Eye, picture: &Picture) {
        let i = index(eye);
        let centre = self.options.centres[i];
        self.eyes[i].add_flat(picture, &self.options.responses[i], centre);
    }

    /// Takes gains found from what both cameras see, and from how much.
    pub fn add_scene_gains(&mut self, estimate: GainEstimate, from: String) {
        self.scene_gains = Some((estimate, from));
    }

    /// Takes a fall-off that was found while a camera moved; flat pictures come before it.
    pub fn add_fall_off(&mut self, eye: Eye, fit: vignetting::Fit) {
        self.eyes[index(eye)].moving = Some(fit);
    }

    fn camera(&self, i: usize) -> CameraFound {
        let state = &self.eyes[i];
        let said = &self.options.responses[i];
        let curve = (!state.series.exposures.is_empty())
            .then(|| curve::fit(&state.series, self.options.exposure_sigma));
        let (response, replaces) = judge::response(curve.as_ref(), said);
        CameraFound {
            noise: state.noise.finish(&response.0),
            response: Some(response),
            replaces,
            curve,
            fall_off: state.fall_off(),
            size: state.size,
        }
    }
}

impl Step for Radiometric {
    fn name(&self) -> &'static str {
        STEP
    }

    fn wants(&self) -> Wants {
        Wants {
            scene: true,
            environment: true,
            brackets: true,
            poses: false,
            spacing: 0.2,
        }
    }

    fn look(&mut self, shown: &Shown) {
        if let Shown::Picture(shown) = shown {
            let i = index(shown.eye);
            self.eyes[i].look(shown, self.options.greys[i]);
        }
    }

    fn progress(&self) -> Progress {
        judge::progress(&self.eyes)
    }

    fn finish(&mut self, made: &Made) -> Finished {
        for eye in &mut self.eyes {
            eye.flush();
        }
        let cameras = [self.camera(0), self.camera(1)];
        let gains = gains::between(
            &self.eyes,
            &cameras,
            &self.options,
            self.scene_gains.as_ref(),
        );
        let mut found = judge::judged(&self.eyes, &cameras, &gains, &self.options);
        found.page = page::page(made, &found, &self.eyes, &cameras, &gains, &self.options);
        if found.grade != Grade::Refused {
            let record = self.record(made, &found, &cameras, &gains);
            found.file = serde_json::to_string_pretty(&record).ok();
        }
        found
    }
}

impl Radiometric {
    fn record(
        &self,
        made: &Made,
        found: &Finished,
        cameras: &[CameraFound; 2],
        gains: &gains::Gains,
    ) -> RadiometricRecord {
        let [scene, environment] = [0, 1].map(|i| self.camera_record(i, &cameras[i]));
        RadiometricRecord {
            header: found.header(STEP, made),
            scene_camera: scene,
            environment_camera: environment,
            gains: gains.best().map(|(method, estimate)| GainsRecord {
                rgb: estimate.gains.to_array(),
                relative_sigma: estimate.relative_sd.to_array(),
                method: method.to_owned(),
                exposures: gains.exposures,
                matrix: gains.matrix.map(|m| m.transpose().to_cols_array_2d()),
            }),
        }
    }

    fn camera_record(&self, i: usize, camera: &CameraFound) -> CameraRecord {
        let response = camera.replaces.then_some(()).and_then(|()| {
            let (response, _) = camera.response.as_ref()?;
            let sigma = camera
                .curve
                .as_ref()?
                .as_ref()
                .ok()
                .map(|c| &c.relative_sigma);
            let finite = |s: &f64| if s.is_finite() { *s as f32 } else { 1.0 };
            Some(ResponseRecord {
                linear_from_code: response.linear_from_code().to_vec(),
                relative_sigma: sigma.map_or_else(Vec::new, |s| s.iter().map(finite).collect()),
            })
        });
        let vignetting = camera
            .fall_off
            .as_ref()
            .filter(|(f, flat)| *flat && judge::falls_off(f));
        CameraRecord {
            response,
            vignetting: vignetting.map(|(f, _)| {
                let (centre, radius) = frame(camera.size, self.options.centres[i]);
                VignettingRecord {
                    width: camera.size.0,
                    height: camera.size.1,
                    centre: centre.to_array(),
                    radius,
                    coefficients: f.coefficients,
                    sigma: f.sigma,
                }
            }),
            noise: camera.noise.as_ref().map(|n| NoiseRecord {
                read: n.read,
                read_sigma: n.read_sigma,
                shot: n.shot,
                shot_sigma: n.shot_sigma,
            }),
        }
    }
}

#[cfg(test)]
mod tests;
