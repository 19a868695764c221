//! Estimates [`Lighting`] at the scene camera's white point from environment pictures, white
//! balance gains and the radiance of the ground.

use crate::error::RigError;
use crate::light::bracket_response::{BracketResponse, ExposureAgreement};
use crate::light::chart::ChartPictures;
use crate::light::indirect::IndirectLightUpdater;
use crate::light::places::LampPlaces;
use crate::light::scene_tables::{RealLight, SceneLight, hides, middle_of_objects};
use crate::light::state::{LightState, STATED_AT};
use crate::light::surfaces::{GroundRadiance, PhantomSurfaces};
use crate::light::view::{SceneView, SphereAt};
use crate::registration::DEFAULT_SPHERE_SIGMA;
use crate::setup::{RigSetup, max_pixels};
use glam::{DVec3, Mat3, Quat, Vec3};
use penumbra_camera::EnvironmentView;
use penumbra_config::{Config, Unseen, WhiteBalanceMethod};
use penumbra_interface::RigidTransform;
use penumbra_lighting::Filtering;
use penumbra_lighting::average::LightAverage;
use penumbra_lighting::{
    Bracket, EnvironmentEstimator, EnvironmentInput, LightPlacement, Lighting, SpherePosition,
};
use penumbra_picture::{Picture, PictureError, YuvEncoding, decode_within};
use penumbra_rig_model::Attachments;
use penumbra_rig_model::{EnvironmentSource, RigCalibration};
use penumbra_scene::{Hit, RayCaster, RealSurfaces, Scene, casters};
use penumbra_sync::EnvironmentSet;
use penumbra_white_balance::chart::Photograph;
use penumbra_white_balance::gather::{GatherOptions, Overlap, gather_pairs};
use penumbra_white_balance::overlap::estimate_overlap;
use penumbra_white_balance::reflectance;
use penumbra_white_balance::reflectance::{
    ReflectanceOptions, estimate_reflectance, gather_known, grey_world, irradiance_at,
    irradiance_past,
};
use penumbra_white_balance::{
    MatchStatus, Provenance, SameModel, WhiteBalanceMatch, WhiteBalanceSettings,
};
use std::sync::Arc;

/// Environment sets between two estimates of the gains from the cameras' overlap.
const OVERLAP_EVERY: u32 = 5;
/// Most looks at the shadows in one picture: a lamp that gains a place, or much light, is another one.
const LOOKS: u32 = 4;
/// Spacing of the sampled blocks on surfaces of known reflectance, pixels.
const KNOWN_SPACING: u32 = 32;

/// Turns environment pictures into light.
pub struct LightEstimator {
    estimator: Option<EnvironmentEstimator>,
    white_balance: WhiteBalanceMatch,
    chart: Option<ChartPictures>,
    ground: GroundRadiance,
    phantoms: PhantomSurfaces,
    rays: Arc<RayCaster>,
    places: LampPlaces,
    /// Without an environment camera there is no curve.
    brackets: Option<BracketResponse>,
    rig: RigCalibration,
    yuv: YuvEncoding,
    unseen: Unseen,
    decoded: Vec<Picture>,
    generation: Option<u64>,
    lighting: Option<Arc<Lighting>>,
    /// Averages the estimates of a separate environment camera.
    average: LightAverage,
    indirect: IndirectLightUpdater,
    /// Time of the next picture, seconds since the session began.
    seconds: f64,
    since_overlap: u32,
    /// The light comes from an environment map.
    is_stated: bool,
    /// Light from a map must be computed for the next picture: settings or the scene have changed.
    is_due: bool,
}

impl LightEstimator {
    /// Builds the tables of the rig's view and matches the chart, if `files` has one.
    ///
    /// # Errors
    /// The geometry of the environment view is invalid, or a chart picture cannot be read.
    pub fn new(setup: &RigSetup, config: &Config, files: &Attachments) -> Result<Self, RigError> {
        let indirect = IndirectLightUpdater::new(&setup.scene, &casters(&setup.scene));
        let estimator = Self::without_indirect_light(setup, config, files)?;
        Ok(Self {
            indirect,
            ..estimator
        })
    }

    /// As [`Self::new`], without the light that virtual objects reflect, whose tables take longest.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn without_indirect_light(
        setup: &RigSetup,
        config: &Config,
        files: &Attachments,
    ) -> Result<Self, RigError> {
        let rig = setup.calibration.clone();
        let RealLight {
            mut estimator,
            phantoms,
            rays,
        } = RealLight::new(&rig, &setup.scene, config, true)?;
        if let Some(estimator) = &mut estimator {
            estimator.set_reference(middle_of_objects(&setup.scene));
        }
        let same_camera = is_in_scene(&rig);
        let mut white_balance = WhiteBalanceMatch::new(white_balance_settings(config), same_camera);
        let chart = if same_camera {
            None
        } else {
            ChartPictures::read(&rig, files, config.white_balance.matrix)?
        };
        if let Some(chart) = chart.as_ref().and_then(|chart| chart.matched(&rig)) {
            white_balance.set_chart(chart);
        }
        if let Some(gains) = rig.gains.filter(|_| !same_camera) {
            white_balance.set_calibrated(gains);
        }
        let is_known = same_camera || white_balance.in_force().0 <= Provenance::Chart;
        let same_model = match config.white_balance.same_camera {
            Some(true) => Some(SameModel::Stated),
            None if setup.same_product => Some(SameModel::ByName),
            _ => None,
        };
        if let Some(same_model) = same_model.filter(|_| !is_known) {
            white_balance.set_same_model(same_model);
        }
        Ok(Self {
            estimator,
            white_balance,
            chart,
            ground: GroundRadiance::new(&rig, &setup.scene, rays.clone()),
            phantoms,
            places: LampPlaces::new(&rig, rays.clone(), &config.environment),
            rays,
            brackets: (rig.environment.as_ref())
                .map(|environment| BracketResponse::new(environment.response.clone())),
            rig,
            yuv: config.input.encoding(),
            unseen: config.environment.unseen,
            decoded: Vec::new(),
            generation: None,
            lighting: None,
            average: LightAverage::default(),
            indirect: IndirectLightUpdater::new(&Scene::default(), &[]),
            seconds: 0.0,
            since_overlap: 0,
            is_stated: config.environment.source == EnvironmentSource::Map,
            is_due: true,
        })
    }

    /// Returns the light for a frame, estimated from the environment set paired with it. A set is
    /// decoded only once.
    ///
    /// # Errors
    /// A picture cannot be decoded or does not fit the calibration; the light stays as it was.
    pub fn update(
        &mut self,
        set: Option<&EnvironmentSet>,
        scene: &SceneView<'_>,
    ) -> Result<Option<Arc<Lighting>>, RigError> {
        self.ground.look(scene);
        self.phantoms.look(scene);
        if self.is_stated {
            self.estimate_from_map()?;
        } else if is_in_scene(&self.rig) {
            self.estimate_from_sphere(scene)?;
        } else if let Some(set) = set
            && self.generation != Some(set.generation)
        {
            self.generation = Some(set.generation);
            self.decode(set)?;
            self.compare_exposures(set);
            self.match_cameras(set, scene);
            self.estimate(set, scene)?;
        }
        if let Some(lighting) = &self.lighting {
            let real = RealSurfaces {
                phantoms: self.phantoms.radiance(lighting),
                ground: self.ground.brightness(),
            };
            self.indirect.update(self.seconds, lighting, real);
        }
        Ok(self.lighting.clone())
    }

    fn decode(&mut self, set: &EnvironmentSet) -> Result<(), RigError> {
        let view = self.rig.environment.as_ref().map(|e| &e.view);
        let max_pixels = max_pixels(match view {
            Some(EnvironmentView::Fisheye { lens, .. }) => (lens.width, lens.height),
            Some(EnvironmentView::Sphere { camera, .. }) => (camera.width, camera.height),
            Some(EnvironmentView::SphereInScene { .. }) | None => (0, 0),
        });
        self.decoded.resize_with(set.frames.len(), Picture::default);
        for (frame, picture) in set.frames.iter().zip(&mut self.decoded) {
            decode_within(max_pixels, frame, &self.yuv, picture).map_err(unreadable)?;
        }
        Ok(())
    }

    /// Estimates the light from the mirrored sphere in the scene camera's picture.
    fn estimate_from_sphere(&mut self, scene: &SceneView<'_>) -> Result<(), RigError> {
        let (Some(estimator), Some(pose)) = (&mut self.estimator, scene.world_from_camera) else {
            return Ok(());
        };
        let rays = &self.rays;
        let hidden = |o: DVec3, d: DVec3| hides(rays, o, d);
        let input = EnvironmentInput {
            brackets: &[Bracket {
                picture: scene.picture,
                ev: 0.0,
            }],
            scene: (scene.sphere != SphereAt::Lost).then_some((pose, scene.camera)),
            gains: Mat3::IDENTITY,
            ground_radiance: self.ground.radiance(),
            measured_ground_irradiance: None,
            hidden: Some(&hidden),
            occluder_radiance: self.phantoms.mean(),
            sphere_position: sphere_position(scene, &self.rig),
            captured_at: scene.captured_at,
        };
        let mut lighting = estimator.update(&input)?;
        for _ in 0..LOOKS {
            self.phantoms.radiance(&lighting);
            let light = (&*lighting, &self.phantoms);
            if !self.places.look(scene, light, estimator) {
                break;
            }
            lighting = estimator.update(&input)?;
        }
        self.lighting = Some(lighting);
        Ok(())
    }

    /// Computes the light of the environment map, where it may have changed. It holds for ever.
    fn estimate_from_map(&mut self) -> Result<(), RigError> {
        let Some(estimator) = self.estimator.as_mut().filter(|_| self.is_due) else {
            return Ok(());
        };
        let input = EnvironmentInput {
            ground_radiance: self.ground.radiance(),
            ..EnvironmentInput::new(&[], STATED_AT)
        };
        self.lighting = Some(estimator.update(&input)?);
        self.is_due = false;
        Ok(())
    }

    /// Holds the exposures of a decoded environment set against the camera's curve. Where another one
    /// takes its place, everything that was computed with the curve is computed again.
    fn compare_exposures(&mut self, set: &EnvironmentSet) {
        let Some(known) = &mut self.brackets else {
            return;
        };
        if !known.look(&brackets(set, &self.decoded)) {
            return;
        }
        if let Some(estimator) = &mut self.estimator {
            estimator.set_response(known.response());
        }
        if let Some(environment) = &mut self.rig.environment {
            environment.response.clone_from(known.response());
        }
        if let Some(chart) = (self.chart.as_ref()).and_then(|chart| chart.matched(&self.rig)) {
            self.white_balance.set_chart(chart);
        }
    }

    /// Estimates the light from a decoded environment set.
    fn estimate(&mut self, set: &EnvironmentSet, scene: &SceneView<'_>) -> Result<(), RigError> {
        let Some(estimator) = &mut self.estimator else {
            return Ok(());
        };
        let brackets = brackets(set, &self.decoded);
        let seen = self.ground.radiance();
        let input = EnvironmentInput {
            brackets: &brackets,
            scene: scene.world_from_camera.map(|pose| (pose, scene.camera)),
            gains: self.white_balance.scene_from_environment().as_mat3(),
            ground_radiance: match self.unseen {
                Unseen::SceneCamera => seen,
                Unseen::Mean => None,
                Unseen::Black => Some(Vec3::ZERO),
            },
            measured_ground_irradiance: None,
            hidden: None,
            occluder_radiance: None,
            sphere_position: None,
            captured_at: set.captured_at,
        };
        let mut lighting = estimator.update(&input)?;
        for _ in 0..LOOKS {
            self.phantoms.radiance(&lighting);
            let light = (&*lighting, &self.phantoms);
            if !self.places.look(scene, light, estimator) {
                break;
            }
            lighting = estimator.update(&input)?;
        }
        self.lighting = Some(self.average.add(lighting));
        Ok(())
    }

    /// Estimates the gains from surfaces that both cameras see, every [`OVERLAP_EVERY`] environment
    /// sets.
    fn match_cameras(&mut self, set: &EnvironmentSet, scene: &SceneView<'_>) {
        let base = set.frames.iter().position(|f| f.bracket_ev == 0.0);
        let (Some(base), Some(pose), Some(environment)) =
            (base, scene.world_from_camera, &self.rig.environment)
        else {
            return;
        };
        self.white_balance
            .set_exposures(scene.exposure, set.frames[base].exposure);
        self.since_overlap += 1;
        if self.since_overlap < OVERLAP_EVERY && self.lighting.is_some() {
            return;
        }
        self.since_overlap = 0;
        let overlap = Overlap {
            scene: Photograph {
                picture: scene.picture,
                response: &self.rig.scene_camera.response,
            },
            scene_camera: scene.camera,
            world_from_scene_camera: pose,
            environment: Photograph {
                picture: &self.decoded[base],
                response: &environment.response,
            },
            environment_view: &environment.view,
            vignetting: [self.rig.scene_camera.vignetting, environment.vignetting],
        };
        let pairs = gather_pairs(&overlap, &self.rays, &GatherOptions::default());
        self.white_balance.update_overlap(
            estimate_overlap(&pairs),
            scene.captured_at,
            set.captured_at,
        );
        self.match_surfaces(scene, pose);
    }

    /// Estimates the gains from surfaces of known reflectance under the measured light, and from
    /// the assumption that the ground is grey on average.
    fn match_surfaces(&mut self, scene: &SceneView<'_>, world_from_camera: RigidTransform) {
        let Some(lighting) = &self.lighting else {
            return;
        };
        let applied = self.white_balance.gains();
        let view = reflectance::SceneView {
            photograph: Photograph {
                picture: scene.picture,
                response: &self.rig.scene_camera.response,
            },
            camera: scene.camera,
            world_from_camera,
        };
        let rays = &self.rays;
        let irradiance = |hit: &Hit| irradiance_past(rays, lighting, hit);
        let known = gather_known(&view, rays, KNOWN_SPACING, irradiance);
        let estimate = estimate_reflectance(&known, &ReflectanceOptions::default());
        self.white_balance
            .update_reflectance(estimate.map(|e| e.after(applied)));
        if let Some(ground) = self.ground.radiance() {
            let measured = irradiance_at(lighting, Vec3::Z, |_| 1.0) / applied;
            let guess = grey_world(ground.as_dvec3(), measured);
            self.white_balance.update_grey_world(guess);
        }
    }

    /// Forgets that stated light has been computed: its first picture comes again.
    pub(crate) const fn restart(&mut self) {
        self.is_due = true;
    }

    /// Replaces the scene.
    pub(crate) fn set_scene(&mut self, scene: SceneLight) {
        let SceneLight {
            mut indirect,
            mut ground,
            phong,
            reference,
            real,
        } = scene;
        ground.follow(&self.ground);
        indirect.follow(&self.indirect);
        (self.indirect, self.ground) = (indirect, ground);
        if let Some(real) = real {
            (self.phantoms, self.rays) = (real.phantoms, real.rays);
            self.places.set_rays(self.rays.clone());
            if let Some(mut estimator) = real.estimator {
                if let Some(before) = &self.estimator {
                    estimator.follow(before);
                }
                if let Some(known) = &self.brackets {
                    estimator.set_response(known.response());
                }
                self.estimator = Some(estimator);
            }
        }
        if let Some(estimator) = &mut self.estimator {
            estimator.set_reference(reference);
        }
        self.set_phong(phong);
    }

    /// Sets the time of the next picture, seconds after the session began: it determines the
    /// positions of moving parts.
    pub const fn set_time(&mut self, seconds: f64) {
        self.seconds = seconds;
    }

    /// Changes placement and number of the dome lights.
    pub fn set_lights(&mut self, placement: LightPlacement, count: usize) {
        self.is_due = true;
        if let Some(estimator) = &mut self.estimator {
            estimator.set_lights(placement, count);
        }
    }

    /// Changes whether the scene has materials of Phong's model.
    pub fn set_phong(&mut self, wanted: bool) {
        self.is_due = true;
        if let Some(estimator) = &mut self.estimator {
            estimator.set_phong(wanted);
        }
    }

    /// Changes how reflections are filtered.
    pub const fn set_reflections(&mut self, filtering: Filtering) {
        self.is_due = true;
        if let Some(estimator) = &mut self.estimator {
            estimator.set_filtering(filtering);
        }
    }

    /// Changes whether the faces of a geodesic dome are lit for shadowing planes, and its
    /// frequency.
    pub fn set_faces(&mut self, frequency: Option<u32>) {
        self.is_due = true;
        if let Some(estimator) = &mut self.estimator {
            estimator.set_faces(frequency);
        }
    }

    /// Rotates that dome with the model whose planes it lights.
    pub fn rotate_faces(&mut self, world_from_dome: Quat) {
        self.is_due = true;
        if let Some(estimator) = &mut self.estimator {
            estimator.rotate_faces(world_from_dome);
        }
    }

    /// Returns the current light and its provenance, to be shared.
    #[must_use]
    pub fn state(&self) -> LightState {
        let estimator = self.estimator.as_ref();
        LightState {
            lighting: self.lighting.clone(),
            number: self.generation.unwrap_or(0),
            indirect: self.indirect.light().map(|light| Arc::new(light.clone())),
            white_balance: Some(Arc::new(self.match_status())),
            sources: Arc::new(
                estimator
                    .map(EnvironmentEstimator::sources)
                    .unwrap_or_default(),
            ),
            clipped: estimator.map_or(0.0, EnvironmentEstimator::clipped_share),
            exposures: self.exposures(),
            picture: self.places.agreement().map(Arc::new),
            probe: estimator.and_then(EnvironmentEstimator::probe_map),
        }
    }

    /// Whether the environment camera's exposures agree under its tone curve; `None` if too little is
    /// well exposed twice.
    #[must_use]
    pub fn exposures(&self) -> Option<ExposureAgreement> {
        self.brackets.as_ref().and_then(BracketResponse::agreement)
    }

    /// Returns the current light.
    #[must_use]
    pub const fn lighting(&self) -> Option<&Arc<Lighting>> {
        self.lighting.as_ref()
    }

    /// Returns the state of the white balance between the cameras.
    #[must_use]
    pub fn match_status(&self) -> MatchStatus {
        self.white_balance.status()
    }

    /// Returns the estimator, for previews and placement of lights.
    pub const fn estimator(&mut self) -> Option<&mut EnvironmentEstimator> {
        self.estimator.as_mut()
    }
}

/// Returns the assumed position of the mirrored sphere in this picture.
fn sphere_position(scene: &SceneView<'_>, rig: &RigCalibration) -> Option<SpherePosition> {
    match (scene.sphere, rig.environment.as_ref().map(|e| &e.view)) {
        (SphereAt::Seen(position), _) => Some(position),
        (SphereAt::Calibrated, Some(EnvironmentView::SphereInScene { sphere })) => {
            Some(SpherePosition {
                centre_in_world: sphere.centre_in_world,
                sigma: DEFAULT_SPHERE_SIGMA,
            })
        }
        _ => None,
    }
}

fn unreadable(source: PictureError) -> RigError {
    RigError::Picture {
        name: "environment picture".to_owned(),
        source,
    }
}

fn brackets<'a>(set: &EnvironmentSet, decoded: &'a [Picture]) -> Vec<Bracket<'a>> {
    let exposed = set.frames.iter().zip(decoded);
    exposed
        .map(|(frame, picture)| Bracket {
            picture,
            ev: frame.bracket_ev,
        })
        .collect()
}

fn is_in_scene(rig: &RigCalibration) -> bool {
    rig.environment
        .as_ref()
        .is_some_and(|e| matches!(e.view, EnvironmentView::SphereInScene { .. }))
}

fn white_balance_settings(config: &Config) -> WhiteBalanceSettings {
    let white = &config.white_balance;
    WhiteBalanceSettings {
        method: white.method,
        fixed_gains: (white.method == WhiteBalanceMethod::Fixed)
            .then(|| white.gains.map(f64::from)),
        matrix: white.matrix,
    }
}
