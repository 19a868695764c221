//! Detects AprilTags in a picture and prints the number, corners and pose of each.
//!
//! ```text
//! cargo run -p penumbra-fiducials --example detect
//! cargo run -p penumbra-fiducials --example detect PICTURE FOCAL_PIXELS TAG_METRES
//! ```
//! Without arguments it renders a picture of two tags. PICTURE is a JPEG or PNG file without lens
//! distortion, FOCAL_PIXELS the camera's focal length, TAG_METRES the edge of a tag's black border.

use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_fiducials::{Detector, Family, Tag, TagObservation, nearest_pose, synthetic};
use penumbra_interface::RigidTransform;
use penumbra_picture::Picture;
use std::error::Error;
use std::fmt;

/// A picture and what must be known to interpret it.
pub struct Input {
    /// The picture.
    pub picture: Picture,
    /// Intrinsics of its camera.
    pub camera: PinholeCamera,
    /// Edge of a tag's black border, metres.
    pub tag_size: f64,
}

/// A detected tag.
pub struct Detection {
    /// Family, number and corners.
    pub tag: TagObservation,
    /// Pose of the tag in the camera's frame; `None` where the corners allow none.
    pub camera_from_tag: Option<RigidTransform>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let input = match arguments.as_slice() {
        [] => rendered().0,
        [file, focal, size] => read(file, focal.parse()?, size.parse()?)?,
        _ => return Err("usage: detect [PICTURE FOCAL_PIXELS TAG_METRES]".into()),
    };
    for detection in detect(&input) {
        println!("{detection}");
    }
    Ok(())
}

/// Detects the tags of family tag36h11 in a picture, with their poses.
pub fn detect(input: &Input) -> Vec<Detection> {
    let mut detector = Detector::new(&[Family::Tag36h11], &Response::srgb());
    let tags = detector.detect(&input.picture, Some(&input.camera));
    let with_pose = |tag: &TagObservation| Detection {
        tag: *tag,
        camera_from_tag: nearest_pose(&input.camera, &tag.corners, input.tag_size, None),
    };
    tags.iter().map(with_pose).collect()
}

/// Reads a JPEG or PNG file of a camera without lens distortion, whose axis is in the middle.
///
/// # Errors
/// The file cannot be read or is no picture.
pub fn read(file: &str, focal: f64, tag_size: f64) -> Result<Input, Box<dyn Error>> {
    let bytes = std::fs::read(file).map_err(|e| format!("{file}: {e}"))?;
    let picture = Picture::from_file_bytes(&bytes).map_err(|e| format!("{file}: {e}"))?;
    let size = DVec2::new(f64::from(picture.width), f64::from(picture.height));
    let camera = PinholeCamera {
        width: picture.width,
        height: picture.height,
        focal: DVec2::splat(focal),
        centre: 0.5 * (size - 1.0),
        distortion: [0.0; 5],
    };
    Ok(Input {
        picture,
        camera,
        tag_size,
    })
}

/// Renders two tags before a grey wall. Also returns the tags with their true poses in the
/// camera's frame.
pub fn rendered() -> (Input, [Tag; 2]) {
    let camera = synthetic::camera();
    let tag_size = 0.06;
    let tag = |id, x, tilt| Tag {
        family: Family::Tag36h11,
        id,
        size: tag_size,
        map_from_tag: RigidTransform::new(DQuat::from_rotation_x(tilt), DVec3::new(x, 0.0, 0.4)),
    };
    let tags = [tag(7, -0.06, 0.7), tag(341, 0.06, -0.5)];
    let grey = synthetic::render(&camera, RigidTransform::IDENTITY, &tags, 1.0);
    let picture = Picture {
        width: camera.width,
        height: camera.height,
        rgba: grey.iter().flat_map(|&g| [g, g, g, 255]).collect(),
    };
    let input = Input {
        picture,
        camera,
        tag_size,
    };
    (input, tags)
}

impl fmt::Display for Detection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}: corners", self.tag.family, self.tag.id)?;
        for corner in self.tag.corners {
            write!(f, " ({:.2}, {:.2})", corner.x, corner.y)?;
        }
        match &self.camera_from_tag {
            Some(pose) => write!(
                f,
                "; position {:.4} m, rotation {:.3}",
                pose.translation,
                pose.rotation.to_scaled_axis()
            ),
            None => f.write_str("; no pose"),
        }
    }
}
