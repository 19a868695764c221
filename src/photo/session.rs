//! Writes what the photographs tell as a session.

use crate::ball::FoundBall;
use crate::error::PhotoError;
use crate::photograph::{Photograph, reduced};
use crate::{Analysis, BallPicture};
use glam::{DMat4, DVec2};
use image::ImageEncoder;
use image::codecs::png::PngEncoder;
use penumbra_interface::{Frame, MonotonicTime, PixelFormat, PoseSample};
use penumbra_lighting::Circle;
use penumbra_picture::Picture;
use penumbra_session::{Camera, SessionWriter};
use serde_json::{Value, json};
use std::path::Path;

/// Part of the picture around the ball that is kept, radii.
const MARGIN: f64 = 1.15;
/// Maximum side of the ball's picture, pixels: twice what an environment map of 1024 pixels needs.
const MAX_BALL_SIDE: u32 = 1024;
/// Times of the two frames, seconds: a replay needs a duration.
const TIMES: [f64; 2] = [1.0, 1.5];

/// A part of a picture: its origin, and the factor by which it is reduced.
pub(crate) struct Crop {
    x: u32,
    y: u32,
    side: u32,
    pub factor: u32,
}

impl Crop {
    /// Its first pixel in the picture.
    pub fn origin(&self) -> DVec2 {
        DVec2::new(f64::from(self.x), f64::from(self.y))
    }
}

impl Analysis {
    /// Writes the session: the picture without the ball, of at most `max_side` pixels along its longer
    /// side, the ball's as environment pictures, and the camera's pose.
    ///
    /// # Errors
    /// The file exists, or cannot be written.
    pub fn write_session(&self, path: &Path, max_side: u32) -> Result<(), PhotoError> {
        let crop = self.crop();
        let mut scene = Photograph::clone(&self.empty);
        scene.reduce(max_side);
        let factor = f64::from(self.camera.width) / f64::from(scene.picture.width);
        let darker = self.darker();
        let darker_ev = darker.as_ref().map(|(_, ev)| ev - self.base_ev());
        let rig = self.rig(&scene.picture, factor.round(), (&crop, darker_ev));
        let mut writer = SessionWriter::create(path)?;
        writer.attach("rig.json", format!("{rig:#}\n").as_bytes())?;
        let radiometric = format!("{:#}\n", self.radiometric());
        writer.attach("calibration/radiometric.json", radiometric.as_bytes())?;
        let scene = png(&scene.picture)?;
        let balls = self.balls.iter().map(|ball| {
            let picture = cropped(&ball.photograph.picture, &self.crop_of(ball));
            Ok((png(&picture)?, ball.ev - self.base_ev()))
        });
        let mut balls: Vec<(Vec<u8>, f64)> = balls.collect::<Result<_, PhotoError>>()?;
        if let (Some((picture, _)), Some(ev)) = (&darker, darker_ev) {
            balls.push((png(picture)?, ev));
        }
        for (k, seconds) in TIMES.into_iter().enumerate() {
            let at = MonotonicTime::from_nanos((1e9 * seconds) as i64);
            // Before and after the picture, so that nothing is extrapolated.
            for before in [-0.05, 0.0, 0.05] {
                let at = MonotonicTime::from_nanos((1e9 * (seconds + before)) as i64);
                writer.pose(&PoseSample {
                    station: 1,
                    transmitter_from_sensor: self.placement.world_from_camera,
                    arrived_at: at,
                    error: None,
                })?;
            }
            for (data, ev) in &balls {
                writer.frame(Camera::Environment, &frame(data, k as u64, at, *ev))?;
            }
            writer.frame(Camera::Scene, &frame(&scene, k as u64, at, 0.0))?;
        }
        writer.finish()?;
        Ok(())
    }

    /// Returns the exposure to which the others are relative: the longest.
    fn base_ev(&self) -> f64 {
        self.balls.iter().map(|b| b.ev).fold(f64::MIN, f64::max)
    }

    /// Returns the part of the first picture around the ball.
    fn crop(&self) -> Crop {
        let circle = self.balls.first().map_or(self.ball.circle, |b| b.circle);
        let (w, h) = (self.camera.width, self.camera.height);
        let side = ((2.0 * MARGIN * circle.radius) as u32).clamp(8, w.min(h));
        let factor = side.div_ceil(MAX_BALL_SIDE).max(1);
        let side = side / factor * factor;
        let origin = circle.centre - f64::from(side) / 2.0;
        Crop {
            x: (origin.x.max(0.0) as u32).min(w - side),
            y: (origin.y.max(0.0) as u32).min(h - side),
            side,
            factor,
        }
    }

    /// Returns the same part of the scene in another picture, which is shifted.
    pub(crate) fn crop_of(&self, ball: &BallPicture) -> Crop {
        let crop = self.crop();
        let first = self.balls.first().map_or(ball.shift, |b| b.shift);
        let moved = (ball.shift - first).as_i64vec2();
        let max = |size: u32| i64::from(size - crop.side);
        let x = (i64::from(crop.x) + moved.x).clamp(0, max(self.camera.width));
        let y = (i64::from(crop.y) + moved.y).clamp(0, max(self.camera.height));
        Crop {
            x: x as u32,
            y: y as u32,
            ..crop
        }
    }

    fn rig(&self, scene: &Picture, factor: f64, (crop, darker): (&Crop, Option<f64>)) -> Value {
        let reduced = |p: DVec2, by: f64| (p + 0.5) / by - 0.5;
        let k = |focal: f64, centre: DVec2| {
            json!([
                [focal, 0.0, centre.x],
                [0.0, focal, centre.y],
                [0.0, 0.0, 1.0]
            ])
        };
        let focal = self.camera.focal.x;
        let centre = reduced(self.camera.centre, factor);
        let by = f64::from(crop.factor);
        let origin = crop.origin();
        let shift = self
            .balls
            .first()
            .map_or(DVec2::ZERO, |b| b.shift.as_dvec2());
        let ball_centre = reduced(self.camera.centre + shift - origin, by);
        let side = crop.side / crop.factor;
        let pose = rows(self.placement.world_from_camera.to_matrix());
        let here = json!({ "matrix_row_major": rows(DMat4::IDENTITY) });
        let base = self.base_ev();
        let mut brackets: Vec<f64> = self.balls.iter().map(|b| b.ev - base).collect();
        brackets.retain(|ev| *ev != 0.0);
        brackets.extend(darker);
        let ball = self.placement.ball;
        json!({
            "name": "photographs",
            "scene_camera": {
                "image_size": [scene.width, scene.height],
                "K": k(focal / factor, centre),
            },
            "environment_camera": {
                "kind": "sphere",
                "image_size": [side, side],
                "K": k(focal / by, ball_centre),
                "T_world_cam": { "matrix_row_major": pose },
                "brackets_ev": brackets,
                "mirror_sphere": {
                    "center_world": [ball.x, ball.y, ball.z],
                    "radius": self.ball_radius,
                    "reflectance_rgb": self.reflectance,
                    "in_scene_camera_images": false,
                },
            },
            "ground_plane": { "offset": 0.0 },
            "tracker": { "T_world_source": here.clone(), "T_sensor_cam": here },
        })
    }

    /// Returns tone curve and gains. All pictures are the same camera's: the gains are the ratio of
    /// the exposures, and no guess.
    fn radiometric(&self) -> Value {
        let gain = (-self.base_ev()).exp2();
        let curve = self.tone.response.linear_from_code().to_vec();
        let response = json!({ "linear_from_code": curve, "relative_sigma": vec![0.02; 256] });
        json!({
            "penumbra_calibration": 1,
            "step": "radiometric",
            "date": "",
            "source": "photographs",
            "verdict": "usable",
            "scene_camera": { "response": response.clone() },
            "environment_camera": { "response": response },
            "gains": {
                "rgb": vec![gain; 3],
                "relative_sigma": vec![0.01; 3],
                "method": "exposures of one camera",
            },
        })
    }
}

fn rows(matrix: DMat4) -> [[f64; 4]; 4] {
    matrix.transpose().to_cols_array_2d()
}

pub(crate) fn cropped(picture: &Picture, crop: &Crop) -> Picture {
    let width = picture.width as usize;
    let rows = (crop.y..crop.y + crop.side).flat_map(|y| {
        let start = 4 * (y as usize * width + crop.x as usize);
        &picture.rgba[start..start + 4 * crop.side as usize]
    });
    let part = Picture {
        width: crop.side,
        height: crop.side,
        rgba: rows.copied().collect(),
    };
    match crop.factor {
        1 => part,
        factor => reduced(&part, factor),
    }
}

/// Encodes a picture as PNG without alpha.
///
/// # Errors
/// The picture is empty or inconsistent.
pub fn png(picture: &Picture) -> Result<Vec<u8>, PhotoError> {
    let rgb: Vec<u8> = picture
        .rgba
        .chunks_exact(4)
        .flat_map(|p| [p[0], p[1], p[2]])
        .collect();
    let mut bytes = Vec::new();
    let (width, height) = (picture.width, picture.height);
    PngEncoder::new(&mut bytes).write_image(&rgb, width, height, image::ExtendedColorType::Rgb8)?;
    Ok(bytes)
}

fn frame(data: &[u8], sequence: u64, at: MonotonicTime, bracket_ev: f64) -> Frame {
    Frame {
        data: data.to_vec().into(),
        format: PixelFormat::Png,
        width: 0,
        height: 0,
        stride: 0,
        sequence,
        captured_at: at,
        arrived_at: at,
        exposure: None,
        bracket_ev,
        controls: None,
    }
}

/// The circle of a ball in the reduced picture of the session, for drawing.
pub(crate) fn reduced_circle(ball: &FoundBall, factor: f64) -> Circle {
    Circle {
        centre: (ball.circle.centre + 0.5) / factor - 0.5,
        radius: ball.circle.radius / factor,
    }
}
