//! `calibration/environment.json`: pose of the environment camera, which replaces that of `rig.json`.

use crate::CalibrationFileError;
use crate::EnvironmentCamera;
use crate::Header;
use crate::RigDocument;
use crate::header::parse;
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::{EnvironmentView, FisheyeLens};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_interface::RigidTransform;
use serde::{Deserialize, Serialize};

/// Name of the file, beside `rig.json` and in sessions.
pub const ENVIRONMENT: &str = "calibration/environment.json";
/// The calibration step.
pub const STEP: &str = "environment";

/// The file. Lengths are metres or pixels; `sigma` is one standard deviation.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct EnvironmentRecord {
    /// Step, date, source, quality.
    #[serde(flatten)]
    pub header: Header,
    /// "fisheye" or "sphere".
    pub kind: String,
    /// Width and height of the pictures, pixels.
    pub image_size: [u32; 2],
    /// The fisheye lens from its image circle, unless it was calibrated separately.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<CircleLens>,
    /// Pose of the camera in the world.
    #[serde(rename = "T_world_cam")]
    pub world_from_camera: PoseRecord,
    /// Method of the pose: "markers", "lights", "clicks"; or "rig.json" if it was not calibrated.
    pub by: String,
    /// Standard deviation of the orientation about the camera's axes, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn_sigma_degrees: Option<[f64; 3]>,
    /// Standard deviation of the position, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place_sigma: Option<[f64; 3]>,
    /// The mirrored sphere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sphere: Option<SphereRecord>,
}

/// An equidistant lens, or one of known distortion, from its image circle.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct CircleLens {
    /// Image of the optical axis, pixels.
    pub centre: [f64; 2],
    /// Radius of the image circle, pixels.
    pub radius: f64,
    /// Focal length, pixels per radian at the axis.
    pub focal: f64,
    /// k1 to k4.
    pub distortion: [f64; 4],
    /// Half the field of view, radians.
    pub max_theta: f64,
    /// Standard deviations of centre x, y and radius, pixels.
    pub sigma: [f64; 3],
}

/// A pose.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct PoseRecord {
    /// Position, metres.
    pub position: [f64; 3],
    /// Unit quaternion.
    pub quaternion_wxyz: [f64; 4],
}

/// The mirrored sphere that the environment camera looks at.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct SphereRecord {
    /// Centre in the world, metres.
    pub centre_in_world: [f64; 3],
    /// Centre in the camera's frame from its outline, metres.
    pub centre_in_camera: [f64; 3],
    /// Measured radius, metres.
    pub radius: f64,
    /// Standard deviations of the centre across and along the line of sight, metres.
    pub sigma: [f64; 2],
}

impl PoseRecord {
    /// Creates the record of a pose.
    #[must_use]
    pub fn from_pose(pose: &RigidTransform) -> Self {
        let q = pose.rotation;
        Self {
            position: pose.translation.to_array(),
            quaternion_wxyz: [q.w, q.x, q.y, q.z],
        }
    }

    fn pose(&self) -> Result<RigidTransform, CalibrationFileError> {
        let [w, x, y, z] = self.quaternion_wxyz;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        let position = DVec3::from_array(self.position);
        let is_unit = (rotation.length() - 1.0).abs() < 1e-3;
        if !(is_unit && position.is_finite() && position.length() < 1e4) {
            return Err(wrong("T_world_cam", "a unit quaternion and metres"));
        }
        Ok(RigidTransform::new(rotation.normalize(), position))
    }
}

/// Applies the file, if it exists, to `rig`.
///
/// # Errors
/// The file is invalid, was refused when it was made, or does not match the rig.
pub fn apply_environment_file<'a>(
    rig: &mut RigDocument,
    attachments: &dyn Fn(&str) -> Option<&'a [u8]>,
) -> Result<(), CalibrationFileError> {
    let Some(bytes) = attachments(ENVIRONMENT) else {
        return Ok(());
    };
    let record: EnvironmentRecord = parse(ENVIRONMENT, bytes)?;
    record.header.check(ENVIRONMENT, STEP)?;
    let pose = record.world_from_camera.pose()?;
    let lens = record
        .lens
        .as_ref()
        .map(|l| fisheye(l, record.image_size))
        .transpose()?;
    let sphere = record.sphere.map(|s| s.centre()).transpose()?;
    if let (Some((centre, _)), Some(ball)) = (sphere, &mut rig.mirror_sphere) {
        ball.centre_in_world = centre;
    }
    match (&mut rig.calibration.environment, record.kind.as_str()) {
        (Some(environment), kind) => view(environment, kind, &record, pose, lens, sphere),
        (none @ None, "fisheye") => {
            let lens = lens
                .ok_or_else(|| wrong("lens", "given where rig.json has no environment_camera"))?;
            *none = Some(EnvironmentCamera {
                response: Response::srgb(),
                view: EnvironmentView::Fisheye {
                    lens,
                    world_from_camera: pose,
                },
                latency_nanos: 0,
                vignetting: None,
                brackets_ev: Vec::new(),
            });
            Ok(())
        }
        (None, _) => Err(unusable(
            "is of a camera before a mirrored sphere; write its environment_camera (K, mirror_sphere) into rig.json",
        )),
    }
}

fn view(
    environment: &mut EnvironmentCamera,
    kind: &str,
    record: &EnvironmentRecord,
    pose: RigidTransform,
    circle: Option<FisheyeLens>,
    ball: Option<(DVec3, f64)>,
) -> Result<(), CalibrationFileError> {
    let fits = |size: (u32, u32)| {
        let made = (record.image_size[0], record.image_size[1]);
        if made == size {
            return Ok(());
        }
        Err(unusable(&format!(
            "is of pictures of {}×{}, rig.json's are {}×{}; calibrate in the mode that is used",
            made.0, made.1, size.0, size.1
        )))
    };
    match (&mut environment.view, kind) {
        (
            EnvironmentView::Fisheye {
                lens,
                world_from_camera,
            },
            "fisheye",
        ) => {
            fits((lens.width, lens.height))?;
            *world_from_camera = pose;
            if let Some(circle) = circle {
                *lens = circle;
            }
            Ok(())
        }
        (
            EnvironmentView::Sphere {
                camera,
                world_from_camera,
                sphere,
            },
            "sphere",
        ) => {
            let PinholeCamera { width, height, .. } = *camera;
            fits((width, height))?;
            *world_from_camera = pose;
            if let Some((centre, radius)) = ball {
                (sphere.centre_in_world, sphere.radius) = (centre, radius);
            }
            Ok(())
        }
        _ => Err(unusable(&format!(
            "is of the kind `{kind}`, rig.json's environment_camera of another; calibrate again, or correct rig.json"
        ))),
    }
}

impl SphereRecord {
    fn centre(&self) -> Result<(DVec3, f64), CalibrationFileError> {
        let centre = DVec3::from_array(self.centre_in_world);
        if !(centre.is_finite() && self.radius > 0.0 && self.radius < 100.0) {
            return Err(wrong("sphere", "a centre and a radius in metres"));
        }
        Ok((centre, self.radius))
    }
}

fn fisheye(
    lens: &CircleLens,
    [width, height]: [u32; 2],
) -> Result<FisheyeLens, CalibrationFileError> {
    let centre = DVec2::from_array(lens.centre);
    let sane = centre.is_finite()
        && centre.abs().max_element() < 1e5
        && (1.0..1e5).contains(&lens.focal)
        && (0.1..=std::f64::consts::PI).contains(&lens.max_theta)
        && lens.distortion.iter().all(|k| k.is_finite())
        && (1..65_536).contains(&width.min(height))
        && width.max(height) < 65_536;
    if !sane {
        return Err(wrong(
            "lens",
            "a lens: centre and focal in pixels, max_theta in radians",
        ));
    }
    Ok(FisheyeLens {
        width,
        height,
        focal: lens.focal,
        centre,
        distortion: lens.distortion,
        max_theta: lens.max_theta,
    })
}

fn wrong(key: &'static str, expected: &'static str) -> CalibrationFileError {
    CalibrationFileError::Wrong {
        file: ENVIRONMENT.to_owned(),
        key,
        expected,
    }
}

fn unusable(reason: &str) -> CalibrationFileError {
    CalibrationFileError::Unusable {
        file: ENVIRONMENT.to_owned(),
        reason: reason.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> EnvironmentRecord {
        EnvironmentRecord {
            header: Header {
                penumbra_calibration: 1,
                step: STEP.to_owned(),
                date: String::new(),
                source: String::new(),
                device: None,
                verdict: "good".to_owned(),
                findings: Vec::new(),
            },
            kind: "fisheye".to_owned(),
            image_size: [480, 480],
            lens: Some(CircleLens {
                centre: [241.0, 238.0],
                radius: 237.2,
                focal: 151.0,
                distortion: [0.0; 4],
                max_theta: 1.57,
                sigma: [0.1; 3],
            }),
            world_from_camera: PoseRecord {
                position: [0.0, 0.1, 0.2],
                quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
            },
            by: "markers".to_owned(),
            turn_sigma_degrees: None,
            place_sigma: None,
            sphere: None,
        }
    }

    fn applied(
        rig: &mut RigDocument,
        record: &EnvironmentRecord,
    ) -> Result<(), CalibrationFileError> {
        let bytes = serde_json::to_vec(record).unwrap();
        apply_environment_file(rig, &|name| (name == ENVIRONMENT).then_some(&bytes[..]))
    }

    #[test]
    fn adds_environment_camera_and_later_replaces_its_pose() {
        let mut rig = RigDocument::uncalibrated(640, 480);
        apply_environment_file(&mut rig, &|_| None).unwrap();
        assert!(rig.calibration.environment.is_none());
        let mut stated = record();
        applied(&mut rig, &stated).unwrap();
        stated.lens = None;
        stated.world_from_camera.position[0] = 3.0;
        applied(&mut rig, &stated).unwrap();
        let environment = rig.calibration.environment.unwrap();
        let EnvironmentView::Fisheye {
            lens,
            world_from_camera,
        } = environment.view
        else {
            panic!("no fisheye");
        };
        assert_eq!((lens.focal, world_from_camera.translation.x), (151.0, 3.0));
    }

    #[test]
    fn rejects_mismatched_files_with_one_line() {
        let mut rig = RigDocument::uncalibrated(640, 480);
        applied(&mut rig, &record()).unwrap();
        let mut cases = vec![(record(), "kind `sphere`"); 5];
        cases[0].0.kind = "sphere".to_owned();
        cases[1].0.image_size = [640, 480];
        cases[1].1 = "640×480, rig.json's are 480×480";
        cases[2].0.header.verdict = "refused".to_owned();
        cases[2].1 = "was refused";
        cases[3].0.world_from_camera.quaternion_wxyz[0] = 0.2;
        cases[3].1 = "T_world_cam";
        if let Some(lens) = &mut cases[4].0.lens {
            lens.focal = -1.0;
        }
        cases[4].1 = "lens";
        for (record, expected_text) in cases {
            let error = applied(&mut rig, &record).unwrap_err().to_string();
            assert!(
                error.starts_with(ENVIRONMENT) && error.contains(expected_text),
                "{error}"
            );
        }
    }
}
