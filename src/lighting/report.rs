//! The estimated light as files: `penumbra light`.

use super::ClippedEnergy;
use super::adaptive::CompactSource;
use super::circle::Circle;
use super::equirect::{Equirect, preview};
use super::estimator::EnvironmentEstimator;
use super::hdr::Bracket;
use super::lamp_distance::SeenLamp;
use super::light::{DomeLight, LightKind, Lighting};
use super::photograph::{
    PhotographCalibration, PhotographError, PhotographKind, SurroundingsCircle, read_picture,
};
use super::place::LightPlace;
use super::settings::{EnvironmentError, EnvironmentInput, EnvironmentSettings};
use super::sources::{LUMINANCE, SourceSettings};
use glam::{DVec2, Mat3, Vec3};
use penumbra_camera::EnvironmentView;
use penumbra_camera::PinholeCamera;
use penumbra_camera::PlacedView;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_picture::{Picture, write_whole};
use serde::Serialize;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Rows of the equirectangular map.
const ROWS: u32 = 512;
/// Factor on clipped pixels of a single photograph: a lamp's true brightness is unknown, but far
/// above the picture's white.
const CLIPPED_FACTOR: f32 = 30.0;

/// Light, and the map from which it was estimated.
pub struct LightReport {
    /// Lights, irradiance and radiance map.
    pub lighting: Arc<Lighting>,
    /// The environment at the picture's own resolution; unseen directions are filled from the
    /// radiance map.
    pub map: Equirect,
    /// Pixels that every exposure clipped.
    pub clipped_pixels: usize,
    /// Unit vector towards the strongest compact source, or, if there is none, the mean of all
    /// light.
    pub dominant_direction: Vec3,
    /// Lamps, windows, the sun: as the environment camera sees them, strongest first.
    pub lamps: Vec<SeenLamp>,
    /// In a photograph: where it shows its surroundings, and the photograph with that circle drawn.
    pub photograph: Option<(SurroundingsCircle, Picture)>,
}

/// Green, for the circle in a photograph.
const CIRCLE: [u8; 3] = [60, 255, 90];
/// Points by which that circle is drawn.
const RIM_POINTS: u32 = 720;

/// Returns the photograph with its circle, and how sure that is.
fn drawn(picture: &Picture, found: &SurroundingsCircle) -> Picture {
    let Circle { centre, radius } = found.circle;
    let mut drawn = picture.clone();
    let around = (0..=RIM_POINTS).map(|k| {
        let turn = std::f64::consts::TAU * f64::from(k) / f64::from(RIM_POINTS);
        Some((centre + DVec2::from_angle(turn) * radius).to_array())
    });
    drawn.draw_line(around, CIRCLE);
    let how_sure = found.visible.map_or_else(
        || "as stated".to_owned(),
        |visible| format!("{:.0} % visible", 100.0 * visible),
    );
    let label = format!("{}: {how_sure}", found.kind.name());
    drawn.draw_label([centre.x, centre.y + 1.03 * radius], &label, CIRCLE);
    drawn
}

/// Returns settings for a photograph without brackets: clipped pixels are raised, unless they cover
/// so much that they are the sky.
#[must_use]
pub fn photograph_settings(calibration: &PhotographCalibration) -> EnvironmentSettings {
    EnvironmentSettings {
        ground: calibration.ground,
        clipped: ClippedEnergy::Factor {
            factor: CLIPPED_FACTOR,
            max_solid_angle: 0.6,
        },
        // Clipped cloud next to the sun is not part of the sun.
        sources: SourceSettings {
            gap: 0.0,
            ..SourceSettings::default()
        },
        ..EnvironmentSettings::default()
    }
}

/// Errors between a picture and the report's files.
#[derive(Debug, thiserror::Error)]
pub enum LightReportError {
    /// The photograph or its calibration is invalid.
    #[error(transparent)]
    Photograph(#[from] PhotographError),
    /// The estimate failed.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// A file could not be written.
    #[error("cannot write {path}: {reason}")]
    Write {
        /// The file.
        path: PathBuf,
        /// The cause.
        reason: String,
    },
}

/// Shares of the time that have passed when a photograph is read, its circle found, the tables made, and the
/// light estimated; the rest is the report. As measured on photographs of 2 to 16 megapixels.
const READ: f64 = 0.05;
const FOUND: f64 = 0.15;
const TABLES: f64 = 0.85;
const ESTIMATE: f64 = 0.9;

impl LightReport {
    /// Estimates the light of a single photograph (`penumbra light IMAGE`). Calls `progress` with the share of
    /// the time that has passed, 0 to 1, after each stage that takes long.
    ///
    /// # Errors
    /// A file cannot be read, the calibration is invalid, or no circle is found.
    pub fn from_photograph(
        image: &Path,
        kind: Option<PhotographKind>,
        calibration: Option<&Path>,
        progress: impl Fn(f64),
    ) -> Result<Self, LightReportError> {
        let mut calibration = match calibration {
            Some(path) => PhotographCalibration::read(path)?,
            None => PhotographCalibration::default(),
        };
        calibration.kind = kind.or(calibration.kind);
        let picture = read_picture(image)?;
        progress(READ);
        Self::from_picture(&picture, &calibration, progress)
    }

    /// The same with the picture in memory.
    ///
    /// # Errors
    /// As [`Self::from_photograph`].
    pub fn from_picture(
        picture: &Picture,
        calibration: &PhotographCalibration,
        progress: impl Fn(f64),
    ) -> Result<Self, LightReportError> {
        let found = calibration.circle(picture)?;
        progress(FOUND);
        let view = calibration.view(picture, &found)?;
        let settings = photograph_settings(calibration);
        let brackets = [Bracket { picture, ev: 0.0 }];
        let input = EnvironmentInput::new(&brackets, MonotonicTime::default());
        let mut estimator =
            EnvironmentEstimator::new(&view, &calibration.response(), settings, None)?;
        progress(TABLES);
        let lighting = estimator.update(&input)?;
        let report = Self::from_estimator(&estimator, lighting, &view, input.scene, input.gains)?;
        progress(ESTIMATE);
        Ok(Self {
            photograph: Some((found, drawn(picture, &found))),
            ..report
        })
    }

    /// Reports the state of an estimator of `view` after its last update, which returned `lighting`
    /// with `gains`, and used `scene` if the sphere is in the scene camera's picture.
    ///
    /// # Errors
    /// The camera is inside the mirrored sphere, or `scene` is needed and missing.
    pub fn from_estimator(
        estimator: &EnvironmentEstimator,
        lighting: Arc<Lighting>,
        view: &EnvironmentView,
        scene: Option<(RigidTransform, &PinholeCamera)>,
        gains: Mat3,
    ) -> Result<Self, LightReportError> {
        let placed = PlacedView::new(view, scene, estimator.settings().parallax)
            .ok_or(EnvironmentError::InsideSphere)?;
        Ok(Self {
            map: unwrap_view(&placed, estimator, &lighting, gains),
            clipped_pixels: estimator.clipped_pixels(),
            dominant_direction: dominant_direction(estimator, &lighting),
            lamps: estimator.lamps(),
            lighting,
            photograph: None,
        })
    }

    /// Reports the light of a stated map, after the last update, which returned `lighting`.
    #[must_use]
    pub fn of_map(estimator: &EnvironmentEstimator, lighting: Arc<Lighting>) -> Self {
        Self {
            map: Equirect::from_cube(&lighting.radiance, ROWS),
            clipped_pixels: 0,
            dominant_direction: dominant_direction(estimator, &lighting),
            lamps: estimator.lamps(),
            lighting,
            photograph: None,
        }
    }

    /// Writes `environment.exr`, `environment.png`, `lights.png`, `light.json` and, of a photograph,
    /// `found.png` into a folder, which is created if necessary.
    ///
    /// # Errors
    /// The folder or a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), LightReportError> {
        std::fs::create_dir_all(folder).map_err(|e| write_error(folder, e))?;
        self.write_exr(&folder.join("environment.exr"))?;
        write_png(&self.map.to_picture(), &folder.join("environment.png"))?;
        write_png(&preview(&self.lighting, ROWS), &folder.join("lights.png"))?;
        if let Some((_, drawn)) = &self.photograph {
            write_png(drawn, &folder.join("found.png"))?;
        }
        let path = folder.join("light.json");
        let text =
            serde_json::to_string_pretty(&self.summary()).map_err(|e| write_error(&path, e))?;
        whole(&path, |part| std::fs::write(part, text + "\n"))
    }

    fn write_exr(&self, path: &Path) -> Result<(), LightReportError> {
        let (width, map) = (self.map.width as usize, &self.map.texels);
        let height = self.map.height as usize;
        whole(path, |part| {
            let texel = |x: usize, y: usize| {
                let t = map[y * width + x];
                (t.x, t.y, t.z)
            };
            exr::prelude::write_rgb_file(part, width, height, texel).map_err(io::Error::other)
        })
    }

    fn summary(&self) -> Summary {
        let lighting = &self.lighting;
        let compact = || {
            lighting
                .lights
                .iter()
                .filter(|l| l.kind == LightKind::Compact)
        };
        let axis = |n: Vec3| {
            let from_compact: Vec3 = compact()
                .map(|l| l.irradiance * l.direction.dot(n).max(0.0))
                .sum();
            (lighting.irradiance.irradiance(n) + from_compact).to_array()
        };
        let direction = self.dominant_direction;
        Summary {
            version: 1,
            conventions: "world +Z up; linear Rec.709; directions point towards the light; equirect: phi = 2 pi (0.5 - (u + 0.5) / W), theta = pi (v + 0.5) / H from +Z",
            dominant_direction: Direction::new(direction),
            irradiance: Axes {
                plus_x: axis(Vec3::X),
                minus_x: axis(Vec3::NEG_X),
                plus_y: axis(Vec3::Y),
                minus_y: axis(Vec3::NEG_Y),
                plus_z: axis(Vec3::Z),
                minus_z: axis(Vec3::NEG_Z),
            },
            harmonics_without_compact_sources: lighting
                .irradiance
                .coefficients
                .map(|c| c.to_array()),
            compact_sources: lighting
                .radiance
                .compact_sources
                .iter()
                .map(|source| SourceEntry {
                    direction: source.direction.to_array(),
                    irradiance: source.flux.to_array(),
                    angular_radius_degrees: source.radius.to_degrees(),
                    place: PlaceEntry::new(source.direction, &source.place),
                })
                .collect(),
            lamps: self
                .lamps
                .iter()
                .map(|lamp| LampEntry::new(&lamp.source))
                .collect(),
            dome_lights: lighting
                .lights
                .iter()
                .filter(|l| l.irradiance != Vec3::ZERO)
                .map(LightEntry::new)
                .collect(),
            clipped_pixels: self.clipped_pixels,
            photograph: self.photograph.as_ref().map(|(found, _)| PhotographEntry {
                kind: found.kind,
                centre: found.circle.centre.to_array(),
                radius: found.circle.radius,
                visible_share: found.visible,
            }),
        }
    }
}

/// Returns the direction of the strongest compact source, or, if there is none, of the mean of all
/// light.
#[must_use]
pub fn dominant_direction(estimator: &EnvironmentEstimator, lighting: &Lighting) -> Vec3 {
    let all = || -> Vec3 {
        let lights = lighting.lights.iter();
        lights
            .map(|l| l.direction * l.irradiance.dot(LUMINANCE))
            .sum()
    };
    let strongest = estimator.sources().first().map(|s| s.direction);
    strongest.unwrap_or_else(|| all().try_normalize().unwrap_or(Vec3::Z))
}

#[derive(Serialize)]
struct Summary {
    version: u32,
    conventions: &'static str,
    dominant_direction: Direction,
    irradiance: Axes,
    harmonics_without_compact_sources: [[f32; 3]; 9],
    compact_sources: Vec<SourceEntry>,
    lamps: Vec<LampEntry>,
    dome_lights: Vec<LightEntry>,
    clipped_pixels: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    photograph: Option<PhotographEntry>,
}

#[derive(Serialize)]
struct PhotographEntry {
    kind: PhotographKind,
    centre: [f64; 2],
    radius: f64,
    visible_share: Option<f64>,
}

#[derive(Serialize)]
struct Direction {
    vector: [f32; 3],
    azimuth_degrees: f32,
    elevation_degrees: f32,
}

impl Direction {
    fn new(d: Vec3) -> Self {
        Self {
            vector: d.to_array(),
            azimuth_degrees: d.y.atan2(d.x).to_degrees(),
            elevation_degrees: d.z.clamp(-1.0, 1.0).asin().to_degrees(),
        }
    }
}

#[derive(Serialize)]
struct Axes {
    plus_x: [f32; 3],
    minus_x: [f32; 3],
    plus_y: [f32; 3],
    minus_y: [f32; 3],
    plus_z: [f32; 3],
    minus_z: [f32; 3],
}

#[derive(Serialize)]
struct LightEntry {
    kind: &'static str,
    direction: [f32; 3],
    irradiance: [f32; 3],
    angular_radius_degrees: f32,
    /// Where a near light is, world, metres; direction and irradiance are those at `reference`.
    #[serde(skip_serializing_if = "Option::is_none")]
    place: Option<PlaceEntry>,
}

#[derive(Serialize)]
struct PlaceEntry {
    position: [f32; 3],
    distance: f32,
    reference: [f32; 3],
}

impl PlaceEntry {
    /// Of a light in a direction from the place's reference; `None` if it is far.
    fn new(direction: Vec3, place: &LightPlace) -> Option<Self> {
        Some(Self {
            position: place.position(direction)?.to_array(),
            distance: place.inverse_distance.recip(),
            reference: place.reference.to_array(),
        })
    }
}

/// A lamp as the environment camera sees it; the names are those of `lighting.lamps` of the status.
#[derive(Serialize)]
struct LampEntry {
    direction: [f32; 3],
    position: Option<[f64; 3]>,
    distance_m: Option<f32>,
    distance_sigma_m: Option<f32>,
    clipped: f32,
    unseen: bool,
}

impl LampEntry {
    fn new(source: &CompactSource) -> Self {
        let metres = source.distance.metres();
        Self {
            direction: source.direction.to_array(),
            position: source.position.map(|at| at.to_array()),
            distance_m: metres.map(|(away, _)| away),
            distance_sigma_m: metres.map(|(_, sigma)| sigma),
            clipped: source.clipped.clamp(0.0, 1.0),
            unseen: source.is_unseen,
        }
    }
}

/// A lamp, a window, the sun, as it lights the objects.
#[derive(Serialize)]
struct SourceEntry {
    direction: [f32; 3],
    irradiance: [f32; 3],
    angular_radius_degrees: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    place: Option<PlaceEntry>,
}

impl LightEntry {
    fn new(light: &DomeLight) -> Self {
        Self {
            kind: match light.kind {
                LightKind::Compact => "compact",
                LightKind::Cell => "cell",
            },
            direction: light.direction.to_array(),
            irradiance: light.irradiance.to_array(),
            angular_radius_degrees: light.angular_radius.to_degrees(),
            place: PlaceEntry::new(light.direction, &light.place),
        }
    }
}

fn unwrap_view(
    view: &PlacedView,
    estimator: &EnvironmentEstimator,
    lighting: &Lighting,
    gains: Mat3,
) -> Equirect {
    Equirect::from_fn(ROWS, |d| {
        let at = view
            .pixel(d.as_dvec3())
            .and_then(|p| estimator.pixel_radiance(p));
        at.map_or_else(
            || super::cube::sample(&lighting.radiance, 0, d),
            |l| (gains * l).max(Vec3::ZERO),
        )
    })
}

impl EnvironmentEstimator {
    /// Returns the linear value of the last merged picture between pixels, environment camera
    /// units.
    fn pixel_radiance(&self, p: DVec2) -> Option<Vec3> {
        let base = p.floor();
        let (fx, fy) = ((p.x - base.x) as f32, (p.y - base.y) as f32);
        let (x, y) = (base.x as i64, base.y as i64);
        let at = |x: i64, y: i64| self.merged_pixel(x, y);
        let top = at(x, y)?.lerp(at(x + 1, y)?, fx);
        let bottom = at(x, y + 1)?.lerp(at(x + 1, y + 1)?, fx);
        Some(top.lerp(bottom, fy))
    }
}

fn write_png(picture: &Picture, path: &Path) -> Result<(), LightReportError> {
    whole(path, |part| {
        let (width, height) = (picture.width, picture.height);
        let (colour, format) = (image::ColorType::Rgba8, image::ImageFormat::Png);
        image::save_buffer_with_format(part, &picture.rgba, width, height, colour, format)
            .map_err(io::Error::other)
    })
}

/// Writes a file that is either complete or absent.
fn whole(path: &Path, write: impl FnOnce(&Path) -> io::Result<()>) -> Result<(), LightReportError> {
    write_whole(path, write).map_err(|e| write_error(path, e))
}

fn write_error(path: &Path, reason: impl std::fmt::Display) -> LightReportError {
    LightReportError::Write {
        path: path.to_owned(),
        reason: reason.to_string(),
    }
}
