//! The environment view of a single photograph: through a fisheye lens, or of a mirrored sphere.

use super::circle::{Circle, fisheye_circle, sphere_outline, visible_share};
use super::matt::is_matt;
use glam::{DMat3, DQuat, DVec2, DVec3};
use penumbra_camera::{EnvironmentView, FisheyeLens, MirrorSphere};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_interface::RigidTransform;
use penumbra_picture::{MAX_PICTURE_BYTES, Picture, PictureError, read_bounded, read_text_bounded};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use std::io;
use std::path::{Path, PathBuf};

/// The optics of a photograph.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum PhotographKind {
    /// A fisheye lens, looking up unless the calibration specifies otherwise.
    Fisheye,
    /// A mirrored sphere, photographed horizontally unless the calibration specifies otherwise.
    Sphere,
}

/// A calibration file (TOML or JSON). Everything is optional; without a circle in the file, it is
/// searched in the picture.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhotographCalibration {
    /// Fisheye or sphere.
    pub kind: Option<PhotographKind>,
    /// Centre of the circle, pixels; (0, 0) is the centre of the top-left pixel.
    pub centre: Option<[f64; 2]>,
    /// Radius of the image circle or of the sphere's outline, pixels.
    pub radius: Option<f64>,
    /// Fisheye: degrees across the image circle (default 180). Sphere: degrees of the directions
    /// that the sphere shows (default 360: photographed from far away).
    pub field_of_view_degrees: Option<f64>,
    /// Fisheye: k1..k4 of Kannala–Brandt.
    pub distortion: [f64; 4],
    /// Fisheye: pixels per radian on the axis; default from radius and field of view.
    pub focal: Option<f64>,
    /// Rows of the rotation from the camera (x right, y down, z forward) to the world
    /// (z up). The default looks up (fisheye) or along +Y (sphere).
    pub world_from_camera: Option<[[f64; 3]; 3]>,
    /// Upward rotation of the camera from its default (or `world_from_camera`), degrees.
    pub pitch_degrees: f64,
    /// Clockwise rotation of the camera about its axis, degrees.
    pub roll_degrees: f64,
    /// Sphere: linear reflectance per channel.
    pub reflectance: Option<[f32; 3]>,
    /// Tone curve as a power; default is sRGB's, 1 is linear.
    pub gamma: Option<f32>,
    /// The photograph's ground is phantom ground: directions below the horizon are ignored.
    pub ground: bool,
}

impl PhotographKind {
    /// Returns its name in sentences.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fisheye => "fisheye's image circle",
            Self::Sphere => "mirrored sphere",
        }
    }
}

/// Where a photograph shows its surroundings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurroundingsCircle {
    /// Image circle of a fisheye, or outline of a mirrored sphere.
    pub kind: PhotographKind,
    /// The circle.
    pub circle: Circle,
    /// Share of it that is visible as a round border, 0 to 1: how sure it is. `None` for a circle that the
    /// calibration states.
    pub visible: Option<f64>,
}

/// Minimum visible share of a circle that is taken for a fisheye's or a sphere's.
const MIN_VISIBLE: f64 = 0.72;
/// Minimum radius of such a circle, pixels.
const MIN_RADIUS: f64 = 16.0;

/// Errors of a photograph or its calibration.
#[derive(Debug, thiserror::Error)]
pub enum PhotographError {
    /// A file could not be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The file is not a picture.
    #[error("{path} is not a JPEG or PNG picture, or it is damaged: {source}")]
    Decode {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: PictureError,
    },
    /// The file is not a calibration.
    #[error("calibration {path}: {reason}")]
    Calibration {
        /// The file.
        path: PathBuf,
        /// The error and its position.
        reason: String,
    },
    /// No circle was found.
    #[error(
        "no circle found in the picture: set `centre` and `radius` (pixels) in a calibration file and pass it with --calibration FILE"
    )]
    NoCircle,
    /// The best circle is not the border of anything round.
    #[error(
        "no {} found in the picture: of the best circle, with its centre at ({:.0}, {:.0}) and a radius of {:.0} pixels, only {:.0} % is a round border. A mirrored sphere must fill half of the picture's height, a fisheye's circle must be surrounded by black. If the picture shows one, set `centre` and `radius` (pixels) in a calibration file and pass it with --calibration FILE",
        .0.kind.name(),
        .0.circle.centre.x,
        .0.circle.centre.y,
        .0.circle.radius,
        100.0 * .0.visible.unwrap_or_default()
    )]
    Doubtful(SurroundingsCircle),
    /// What is round mirrors nothing.
    #[error(
        "no mirrored sphere found in the picture: what is round, with its centre at ({:.0}, {:.0}) and a radius of {:.0} pixels, is shaded like something matt. If it is a mirror all the same, set `centre` and `radius` (pixels) in a calibration file and pass it with --calibration FILE",
        .0.centre.x,
        .0.centre.y,
        .0.radius
    )]
    Matt(Circle),
    /// A value is out of range.
    #[error("{key} = {value} is invalid: expected {expected}")]
    Value {
        /// The calibration's key.
        key: &'static str,
        /// The given value.
        value: f64,
        /// The allowed range.
        expected: &'static str,
    },
}

/// Maximum size of a calibration file, bytes.
const MAX_CALIBRATION_BYTES: u64 = 16 << 20;

impl PhotographCalibration {
    /// Reads a file, TOML unless its name ends in `.json`.
    ///
    /// # Errors
    /// The file cannot be read, is not TOML or JSON, or has unknown keys.
    pub fn read(path: &Path) -> Result<Self, PhotographError> {
        let text = read_text_bounded(path, MAX_CALIBRATION_BYTES).map_err(|source| {
            PhotographError::Read {
                path: path.to_owned(),
                source,
            }
        })?;
        let json = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("json"));
        let parsed = if json {
            serde_json::from_str(&text).map_err(|e| e.to_string())
        } else {
            toml::from_str(&text).map_err(|e| e.to_string())
        };
        parsed.map_err(|reason| PhotographError::Calibration {
            path: path.to_owned(),
            reason,
        })
    }

    /// Returns the camera's tone curve.
    #[must_use]
    pub fn response(&self) -> Response {
        self.gamma.map_or_else(Response::srgb, Response::gamma)
    }

    /// Returns the circle in which a picture shows its surroundings. If the file does not give the
    /// kind, a picture with a round border to black is a fisheye's.
    ///
    /// # Errors
    /// No circle is given or found, the one that is found is doubtful, or a value is out of range.
    pub fn circle(&self, picture: &Picture) -> Result<SurroundingsCircle, PhotographError> {
        if let (Some([x, y]), Some(radius)) = (self.centre, self.radius) {
            return self.stated(picture, DVec2::new(x, y), radius);
        }
        let wanted = |kind| self.kind.is_none_or(|stated| stated == kind);
        let fisheye = || fisheye_circle(picture);
        let sphere = || {
            let circle = sphere_outline(picture)?;
            Some((circle, visible_share(picture, circle)))
        };
        let mut best: Option<SurroundingsCircle> = None;
        for (kind, find) in [
            (PhotographKind::Fisheye, &fisheye as &dyn Fn() -> _),
            (PhotographKind::Sphere, &sphere),
        ] {
            let Some((circle, visible)) = wanted(kind).then(find).flatten() else {
                continue;
            };
            let found = SurroundingsCircle {
                kind,
                circle,
                visible: Some(visible),
            };
            if circle.radius >= MIN_RADIUS && visible >= MIN_VISIBLE {
                if kind == PhotographKind::Sphere && is_matt(picture, circle) {
                    return Err(PhotographError::Matt(circle));
                }
                return Ok(found);
            }
            if best.is_none_or(|best| best.visible < found.visible) {
                best = Some(found);
            }
        }
        Err(best.map_or(PhotographError::NoCircle, PhotographError::Doubtful))
    }

    /// Returns the circle that the calibration states. Without a kind, a picture with a visible
    /// image circle is a fisheye's.
    fn stated(
        &self,
        picture: &Picture,
        centre: DVec2,
        radius: f64,
    ) -> Result<SurroundingsCircle, PhotographError> {
        if !(radius.is_finite() && radius >= 2.0) {
            return Err(PhotographError::Value {
                key: "radius",
                value: radius,
                expected: "pixels, at least 2",
            });
        }
        let kind = self.kind.unwrap_or_else(|| {
            let fisheye = fisheye_circle(picture);
            if fisheye.is_some_and(|(_, visible)| visible >= MIN_VISIBLE) {
                PhotographKind::Fisheye
            } else {
                PhotographKind::Sphere
            }
        });
        Ok(SurroundingsCircle {
            kind,
            circle: Circle { centre, radius },
            visible: None,
        })
    }

    /// Returns the view of a picture that shows its surroundings in a circle.
    ///
    /// # Errors
    /// A value is out of range.
    pub fn view(
        &self,
        picture: &Picture,
        found: &SurroundingsCircle,
    ) -> Result<EnvironmentView, PhotographError> {
        match found.kind {
            PhotographKind::Fisheye => self.fisheye(picture, found.circle),
            PhotographKind::Sphere => self.sphere(picture, found.circle),
        }
    }

    fn fisheye(
        &self,
        picture: &Picture,
        circle: Circle,
    ) -> Result<EnvironmentView, PhotographError> {
        let degrees = in_range(self.field_of_view_degrees.unwrap_or(180.0), 10.0, 340.0)?;
        let max_theta = degrees.to_radians() / 2.0;
        let lens = FisheyeLens {
            width: picture.width,
            height: picture.height,
            focal: self.focal.unwrap_or(circle.radius / max_theta),
            centre: circle.centre,
            distortion: self.distortion,
            max_theta,
        };
        let up = DMat3::IDENTITY;
        Ok(EnvironmentView::Fisheye {
            lens,
            world_from_camera: RigidTransform::new(self.rotation(up), DVec3::ZERO),
        })
    }

    /// A sphere of radius 1 at the distance D from which it shows `field_of_view_degrees`: the rays
    /// that graze it leave at π − asin(1/D) from the axis.
    fn sphere(
        &self,
        picture: &Picture,
        circle: Circle,
    ) -> Result<EnvironmentView, PhotographError> {
        let degrees = in_range(self.field_of_view_degrees.unwrap_or(360.0), 200.0, 360.0)?;
        let distance = 1.0 / (PI - degrees.to_radians() / 2.0).sin().max(1e-3);
        let forward = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
        let rotation = self.rotation(forward);
        let view_axis = rotation * DVec3::Z;
        let outline = (distance * distance - 1.0).sqrt();
        Ok(EnvironmentView::Sphere {
            camera: PinholeCamera {
                width: picture.width,
                height: picture.height,
                focal: DVec2::splat(circle.radius * outline),
                centre: circle.centre,
                distortion: [0.0; 5],
            },
            world_from_camera: RigidTransform::new(rotation, -view_axis * distance),
            sphere: MirrorSphere {
                centre_in_world: DVec3::ZERO,
                radius: 1.0,
                position_sigma: 0.0,
                reflectance: self.reflectance.unwrap_or([1.0; 3]),
                in_scene: false,
            },
        })
    }

    fn rotation(&self, default: DMat3) -> DQuat {
        let rows = self
            .world_from_camera
            .map(|rows| DMat3::from_cols_array_2d(&rows).transpose());
        let base = DQuat::from_mat3(&rows.unwrap_or(default)).normalize();
        let pitch = DQuat::from_rotation_x(self.pitch_degrees.to_radians());
        let roll = DQuat::from_rotation_z(self.roll_degrees.to_radians());
        base * pitch * roll
    }
}

fn in_range(value: f64, low: f64, high: f64) -> Result<f64, PhotographError> {
    if (low..=high).contains(&value) {
        return Ok(value);
    }
    Err(PhotographError::Value {
        key: "field_of_view_degrees",
        value,
        expected: "10 to 340 for a fisheye, 200 to 360 for a sphere",
    })
}

/// Reads a JPEG or PNG file.
///
/// # Errors
/// The file cannot be read, or is not a JPEG or PNG picture.
pub fn read_picture(path: &Path) -> Result<Picture, PhotographError> {
    read_picture_file(path).map(|(_, picture)| picture)
}

/// As [`read_picture`]; returns the file's bytes, too, for what else they hold.
///
/// # Errors
/// As [`read_picture`].
pub fn read_picture_file(path: &Path) -> Result<(Vec<u8>, Picture), PhotographError> {
    let unreadable = |source| PhotographError::Read {
        path: path.to_owned(),
        source,
    };
    let damaged = |source| PhotographError::Decode {
        path: path.to_owned(),
        source,
    };
    let bytes = read_bounded(path, MAX_PICTURE_BYTES).map_err(unreadable)?;
    // A JPEG that was cut off is refused: its missing part would be taken for dark surroundings.
    let picture = Picture::from_file_bytes(&bytes).map_err(damaged)?;
    Ok((bytes, picture))
}

#[cfg(test)]
mod tests;
