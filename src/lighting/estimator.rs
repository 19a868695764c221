//! Estimates light from pictures of the environment camera, frame by frame.

use super::adaptive::{AdaptiveDome, CompactSource};
use super::clipped::{RaisedSources, boost};
use super::cube::{CubeGrid, halve, texel_of};
use super::dome::{DomeGrid, ground_irradiance};
use super::equirect::Equirect;
use super::half_hidden::complete;
use super::harmonics::{HarmonicsTable, blurred, pin_upward};
use super::hdr::{Bracket, BracketMerger, scales};
use super::lamp_distance::UnseenLamp;
use super::light::{DomeLight, Harmonics, Lighting};
use super::memory::RadianceAccumulator;
use super::place::{LampDistance, LampPlane, Viewpoints};
use super::prefilter::Prefilter;
use super::probe::LastSphere;
use super::resample::{GatherTable, Hidden, PixelDirections, inpaint};
use super::settings::{
    ClippedEnergy, EnvironmentError, EnvironmentInput, EnvironmentSettings, IrradianceMethod,
    LightPlacement,
};
use super::shadow_ratio::{Ground, clipped_factor};
use super::sources::{LUMINANCE, Layout, SampleGrid, Source, SourceFinder, SourceSettings};
use super::stages::Stages;
use faces::{FaceTable, Filling};
use glam::{DVec3, Mat3, Vec3};
use penumbra_camera::EnvironmentView;
use penumbra_camera::MirroredView;
use penumbra_camera::PlacedView;
use penumbra_camera::Response;
use penumbra_camera::Vignetting;
use penumbra_interface::MonotonicTime;
use penumbra_numerics::smoothstep;
use std::sync::Arc;

/// Side of the map from which dome lights are made, texels.
const FINE_SIZE: u32 = 16;
/// Standard deviation of the paper's blur, radians: the width of the cosine lobe.
const BLUR_SIGMA: f32 = 0.75;
/// Height (z of the direction) below which only ground is expected.
const GROUND_FROM: f32 = -0.06;
/// Iterations that smooth the fill of unseen texels.
const SMOOTHING_ITERATIONS: usize = 40;
/// Maximum samples along a texel's side: 24 are enough for pictures of 1000 pixels.
const MAX_SAMPLES: u32 = 24;

/// A static view and its tables.
struct FixedView {
    pixels: PixelDirections,
    table: GatherTable,
}

enum View {
    Fixed(Box<FixedView>),
    /// The sphere in the scene camera's picture, with what was seen of each direction.
    Moving(Box<RadianceAccumulator>),
    /// Radiance of the cube's texels, stated instead of measured.
    Stated(Vec<Vec3>),
}

/// Turns environment pictures into [`Lighting`]. Deterministic; keeps the state that makes its
/// results coherent in time.
pub struct EnvironmentEstimator {
    /// `None` for a stated map.
    view: Option<EnvironmentView>,
    placed: View,
    merger: BracketMerger,
    per_reflectance: Vec3,
    settings: EnvironmentSettings,
    grid: CubeGrid,
    neighbours: Vec<[u32; 8]>,
    fine: CubeGrid,
    harmonics: HarmonicsTable,
    prefilter: Prefilter,
    finder: SourceFinder,
    dome: Dome,
    /// Linear picture, environment camera units.
    radiance: Vec<Vec3>,
    /// The same without the compact sources.
    residual: Vec<Vec3>,
    clipped: Vec<u32>,
    /// The measured cube, environment camera units, and the visible part of each texel.
    measured: Vec<Vec3>,
    coverage: Vec<f32>,
    /// Confidence of the texels of the newest picture of a sphere in the scene, and which of its
    /// pixels are clipped.
    confidence: Vec<f32>,
    clipped_mask: Vec<bool>,
    last_sphere: LastSphere,
    reference: DVec3,
    raised: RaisedSources,
    unseen: Vec<UnseenLamp>,
    generation: u64,
    /// Ratio of the clipped pixels' brightness to white, estimated from the scene's shadows.
    shadow_factor: Option<f32>,
    faces: Option<FaceTable>,
    stages: Stages,
}

enum Dome {
    Grid(DomeGrid),
    Adaptive(AdaptiveDome),
}

impl Dome {
    fn new(settings: &EnvironmentSettings, fine: &CubeGrid) -> Self {
        match settings.placement {
            LightPlacement::Grid => {
                Self::Grid(DomeGrid::new(settings.lights, settings.ground, fine))
            }
            LightPlacement::Adaptive => {
                Self::Adaptive(AdaptiveDome::new(settings.lights, settings.ground))
            }
        }
    }
}

impl EnvironmentEstimator {
    /// Builds all tables. `hidden` tells which rays from a static camera end on phantoms; the
    /// radiance behind them is interpolated from its surroundings.
    ///
    /// # Errors
    /// The camera is inside the mirrored sphere, or the cube size is not a power of two from 16 to
    /// 512.
    pub fn new(
        view: &EnvironmentView,
        response: &Response,
        settings: EnvironmentSettings,
        hidden: Option<&Hidden>,
    ) -> Result<Self, EnvironmentError> {
        let grid = checked_grid(&settings)?;
        let placed = place_view(view, &settings, hidden, &grid)?;
        let mut estimator = Self::with_view(placed, response, settings, grid);
        estimator.view = Some(view.clone());
        estimator.per_reflectance = per_reflectance(view);
        estimator.rebuild_faces(glam::Quat::IDENTITY);
        Ok(estimator)
    }

    /// Builds the tables for light that is stated by an environment map and does not change.
    /// Updates need no picture. `yaw` turns the map about +Z, radians; `factor` multiplies it.
    ///
    /// # Errors
    /// The cube size is not a power of two from 16 to 512.
    pub fn from_map(
        map: &Equirect,
        (yaw, factor): (f32, f32),
        settings: EnvironmentSettings,
    ) -> Result<Self, EnvironmentError> {
        let grid = checked_grid(&settings)?;
        let stated = View::Stated(map.to_cube(grid.size, yaw, factor));
        let mut estimator = Self::with_view(stated, &Response::linear(), settings, grid);
        estimator.coverage.fill(1.0);
        estimator.rebuild_faces(glam::Quat::IDENTITY);
        Ok(estimator)
    }

    fn with_view(
        placed: View,
        response: &Response,
        settings: EnvironmentSettings,
        grid: CubeGrid,
    ) -> Self {
        let (size, fine) = (grid.size, CubeGrid::new(FINE_SIZE));
        Self {
            view: None,
            placed,
            merger: BracketMerger::new(response),
            per_reflectance: Vec3::ONE,
            harmonics: HarmonicsTable::new(&grid.directions, &grid.solid_angles),
            prefilter: Prefilter::new(size).with_phong(settings.phong),
            finder: SourceFinder::default(),
            dome: Dome::new(&settings, &fine),
            radiance: Vec::new(),
            residual: Vec::new(),
            clipped: Vec::new(),
            measured: vec![Vec3::ZERO; grid.directions.len()],
            coverage: vec![0.0; grid.directions.len()],
            confidence: Vec::new(),
            clipped_mask: Vec::new(),
            last_sphere: LastSphere::default(),
            reference: DVec3::ZERO,
            raised: RaisedSources::default(),
            unseen: Vec::new(),
            generation: 0,
            shadow_factor: None,
            neighbours: grid.neighbours(),
            grid,
            fine,
            settings,
            faces: None,
            stages: Stages::default(),
        }
    }

    /// Continues the generations of the estimator that it replaces: each names one light.
    pub const fn follow(&mut self, before: &Self) {
        self.generation = before.generation;
    }

    /// Replaces the camera's tone curve.
    pub fn set_response(&mut self, response: &Response) {
        self.merger.set_response(response);
    }

    /// Corrects the vignetting of the camera's pictures of `size`.
    pub fn set_vignetting(&mut self, vignetting: &Vignetting, size: (u32, u32)) {
        self.merger.set_corrections(vignetting.corrections(size));
    }

    /// Returns the active settings.
    #[must_use]
    pub const fn settings(&self) -> &EnvironmentSettings {
        &self.settings
    }

    /// Sets the point for which near lights are stated, the middle of the virtual objects, world,
    /// metres.
    pub const fn set_reference(&mut self, reference: DVec3) {
        self.reference = reference;
    }

    /// Sets the distances of compact sources from the observer by their ids
    /// ([`CompactSource::id`]); from the next update on.
    pub fn set_distances(&mut self, distances: &[(u32, LampDistance)]) {
        if let Dome::Adaptive(dome) = &mut self.dome {
            dome.set_distances(distances);
        }
    }

    /// Sets the planes of compact sources that are windows, by their ids; from the next update on.
    pub fn set_planes(&mut self, planes: &[(u32, LampPlane)]) {
        if let Dome::Adaptive(dome) = &mut self.dome {
            dome.set_planes(planes);
        }
    }

    /// Sets the factors, RGB, on clipped pixels, for sources near the given directions (unit vectors from
    /// the observer); they hold from the next update on, with [`ClippedEnergy::Measured`] and a
    /// camera that does not move.
    pub fn set_clipped_factors(&mut self, factors: impl Iterator<Item = (Vec3, Vec3)>) {
        self.raised.set(factors);
    }

    /// Sets the lamps that the observer does not see; they hold from the next update on, with
    /// [`LightPlacement::Adaptive`].
    pub fn set_unseen(&mut self, lamps: impl IntoIterator<Item = UnseenLamp>) {
        self.unseen.clear();
        if self.settings.placement == LightPlacement::Adaptive {
            self.unseen.extend(lamps);
        }
    }

    /// Returns the point from which the environment is seen, world, metres; `None` while a sphere
    /// in the scene has not been seen, and for a stated map.
    #[must_use]
    pub fn observer(&self) -> Option<DVec3> {
        match self.view.as_ref()? {
            EnvironmentView::Fisheye {
                world_from_camera, ..
            } => Some(world_from_camera.translation),
            EnvironmentView::Sphere { sphere, .. } => Some(sphere.centre_in_world),
            EnvironmentView::SphereInScene { .. } => self.last_sphere.view.map(|view| view.centre),
        }
    }

    fn viewpoints(&self) -> Viewpoints {
        Viewpoints {
            observer: self.observer().unwrap_or(self.reference),
            mirrored: self.mirrored_view(),
            reference: self.reference,
        }
    }

    /// Returns the mirrored sphere in which the environment is seen, and from where.
    const fn mirrored_view(&self) -> Option<MirroredView> {
        match self.view.as_ref() {
            Some(EnvironmentView::Sphere {
                world_from_camera,
                sphere,
                ..
            }) => Some(MirroredView {
                eye: world_from_camera.translation,
                centre: sphere.centre_in_world,
                radius: sphere.radius,
            }),
            Some(EnvironmentView::SphereInScene { .. }) => self.last_sphere.view,
            Some(EnvironmentView::Fisheye { .. }) | None => None,
        }
    }

    /// Changes placement and number of lights while running, without affecting other settings.
    pub fn set_lights(&mut self, placement: LightPlacement, lights: usize) {
        if (self.settings.placement, self.settings.lights) != (placement, lights) {
            self.settings.placement = placement;
            self.settings.lights = lights;
            self.dome = Dome::new(&self.settings, &self.fine);
        }
    }

    /// Estimates the light of one instant.
    ///
    /// # Errors
    /// No picture is given, a picture does not have the calibrated size, or the scene camera's pose
    /// is needed and not known.
    pub fn update(&mut self, input: &EnvironmentInput) -> Result<Arc<Lighting>, EnvironmentError> {
        self.stages.begin();
        let mut brackets = input.brackets.to_vec();
        brackets.sort_by(|a, b| b.ev.total_cmp(&a.ev));
        let (mut sources, residual, full) = match self.placed {
            View::Fixed(_) => self.observe_fixed(&brackets, input)?,
            View::Moving(_) => self.observe_moving(&brackets, input)?,
            View::Stated(_) => self.observe_stated(),
        };
        let to_environment = input.gains.inverse();
        let unseen = self.unseen.iter();
        sources.extend(unseen.map(|lamp| Source::of_unseen(lamp, to_environment)));
        Ok(Arc::new(self.light(&sources, residual, full, input)))
    }

    /// Returns the sources, the cube without them and the cube with them, in the camera's units.
    fn observe_fixed(
        &mut self,
        brackets: &[Bracket],
        input: &EnvironmentInput,
    ) -> Result<SeparatedSources, EnvironmentError> {
        let View::Fixed(fixed) = &self.placed else {
            return Ok(SeparatedSources::default());
        };
        let (pixels, table) = (&fixed.pixels, &fixed.table);
        check_sizes(brackets, (pixels.width, pixels.height))?;
        merge(
            &self.merger,
            brackets,
            pixels,
            self.per_reflectance,
            &mut self.radiance,
            &mut self.clipped,
        );
        boost(
            &self.settings.clipped,
            pixels,
            &mut self.radiance,
            &self.clipped,
            input,
            None,
        );
        if matches!(self.settings.clipped, ClippedEnergy::Measured { .. }) {
            self.raised.raise(pixels, &mut self.radiance, &self.clipped);
        }
        table.apply(&self.radiance, &mut self.measured);
        self.coverage.clone_from(&table.coverage);
        self.stages.done("gather");
        let samples = SampleGrid {
            directions: &pixels.directions,
            solid_angles: &pixels.solid_angles,
            layout: Layout::Picture(pixels.width),
        };
        let full = self.measured.clone();
        let mut sources = find(&mut self.finder, samples, &self.radiance, &self.settings);
        for source in &mut sources {
            source.note_clipped(&self.clipped);
            source.recentre(&self.clipped, pixels, &self.raised);
            complete(source, samples, &self.radiance);
        }
        if sources.is_empty() {
            return Ok((sources, full.clone(), full));
        }
        self.residual.clone_from(&self.radiance);
        subtract_sources(&sources, &pixels.solid_angles, &mut self.residual);
        let mut residual = Vec::new();
        table.apply(&self.residual, &mut residual);
        self.stages.done("sources");
        Ok((sources, residual, full))
    }

    /// The same for a stated map.
    fn observe_stated(&mut self) -> SeparatedSources {
        let View::Stated(texels) = &self.placed else {
            return SeparatedSources::default();
        };
        let full = texels.clone();
        self.measured.clone_from(&full);
        let samples = SampleGrid {
            directions: &self.grid.directions,
            solid_angles: &self.grid.solid_angles,
            layout: Layout::Cube(&self.neighbours),
        };
        let sources = find(&mut self.finder, samples, &full, &self.settings);
        let mut residual = full.clone();
        subtract_sources(&sources, &self.grid.solid_angles, &mut residual);
        self.stages.done("sources");
        (sources, residual, full)
    }

    fn light(
        &mut self,
        sources: &[Source],
        mut residual: Vec<Vec3>,
        mut full: Vec<Vec3>,
        input: &EnvironmentInput,
    ) -> Lighting {
        self.to_scene_units(&mut residual, input.gains);
        self.to_scene_units(&mut full, input.gains);
        // Filled from the surroundings, but not from a lamp next to an unseen region.
        let around = self.fill_unseen(&residual);
        let ground_radiance = input
            .ground_radiance
            .unwrap_or_else(|| self.reflected_by_ground(sources, &residual, &around, input.gains));
        let residual = self.filled(&residual, &around, ground_radiance);
        let mut full = self.filled(&full, &around, ground_radiance);
        self.add_hidden(&mut full, sources, input.gains);
        self.stages.done("fill");
        let fine = shrink(self.grid.size, &residual);
        let directions = match &self.placed {
            View::Fixed(fixed) => &fixed.pixels.directions,
            View::Moving(_) | View::Stated(_) => &self.grid.directions,
        };
        let views = self.viewpoints();
        let (lights, irradiance) = match &mut self.dome {
            Dome::Adaptive(dome) => (
                dome.update(
                    (sources, &views),
                    directions,
                    input.gains,
                    &fine,
                    &self.fine,
                ),
                self.settings
                    .irradiance(&self.harmonics, &self.grid, &residual),
            ),
            Dome::Grid(dome) => (
                dome.lights(&shrink(self.grid.size, &full), &self.fine),
                self.settings.irradiance(&self.harmonics, &self.grid, &full),
            ),
        };
        self.stages.done("lights");
        self.generation += 1;
        let filling = Filling {
            full: &full,
            around: &around,
            ground_radiance,
        };
        let faces = self.face_light(input.gains, &filling, sources);
        let followed = match &self.dome {
            Dome::Adaptive(dome) => dome.sources(),
            Dome::Grid(_) => Vec::new(),
        };
        let (places, full) = self.moved_sources(full, &residual, &followed, &views);
        let radiance = Arc::new(self.radiance_map(&full, &residual, &places, input));
        self.stages.done("prefilter");
        Lighting {
            captured_at: input.captured_at,
            generation: self.generation,
            radiance,
            irradiance,
            lights: pinned(lights, &irradiance, self.settings.ground),
            ground_radiance,
            faces,
        }
    }

    /// Returns the ground's radiance by its default albedo and the light that reaches it.
    fn reflected_by_ground(
        &self,
        sources: &[Source],
        residual: &[Vec3],
        around: &[Vec3],
        gains: Mat3,
    ) -> Vec3 {
        let seen = ground_irradiance(&self.filled(residual, around, Vec3::ZERO), &self.grid);
        let on_ground = |s: &Source| gains * s.flux * s.direction.z.max(0.0);
        let irradiance = sources.iter().map(on_ground).sum::<Vec3>() + seen;
        irradiance * (self.settings.fallback_ground_albedo / std::f32::consts::PI)
    }

    /// Adds what something hides of the sources to a complete sphere, scene camera units.
    fn add_hidden(&self, texels: &mut [Vec3], sources: &[Source], gains: Mat3) {
        for (direction, flux) in sources.iter().flat_map(|s| &s.hidden) {
            let i = texel_of(self.grid.size, *direction);
            texels[i] += gains * *flux / self.grid.solid_angles[i];
        }
    }

    fn to_scene_units(&self, texels: &mut [Vec3], gains: Mat3) {
        for texel in texels {
            *texel = (gains * *texel).max(Vec3::ZERO);
        }
    }

    /// Returns a smooth continuation of the seen texels over the unseen ones.
    fn fill_unseen(&self, texels: &[Vec3]) -> Vec<Vec3> {
        let lowest = if self.ground_below() {
            GROUND_FROM
        } else {
            -1.0
        };
        let mut around = inpaint(self.grid.size, texels, &self.coverage, &self.grid);
        let unseen: Vec<usize> = (0..around.len())
            .filter(|&i| self.coverage[i] < 0.5 && self.grid.directions[i].z > lowest)
            .collect();
        for _ in 0..SMOOTHING_ITERATIONS {
            for &i in &unseen {
                let near = self.neighbours[i].iter().map(|&k| around[k as usize]);
                around[i] = near.sum::<Vec3>() / 8.0;
            }
        }
        around
    }

    /// Returns the complete sphere: `around` where nothing is seen, and the ground below the
    /// horizon.
    fn filled(&self, texels: &[Vec3], around: &[Vec3], ground_radiance: Vec3) -> Vec<Vec3> {
        let rows = texels.iter().zip(&self.coverage).enumerate();
        rows.map(|(i, (texel, coverage))| {
            self.unseen(i, around, ground_radiance)
                .lerp(*texel, coverage.clamp(0.0, 1.0))
        })
        .collect()
    }

    /// Returns the radiance assumed for the unseen part of a texel.
    fn unseen(&self, texel: usize, around: &[Vec3], ground_radiance: Vec3) -> Vec3 {
        let up = if self.ground_below() {
            smoothstep(GROUND_FROM, 0.02, self.grid.directions[texel].z)
        } else {
            1.0
        };
        ground_radiance.lerp(around[texel], up)
    }

    /// Whether unseen directions below the horizon are assumed to be ground.
    const fn ground_below(&self) -> bool {
        self.settings.ground || matches!(self.view, Some(EnvironmentView::Fisheye { .. }))
    }
}

/// Sources, the cube without them, the cube with them.
type SeparatedSources = (Vec<Source>, Vec<Vec3>, Vec<Vec3>);

impl EnvironmentSettings {
    fn irradiance(&self, table: &HarmonicsTable, grid: &CubeGrid, texels: &[Vec3]) -> Harmonics {
        let mut harmonics = match self.irradiance {
            IrradianceMethod::Harmonics => table.project(texels),
            IrradianceMethod::Blurred => return blurred(table, texels, BLUR_SIGMA),
        };
        if self.ground {
            let exact = ground_irradiance(texels, grid);
            let difference = exact - unclamped_up(&harmonics);
            pin_upward(&mut harmonics, difference);
        }
        harmonics
    }
}

fn unclamped_up(h: &Harmonics) -> Vec3 {
    h.coefficients[0] + h.coefficients[2] + h.coefficients[6] * 2.0
}

/// Scales the cells' irradiance on the ground to exactly that of [`Lighting::irradiance`], so that
/// a point in the shadow of everything gets no light.
fn pinned(mut lights: Vec<DomeLight>, irradiance: &Harmonics, ground: bool) -> Vec<DomeLight> {
    use super::light::LightKind::Cell;
    if !ground {
        return lights;
    }
    let cells = || lights.iter().filter(|l| l.kind == Cell);
    let sum: Vec3 = cells().map(|l| l.irradiance * l.direction.z.max(0.0)).sum();
    let target = irradiance.irradiance(Vec3::Z);
    let scale = Vec3::select(sum.cmpgt(Vec3::splat(1e-12)), target / sum, Vec3::ONE);
    for light in lights.iter_mut().filter(|l| l.kind == Cell) {
        light.irradiance *= scale;
    }
    lights
}

fn checked_grid(settings: &EnvironmentSettings) -> Result<CubeGrid, EnvironmentError> {
    let size = settings.cube_size;
    if !size.is_power_of_two() || !(16..=512).contains(&size) {
        return Err(EnvironmentError::CubeSize(size));
    }
    Ok(CubeGrid::new(size))
}

fn place_view(
    view: &EnvironmentView,
    settings: &EnvironmentSettings,
    hidden: Option<&Hidden>,
    grid: &CubeGrid,
) -> Result<View, EnvironmentError> {
    if let EnvironmentView::SphereInScene { .. } = view {
        return Ok(View::Moving(Box::new(RadianceAccumulator::new(grid))));
    }
    let placed =
        PlacedView::new(view, None, settings.parallax).ok_or(EnvironmentError::InsideSphere)?;
    let pixels = PixelDirections::new(&placed, hidden);
    let table = GatherTable::new(&placed, &pixels.solid_angles, grid.size, MAX_SAMPLES);
    Ok(View::Fixed(Box::new(FixedView { pixels, table })))
}

fn per_reflectance(view: &EnvironmentView) -> Vec3 {
    match view {
        EnvironmentView::Fisheye { .. } => Vec3::ONE,
        EnvironmentView::Sphere { sphere, .. } | EnvironmentView::SphereInScene { sphere } => {
            Vec3::from(sphere.reflectance)
                .max(Vec3::splat(0.01))
                .recip()
        }
    }
}

fn check_sizes(brackets: &[Bracket], (width, height): (u32, u32)) -> Result<(), EnvironmentError> {
    if brackets.is_empty() {
        return Err(EnvironmentError::NoPicture);
    }
    for Bracket { picture, .. } in brackets {
        let is_complete = picture.rgba.len() >= 4 * width as usize * height as usize;
        if (picture.width, picture.height) != (width, height) || !is_complete {
            return Err(EnvironmentError::PictureSize {
                width,
                height,
                got_width: picture.width,
                got_height: picture.height,
            });
        }
    }
    Ok(())
}

fn merge(
    merger: &BracketMerger,
    brackets: &[Bracket],
    pixels: &PixelDirections,
    per_reflectance: Vec3,
    radiance: &mut Vec<Vec3>,
    clipped: &mut Vec<u32>,
) {
    let scales = scales(brackets);
    radiance.clear();
    clipped.clear();
    radiance.extend(pixels.solid_angles.iter().enumerate().map(|(i, &w)| {
        if w == 0.0 {
            return Vec3::ZERO;
        }
        let (value, is_clipped) = merger.pixel(brackets, &scales, i);
        if is_clipped {
            clipped.push(i as u32);
        }
        value * per_reflectance
    }));
}

fn find(
    finder: &mut SourceFinder,
    samples: SampleGrid,
    radiance: &[Vec3],
    settings: &EnvironmentSettings,
) -> Vec<Source> {
    if settings.placement == LightPlacement::Grid {
        return Vec::new();
    }
    let max_sources = settings.sources.max_sources.min(settings.lights / 3);
    let limits = SourceSettings {
        max_sources,
        ..settings.sources
    };
    finder.find(samples, radiance, settings.ground, &limits)
}

/// Leaves only the background at the sources.
fn subtract_sources(sources: &[Source], solid_angles: &[f32], radiance: &mut [Vec3]) {
    for (i, flux) in sources.iter().flat_map(|s| &s.parts) {
        let i = *i as usize;
        radiance[i] -= *flux / solid_angles[i].max(f32::MIN_POSITIVE);
    }
}

fn shrink(mut size: u32, texels: &[Vec3]) -> Vec<Vec3> {
    let mut small = texels.to_vec();
    while size > FINE_SIZE {
        small = halve(size, &small);
        size /= 2;
    }
    small
}

mod faces;
mod glossy;
mod moving;
mod queries;

#[cfg(test)]
mod tests;
