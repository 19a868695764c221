//! Pictures of the environment camera in, light out, frame by frame.

use super::adaptive::{AdaptiveDome, CompactSource};
use super::clipped::boost;
use super::cube::{CubeGrid, halve, texel_of};
use super::dome::{DomeGrid, ground_irradiance};
use super::harmonics::{HarmonicsTable, blurred, pin_upward};
use super::hdr::{Bracket, BracketMerger, scales};
use super::light::{DomeLight, Harmonics, Lighting};
use super::memory::DirectionMemory;
use super::prefilter::Prefilter;
use super::probe::LastBall;
use super::resample::{GatherTable, Hidden, PixelDirections, inpaint};
use super::settings::{
    EnvironmentError, EnvironmentInput, EnvironmentSettings, IrradianceMethod, LightPlacement,
};
use super::shadow_ratio::{Ground, clipped_factor};
use super::sources::{LUMINANCE, Layout, SampleGrid, Source, SourceFinder, SourceSettings};
use super::stages::Stages;
use faces::{FaceTable, Filling};
use glam::{Mat3, Vec3};
use penumbra_camera::EnvironmentView;
use penumbra_camera::PlacedView;
use penumbra_camera::Response;
use penumbra_camera::Vignetting;
use penumbra_interface::MonotonicTime;
use std::sync::Arc;

/// Side of the map that dome lights are made from.
const FINE_SIZE: u32 = 16;
/// Standard deviation of the paper's blur, radians: the cosine lobe's own width.
const BLUR_SIGMA: f32 = 0.75;
/// Height (z of the direction) from which downwards only ground is expected.
const GROUND_FROM: f32 = -0.06;
/// Rounds that smooth the guess of what is not seen.
const SMOOTHINGS: usize = 40;
/// Samples a side of a texel, at most: 24 are enough for pictures of 1000 pixels.
const FINEST: u32 = 24;

/// A view that stands still, and its tables.
struct FixedView {
    pixels: PixelDirections,
    table: GatherTable,
}

enum View {
    Fixed(Box<FixedView>),
    /// The sphere in the scene camera's picture; what was seen of each direction is kept.
    Moving(Box<DirectionMemory>),
}

/// Turns environment pictures into [`Lighting`]. Deterministic; keeps what must be
/// coherent in time.
pub struct EnvironmentEstimator {
    view: EnvironmentView,
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
    /// The measured cube, environment camera units, and how much of each texel is seen.
    measured: Vec<Vec3>,
    coverage: Vec<f32>,
    /// How far the texels of the newest picture of a sphere in the scene are to be believed, and
    /// which of its pixels are clipped.
    confidence: Vec<f32>,
    marks: Vec<bool>,
    last_ball: LastBall,
    generation: u64,
    /// How many times brighter than white clipped pixels are, by the scene's shadows.
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
    /// Builds all tables. `hidden` tells which rays from a camera that stands still end on
    /// phantoms; what is behind them is guessed from what is around.
    ///
    /// # Errors
    /// Impossible geometry or cube size.
    pub fn new(
        view: &EnvironmentView,
        response: &Response,
        settings: EnvironmentSettings,
        hidden: Option<&Hidden>,
    ) -> Result<Self, EnvironmentError> {
        let size = settings.cube_size;
        if !size.is_power_of_two() || !(16..=512).contains(&size) {
            return Err(EnvironmentError::CubeSize(size));
        }
        let grid = CubeGrid::new(size);
        let (fine, placed) = (
            CubeGrid::new(FINE_SIZE),
            place(view, &settings, hidden, &grid)?,
        );
        let mut estimator = Self {
            view: view.clone(),
            placed,
            merger: BracketMerger::new(response),
            per_reflectance: per_reflectance(view),
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
            marks: Vec::new(),
            last_ball: LastBall::default(),
            generation: 0,
            shadow_factor: None,
            neighbours: grid.neighbours(),
            grid,
            fine,
            settings,
            faces: None,
            stages: Stages::default(),
        };
        estimator.lay_faces(glam::Quat::IDENTITY);
        Ok(estimator)
    }

    /// Undoes the camera's fall-off towards the edge of its pictures of `size`.
    pub fn set_vignetting(&mut self, vignetting: &Vignetting, size: (u32, u32)) {
        self.merger.set_corrections(vignetting.corrections(size));
    }

    /// Settings in force.
    #[must_use]
    pub const fn settings(&self) -> &EnvironmentSettings {
        &self.settings
    }

    /// Changes placement and number of lights while running; the rest stays.
    pub fn set_lights(&mut self, placement: LightPlacement, lights: usize) {
        if (self.settings.placement, self.settings.lights) != (placement, lights) {
            self.settings.placement = placement;
            self.settings.lights = lights;
            self.dome = Dome::new(&self.settings, &self.fine);
        }
    }

    /// Reads the light of one instant.
    ///
    /// # Errors
    /// Pictures that do not fit the calibration; a missing pose where one is needed.
    pub fn update(&mut self, input: &EnvironmentInput) -> Result<Arc<Lighting>, EnvironmentError> {
        self.stages.begin();
        let mut brackets = input.brackets.to_vec();
        brackets.sort_by(|a, b| b.ev.total_cmp(&a.ev));
        let (sources, residual, full) = match self.placed {
            View::Fixed(_) => self.see_fixed(&brackets, input)?,
            View::Moving(_) => self.see_moving(&brackets, input)?,
        };
        Ok(Arc::new(self.light(&sources, residual, full, input)))
    }

    /// Sources, the cube without them and the cube with them, in the camera's units.
    fn see_fixed(
        &mut self,
        brackets: &[Bracket],
        input: &EnvironmentInput,
    ) -> Result<Seen, EnvironmentError> {
        let View::Fixed(fixed) = &self.placed else {
            return Ok(Seen::default());
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
        table.apply(&self.radiance, &mut self.measured);
        self.coverage.clone_from(&table.coverage);
        self.stages.done("gather");
        let samples = SampleGrid {
            directions: &pixels.directions,
            solid_angles: &pixels.solid_angles,
            layout: Layout::Picture(pixels.width),
        };
        let full = self.measured.clone();
        let sources = find(&mut self.finder, samples, &self.radiance, &self.settings);
        if sources.is_empty() {
            return Ok((sources, full.clone(), full));
        }
        self.residual.clone_from(&self.radiance);
        take_out(&sources, &pixels.solid_angles, &mut self.residual);
        let mut residual = Vec::new();
        table.apply(&self.residual, &mut residual);
        self.stages.done("sources");
        Ok((sources, residual, full))
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
        // Guessed from what is around, but not from a lamp next to what is not seen.
        let around = self.guess(&residual);
        let compact = |l: &Vec3| {
            sources
                .iter()
                .map(|s| input.gains * s.flux * s.direction.z.max(0.0))
                .sum::<Vec3>()
                + *l
        };
        let ground_radiance = input.ground_radiance.unwrap_or_else(|| {
            let seen = ground_irradiance(&self.filled(&residual, &around, Vec3::ZERO), &self.grid);
            compact(&seen) * (self.settings.fallback_ground_albedo / std::f32::consts::PI)
        });
        let residual = self.filled(&residual, &around, ground_radiance);
        let full = self.filled(&full, &around, ground_radiance);
        self.stages.done("fill");
        let fine = shrink(self.grid.size, &residual);
        let directions = match &self.placed {
            View::Fixed(fixed) => &fixed.pixels.directions,
            View::Moving(_) => &self.grid.directions,
        };
        let (lights, irradiance) = match &mut self.dome {
            Dome::Adaptive(dome) => (
                dome.update(sources, directions, input.gains, &fine, &self.fine),
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
        let radiance = Arc::new(self.radiance_map(&full, &residual, sources, input));
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

    fn to_scene_units(&self, texels: &mut [Vec3], gains: Mat3) {
        for texel in texels {
            *texel = (gains * *texel).max(Vec3::ZERO);
        }
    }

    /// A smooth continuation of what is seen over what is not.
    fn guess(&self, texels: &[Vec3]) -> Vec<Vec3> {
        let lowest = if self.ground_below() {
            GROUND_FROM
        } else {
            -1.0
        };
        let mut around = inpaint(self.grid.size, texels, &self.coverage, &self.grid);
        let unseen: Vec<usize> = (0..around.len())
            .filter(|&i| self.coverage[i] < 0.5 && self.grid.directions[i].z > lowest)
            .collect();
        for _ in 0..SMOOTHINGS {
            for &i in &unseen {
                let near = self.neighbours[i].iter().map(|&k| around[k as usize]);
                around[i] = near.sum::<Vec3>() / 8.0;
            }
        }
        around
    }

    /// The whole sphere: `around` where nothing is seen, and the ground below the horizon.
    fn filled(&self, texels: &[Vec3], around: &[Vec3], ground_radiance: Vec3) -> Vec<Vec3> {
        let rows = texels.iter().zip(&self.coverage).enumerate();
        rows.map(|(i, (texel, coverage))| {
            self.unseen(i, around, ground_radiance)
                .lerp(*texel, coverage.clamp(0.0, 1.0))
        })
        .collect()
    }

    /// What is taken to be at a texel as far as it is not seen.
    fn unseen(&self, texel: usize, around: &[Vec3], ground_radiance: Vec3) -> Vec3 {
        let up = if self.ground_below() {
            smoothstep(GROUND_FROM, 0.02, self.grid.directions[texel].z)
        } else {
            1.0
        };
        ground_radiance.lerp(around[texel], up)
    }

    /// Whether what is not seen below the horizon is taken to be ground.
    const fn ground_below(&self) -> bool {
        self.settings.ground || matches!(self.view, EnvironmentView::Fisheye { .. })
    }
}

/// Sources, the cube without them, the cube with them.
type Seen = (Vec<Source>, Vec<Vec3>, Vec<Vec3>);

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

/// Brings the cells' irradiance on the ground to exactly what [`Lighting::irradiance`]
/// says, so that a point in full shadow of everything gets exactly nothing.
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

fn place(
    view: &EnvironmentView,
    settings: &EnvironmentSettings,
    hidden: Option<&Hidden>,
    grid: &CubeGrid,
) -> Result<View, EnvironmentError> {
    if let EnvironmentView::SphereInScene { .. } = view {
        return Ok(View::Moving(Box::new(DirectionMemory::new(grid))));
    }
    let placed =
        PlacedView::new(view, None, settings.parallax).ok_or(EnvironmentError::InsideSphere)?;
    let pixels = PixelDirections::new(&placed, hidden);
    let table = GatherTable::new(&placed, &pixels.solid_angles, grid.size, FINEST);
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
        let whole = picture.rgba.len() >= 4 * width as usize * height as usize;
        if (picture.width, picture.height) != (width, height) || !whole {
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
    let most = settings.sources.most.min(settings.lights / 3);
    let limits = SourceSettings {
        most,
        ..settings.sources
    };
    finder.find(samples, radiance, settings.ground, &limits)
}

/// Leaves the background where the sources are.
fn take_out(sources: &[Source], solid_angles: &[f32], radiance: &mut [Vec3]) {
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

fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

mod faces;
mod glossy;
mod moving;
mod queries;

#[cfg(test)]
mod tests;
