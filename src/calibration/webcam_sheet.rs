//! The sheet of a webcam's rig: AprilTags around a place for a shiny ball and a place for virtual
//! objects. Tags, ball and ground have known positions, so nothing is mapped or clicked.
//!
//! ```text
//!   ┌ 100 ─ 101 ── 102 ── 103 ─ 104 ┐   World: origin in the middle of the objects' place,
//!   │   ◯ ball       ✛ objects      │   +X to the right and +Y up as the sheet is read, +Z out of
//!   │                ├─ ruler ─┤    │   the paper.
//!   └ 105 ─ 106 ── 107 ── 108 ─ 109 ┘
//! ```

use crate::board_sheet::pattern::tag_modules;
use crate::sheet::{Black, LINE_WIDTH, RULER, Ring, Sheet, Text, ruler};
use clap::ValueEnum;
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_fiducials::{Family, Tag};
use penumbra_interface::RigidTransform;
use serde_json::{Value, json};
use thiserror::Error;

/// Family of the tags.
pub const FAMILY: Family = Family::Tag36h11;
/// Number of the top left tag; calibration boards have the numbers from 0.
const FIRST_TAG: u32 = 100;
/// Edge of a tag's black border, metres.
const TAG_SIZE: f64 = 0.036;
/// Middles of the columns and rows of tags, metres from the sheet's middle.
const COLUMNS: [f64; 5] = [-0.107, -0.0535, 0.0, 0.0535, 0.107];
const ROWS: [f64; 2] = [0.074, -0.074];
/// Middle of the ball's place, metres from the sheet's middle, +Y up.
const BALL_PLACE: DVec2 = DVec2::new(-0.07, 0.0);
/// Middle of the objects' place: the world's origin, metres from the sheet's middle, +Y up.
const OBJECT_PLACE: DVec2 = DVec2::new(0.068, 0.018);
/// Radius of the objects' place, metres.
const OBJECT_RADIUS: f64 = 0.028;
/// Diameters of the printed rings of the ball's place, millimetres.
const RINGS_MM: [u32; 6] = [50, 60, 70, 80, 90, 100];
/// Left end of the ruler and of the instructions, metres from the sheet's middle, +Y up.
const RULER_AT: DVec2 = DVec2::new(-0.012, -0.020);
/// Baseline of the first instruction and distance to the next one, metres.
const FIRST_LINE: f64 = -0.031;
const LINE_STEP: f64 = 0.006;
/// The instructions.
const LINES: [&str; 3] = [
    "1  Print at 100 %, not fitted to the page. The line above must be 100 mm long.",
    "2  Tape the sheet onto a table so that it is flat. Leave all tags visible.",
    "3  Put a shiny ball onto the ring of its diameter, a bit of putty below it.",
];

/// Diameters of balls for which the sheet has rings, millimetres.
pub const BALL_MM: std::ops::RangeInclusive<f64> = 50.0..=100.0;
/// Accepted lengths of the printed ruler, millimetres; beyond it something else was measured.
pub const RULER_MM: std::ops::RangeInclusive<f64> = 80.0..=125.0;
/// Standard deviation of a ball's position that was placed by hand, along each axis, metres.
pub const PLACING_SIGMA: f64 = 0.003;

/// Size of the paper, in landscape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Paper {
    /// 297 × 210 mm.
    #[default]
    A4,
    /// US Letter, 11 × 8.5 inches.
    Letter,
}

impl Paper {
    /// Returns width and height, metres.
    #[must_use]
    pub const fn size(self) -> DVec2 {
        match self {
            Self::A4 => DVec2::new(0.297, 0.210),
            Self::Letter => DVec2::new(0.2794, 0.2159),
        }
    }

    /// Returns the name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::A4 => "A4",
            Self::Letter => "US Letter",
        }
    }
}

/// The sheet as it lies on the table, with the ball on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WebcamSheet {
    /// The paper.
    pub paper: Paper,
    /// True length per printed length: the measured length of the ruler over 100 mm.
    scale: f64,
    /// Diameter of the ball, metres.
    ball_diameter: f64,
    /// Height of the ball's lowest point above the paper, metres.
    stand: f64,
}

/// A measure that the sheet cannot have.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum MeasureError {
    /// The ball's diameter.
    #[error(
        "a ball of {0} mm: the sheet has rings for 50 to 100 mm; measure the ball's diameter in millimetres"
    )]
    Ball(f64),
    /// The length of the ruler.
    #[error(
        "a ruler of {0} mm: expected 80 to 125 mm; measure the line on the sheet, which is 100 mm long if printed at 100 %"
    )]
    Ruler(f64),
    /// The height of the stand.
    #[error(
        "a stand of {0} mm: expected 0 to 50 mm, the height of the ball's lowest point above the paper"
    )]
    Stand(f64),
}

impl WebcamSheet {
    /// Creates a sheet; lengths in millimetres: the measured length of the ruler, the ball's
    /// diameter, and the height of its lowest point above the paper.
    ///
    /// # Errors
    /// A length is out of range.
    pub fn new(
        paper: Paper,
        ruler_mm: f64,
        ball_mm: f64,
        stand_mm: f64,
    ) -> Result<Self, MeasureError> {
        if !RULER_MM.contains(&ruler_mm) {
            return Err(MeasureError::Ruler(ruler_mm));
        }
        if !BALL_MM.contains(&ball_mm) {
            return Err(MeasureError::Ball(ball_mm));
        }
        if !(0.0..=50.0).contains(&stand_mm) {
            return Err(MeasureError::Stand(stand_mm));
        }
        Ok(Self {
            paper,
            scale: 1e-3 * ruler_mm / RULER,
            ball_diameter: 1e-3 * ball_mm,
            stand: 1e-3 * stand_mm,
        })
    }

    /// Returns the tags in the world, metres.
    #[must_use]
    pub fn tags(&self) -> Vec<Tag> {
        let tag = |(id, middle): (u32, DVec2)| Tag {
            family: FAMILY,
            id,
            size: TAG_SIZE * self.scale,
            map_from_tag: RigidTransform::new(
                // A tag's +Y is down as it is read, its +Z into the paper.
                DQuat::from_rotation_x(std::f64::consts::PI),
                self.in_world(middle, 0.0),
            ),
        };
        tag_middles().map(tag).collect()
    }

    /// Returns the ball's centre in the world and its radius, metres.
    #[must_use]
    pub fn ball(&self) -> (DVec3, f64) {
        let radius = 0.5 * self.ball_diameter;
        (self.in_world(BALL_PLACE, self.stand + radius), radius)
    }

    /// Returns the middle of the paper in the world, metres.
    #[must_use]
    pub fn middle(&self) -> DVec3 {
        self.in_world(DVec2::ZERO, 0.0)
    }

    /// Returns the true length per printed length.
    #[must_use]
    pub const fn scale(&self) -> f64 {
        self.scale
    }

    /// Places a point of the print, metres from the sheet's middle, at `height` in the world.
    fn in_world(&self, printed: DVec2, height: f64) -> DVec3 {
        ((printed - OBJECT_PLACE) * self.scale).extend(height)
    }

    /// Lays out the print. It depends on the paper alone: another ball needs no other print.
    #[must_use]
    pub fn sheet(&self) -> Sheet {
        let size = self.paper.size();
        // From the sheet's middle, +Y up, to its top left corner, +Y down.
        let at = |p: DVec2| DVec2::new(0.5 * size.x + p.x, 0.5 * size.y - p.y);
        let corner = |middle: DVec2| at(middle) - 0.5 * TAG_SIZE;
        let mut black: Vec<Black> = tag_middles()
            .flat_map(|(id, middle)| {
                let DVec2 { x, y } = corner(middle);
                tag_modules((FAMILY, id), false, TAG_SIZE, (x, y))
            })
            .collect();
        black.extend(
            [BALL_PLACE, OBJECT_PLACE]
                .map(at)
                .into_iter()
                .flat_map(cross),
        );
        let DVec2 { x, y } = at(RULER_AT);
        black.extend(ruler(x, y, RULER));
        let ring = |middle: DVec2, radius: f64| Ring {
            x: at(middle).x,
            y: at(middle).y,
            radius,
        };
        let radii = RINGS_MM.map(|mm| 5e-4 * f64::from(mm));
        let mut rings: Vec<Ring> = radii.map(|radius| ring(BALL_PLACE, radius)).to_vec();
        rings.push(ring(OBJECT_PLACE, OBJECT_RADIUS));
        Sheet {
            width: size.x,
            height: size.y,
            black,
            rings,
            texts: texts(at),
        }
    }

    /// Returns the `rig.json` of a rig of one camera with this lens.
    #[must_use]
    pub fn rig_json(&self, lens: &PinholeCamera) -> Value {
        let markers: Vec<Value> = self
            .tags()
            .iter()
            .map(|tag| {
                json!({
                    "family": tag.family.to_string(), "id": tag.id, "size_m": tag.size,
                    "T_world_marker": {
                        "position": tag.map_from_tag.translation.to_array(),
                        "quaternion_wxyz": [0, 1, 0, 0],
                    },
                })
            })
            .collect();
        let (centre, radius) = self.ball();
        json!({
            "name": "webcam",
            "scene_camera": {
                "image_size": [lens.width, lens.height],
                "K": [[lens.focal.x, 0, lens.centre.x], [0, lens.focal.y, lens.centre.y], [0, 0, 1]],
                "lens_distortion": "none",
                "response": "srgb",
            },
            "markers": markers,
            "mirror_sphere": {
                "center_world": centre.to_array(), "radius": radius,
                "position_sigma_m": PLACING_SIGMA,
                // Silvered glass or lacquer.
                "reflectance_rgb": [0.85, 0.85, 0.85], "in_scene_camera_images": true,
            },
            "ground_plane": { "normal": [0, 0, 1], "offset": 0.0, "size_m": 3.0 },
        })
    }
}

/// Returns the tags' numbers and middles, metres from the sheet's middle, +Y up.
fn tag_middles() -> impl Iterator<Item = (u32, DVec2)> {
    let places = ROWS
        .into_iter()
        .flat_map(|y| COLUMNS.map(|x| DVec2::new(x, y)));
    (FIRST_TAG..).zip(places)
}

/// A cross of two thin lines.
fn cross(at: DVec2) -> [Black; 2] {
    const LENGTH: f64 = 0.006;
    let line = |width: f64, height: f64| Black {
        x: at.x - 0.5 * width,
        y: at.y - 0.5 * height,
        width,
        height,
    };
    [line(LENGTH, LINE_WIDTH), line(LINE_WIDTH, LENGTH)]
}

/// Returns the instructions, the diameters of the rings, and the names of the places.
fn texts(at: impl Fn(DVec2) -> DVec2) -> Vec<Text> {
    let text = |p: DVec2, points: f64, text: String| Text {
        x: at(p).x,
        y: at(p).y,
        points,
        text,
    };
    let line = |(i, words): (usize, &&str)| {
        let y = FIRST_LINE - LINE_STEP * i as f64;
        text(DVec2::new(RULER_AT.x, y), 9.0, (*words).to_owned())
    };
    let mut out: Vec<Text> = LINES.iter().enumerate().map(line).collect();
    out.extend(RINGS_MM.map(|mm| {
        let below = DVec2::new(-0.0015, 0.0008 - 5e-4 * f64::from(mm));
        text(BALL_PLACE + below, 5.0, mm.to_string())
    }));
    let names = [
        (
            BALL_PLACE + DVec2::new(-0.0085, 0.006),
            "ball, diameter in mm",
        ),
        (
            OBJECT_PLACE + DVec2::new(-0.0085, -0.012),
            "virtual objects",
        ),
    ];
    out.extend(names.map(|(p, name)| text(p, 5.0, name.to_owned())));
    out
}

/// Returns a lens without distortion, its axis through the picture's middle, from the horizontal
/// field of view, radians: the assumption for a camera that is not calibrated.
#[must_use]
pub fn assumed_lens((width, height): (u32, u32), field_of_view: f64) -> PinholeCamera {
    let size = DVec2::new(f64::from(width), f64::from(height));
    PinholeCamera {
        width,
        height,
        focal: DVec2::splat(0.5 * size.x / (0.5 * field_of_view).tan()),
        centre: 0.5 * (size - 1.0),
        distortion: [0.0; 5],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_fiducials::Detector;

    fn sheet(paper: Paper) -> WebcamSheet {
        WebcamSheet::new(paper, 100.0, 70.0, 0.0).unwrap()
    }

    #[test]
    fn printed_tags_are_detected_where_the_map_has_them() {
        for paper in [Paper::A4, Paper::Letter] {
            let sheet = sheet(paper);
            let (pixels, width, height) = sheet.sheet().raster(200).unwrap();
            let mut detector = Detector::new(&[FAMILY], &penumbra_camera::Response::srgb());
            let found = detector.detect_grey(&pixels, width as usize, height as usize, None);
            assert_eq!(found.len(), 10, "{paper:?}");
            let dots = 200.0 / 0.0254;
            for tag in sheet.tags() {
                let seen = found.iter().find(|t| t.id == tag.id).unwrap();
                for (corner, pixel) in tag.corners().iter().zip(seen.corners) {
                    let from_middle = (*corner - sheet.middle()).truncate();
                    let at = 0.5 * paper.size() + DVec2::new(from_middle.x, -from_middle.y);
                    // The raster rounds edges to whole dots: half a dot in each direction.
                    assert!(pixel.distance(at * dots - 0.5) < 0.75, "{} {pixel}", tag.id);
                }
            }
        }
    }

    #[test]
    fn print_keeps_the_margins_of_printers_and_the_tags_white_borders() {
        for paper in [Paper::A4, Paper::Letter] {
            let sheet = sheet(paper).sheet();
            for b in &sheet.black {
                assert!(b.x > 0.01 && b.x + b.width < sheet.width - 0.01, "{b:?}");
                assert!(b.y > 0.01 && b.y + b.height < sheet.height - 0.01, "{b:?}");
            }
            // A module of white around each tag.
            let quiet = TAG_SIZE * 0.5 + TAG_SIZE / 8.0;
            for (_, middle) in tag_middles() {
                let at = 0.5 * paper.size() + DVec2::new(middle.x, -middle.y);
                for ring in &sheet.rings {
                    let nearest = (DVec2::new(ring.x, ring.y) - at).abs() - quiet;
                    assert!(nearest.max(DVec2::ZERO).length() > ring.radius, "{ring:?}");
                }
            }
        }
    }

    #[test]
    fn measured_ruler_scales_positions_but_not_the_ball() {
        let smaller = WebcamSheet::new(Paper::A4, 97.0, 70.0, 0.0).unwrap();
        let (true_size, shrunk) = (sheet(Paper::A4).ball(), smaller.ball());
        assert!((shrunk.0.x / true_size.0.x - 0.97).abs() < 1e-12);
        assert_eq!((shrunk.0.z, shrunk.1), (0.035, 0.035));
        assert!((smaller.tags()[0].size - 0.97 * TAG_SIZE).abs() < 1e-12);
    }

    #[test]
    fn impossible_measures_are_refused_with_what_to_do() {
        let refused = |ruler, ball, stand| {
            let sheet = WebcamSheet::new(Paper::A4, ruler, ball, stand);
            sheet.unwrap_err().to_string()
        };
        assert!(refused(100.0, 30.0, 0.0).contains("50 to 100 mm"));
        assert!(refused(10.0, 70.0, 0.0).contains("80 to 125 mm"));
        assert!(refused(100.0, f64::NAN, 0.0).contains("NaN"));
        assert!(refused(100.0, 70.0, 99.0).contains("stand"));
    }

    #[test]
    fn rig_json_describes_a_rig_whose_light_comes_from_the_ball() {
        let lens = assumed_lens((1280, 720), 65_f64.to_radians());
        assert!((lens.focal.x - 1004.6).abs() < 0.1);
        let json = sheet(Paper::A4).rig_json(&lens).to_string();
        let file = |name: &str| (name == "rig.json").then_some(json.as_bytes());
        let rig = penumbra_rig_model::RigDocument::from_session(&file).unwrap();
        assert_eq!(rig.markers.len(), 10);
        let ball = rig.mirror_sphere.unwrap();
        assert!((ball.radius - 0.035).abs() < 1e-12 && ball.in_scene);
        assert!((ball.position_sigma - PLACING_SIGMA).abs() < 1e-12);
    }
}
