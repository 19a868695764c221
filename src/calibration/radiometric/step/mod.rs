//! The radiometric step: gains between the cameras, tone curves, vignetting and noise from charts,
//! exposure series and static pictures.
//!
//! In the order of data flow: `camera_data` gathers the pictures of a camera, `camera_result` holds
//! its results; `gains` compares the cameras, `colours` a camera with the chart; `assessment` and
//! `camera_assessment` grade and describe, `report` presents.

mod assessment;
mod camera_assessment;
mod camera_data;
mod camera_result;
mod colours;
mod gains;
mod options;
mod report;

pub use options::RadiometricOptions;

use super::curve;
use super::vignetting;
use crate::step::{
    CalibrationProvenance, CameraRole, Finished, Progress, Step, StepInput, StepInputs,
};
use camera_data::CameraData;
use camera_result::{CameraResult, choose_response, is_significant};
use colours::Colours;
use gains::evaluate;
use penumbra_camera::vignetting::default_frame;
use penumbra_picture::Picture;
use penumbra_rig_model::Grade;
use penumbra_rig_model::radiometric_file::{
    CameraRecord, GainsRecord, NoiseRecord, NoiseTextureRecord, RadiometricRecord, ResponseRecord,
    STEP, VignettingRecord,
};
use penumbra_white_balance::GainEstimate;

/// The radiometric step.
pub struct Radiometric {
    options: RadiometricOptions,
    data: [CameraData; 2],
    scene_gains: Option<(GainEstimate, String)>,
}

const fn index(camera: CameraRole) -> usize {
    match camera {
        CameraRole::Scene => 0,
        CameraRole::Environment => 1,
    }
}

impl Radiometric {
    /// Creates the step without data.
    #[must_use]
    pub fn new(options: RadiometricOptions) -> Self {
        Self {
            data: [CameraData::default(), CameraData::default()],
            options,
            scene_gains: None,
        }
    }

    /// Adds pictures of a static scene with the natural logarithms of their exposures.
    pub fn add_series(&mut self, camera: CameraRole, series: &[(&Picture, f64)]) {
        let state = &mut self.data[index(camera)];
        state.series.add(series);
        state.size = series
            .first()
            .map_or(state.size, |p| (p.0.width, p.0.height));
    }

    /// Adds a picture of a uniform, evenly lit surface that fills it.
    pub fn add_flat(&mut self, camera: CameraRole, picture: &Picture) {
        let i = index(camera);
        let centre = self.options.centres[i];
        self.data[i].add_flat(picture, &self.options.responses[i], centre);
    }

    /// Sets the gains found from surfaces that both cameras see, with a description of the data.
    pub fn add_scene_gains(&mut self, estimate: GainEstimate, from: String) {
        self.scene_gains = Some((estimate, from));
    }

    /// Sets vignetting found from a moving camera; pictures of a uniform surface take precedence.
    pub fn add_vignetting(&mut self, camera: CameraRole, fit: vignetting::VignettingFit) {
        self.data[index(camera)].moving = Some(fit);
    }

    fn camera(&self, i: usize) -> CameraResult {
        let state = &self.data[i];
        let known = &self.options.responses[i];
        let curve = (!state.series.exposures.is_empty())
            .then(|| curve::fit(&state.series, self.options.exposure_sigma));
        let (response, replaces) = choose_response(curve.as_ref(), known);
        CameraResult {
            noise: state.noise.finish(&response.0),
            noise_texture: state.noise_texture.finish(),
            response: Some(response),
            replaces,
            curve,
            vignetting: state.vignetting(),
            size: state.size,
        }
    }
}

impl Step for Radiometric {
    fn name(&self) -> &'static str {
        STEP
    }

    fn inputs(&self) -> StepInputs {
        StepInputs {
            scene: true,
            environment: true,
            brackets: true,
            poses: false,
            spacing: 0.2,
        }
    }

    fn observe(&mut self, input: &StepInput) {
        if let StepInput::Picture(picture) = input {
            let i = index(picture.camera);
            self.data[i].add(picture, self.options.greys[i]);
        }
    }

    fn progress(&self) -> Progress {
        assessment::progress(&self.data)
    }

    fn finish(&mut self, provenance: &CalibrationProvenance) -> Finished {
        for data in &mut self.data {
            data.flush();
        }
        let cameras = [self.camera(0), self.camera(1)];
        let gains = gains::between(
            &self.data,
            &cameras,
            &self.options,
            self.scene_gains.as_ref(),
        );
        let mut found = assessment::assess(&self.data, &cameras, &gains, &self.options);
        found.report = report::report(
            provenance,
            &found,
            &self.data,
            &cameras,
            &gains,
            &self.options,
        );
        if found.grade != Grade::Refused {
            let record = self.record(provenance, &found, &cameras, &gains);
            found.file = serde_json::to_string_pretty(&record).ok();
        }
        found
    }
}

impl Radiometric {
    fn record(
        &self,
        provenance: &CalibrationProvenance,
        found: &Finished,
        cameras: &[CameraResult; 2],
        gains: &gains::Gains,
    ) -> RadiometricRecord {
        let [scene, environment] = [0, 1].map(|i| self.camera_record(i, &cameras[i]));
        RadiometricRecord {
            header: found.header(STEP, provenance),
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

    fn camera_record(&self, i: usize, camera: &CameraResult) -> CameraRecord {
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
            .vignetting
            .as_ref()
            .filter(|(f, flat)| *flat && is_significant(f));
        CameraRecord {
            response,
            vignetting: vignetting.map(|(f, _)| {
                let (centre, radius) = default_frame(camera.size, self.options.centres[i]);
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
                texture: camera.noise_texture.map(|t| NoiseTextureRecord {
                    across: t.across,
                    down: t.down,
                    covariance: t.covariance,
                }),
            }),
            colours: self.colours(i, camera).map(|colours| colours.record()),
        }
    }

    /// Returns a camera's colours of the first chart that it sees.
    fn colours(&self, i: usize, camera: &CameraResult) -> Option<Colours> {
        let (response, _) = camera.response.as_ref()?;
        let patches = self.data[i].patches(response);
        evaluate(patches.first()?, &self.options).colours
    }
}

#[cfg(test)]
mod tests;
