//! Finds the scene camera's pose in pictures of tags or a board.

use crate::intrinsics::detect::{Placement, find_chessboard};
use crate::intrinsics::{Board, Correspondence, Grey, board_pose};
use crate::simulation::flat_on_table;
use glam::{DVec2, DVec3};
use penumbra_camera::Lens;
use penumbra_camera::PinholeCamera;
use penumbra_fiducials::{Detector, Registrar, RegistrationMethod, TagMap, TagObservation};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_numerics::root_mean_square;
use penumbra_picture::Picture;
use penumbra_rig_model::RigCalibration;

/// Maximum RMS reprojection error of a board, pixels.
const MAX_RMS: f64 = 2.0;

/// Static features that determine the camera's pose.
#[derive(Clone, Debug)]
pub enum Landmarks {
    /// Tags at known positions.
    Tags(TagMap),
    /// A board. Its first corner is the world's origin, +X along its rows, +Z out of the paper.
    Board(Board),
}

/// The camera's pose in one picture.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct CameraPose {
    /// The driver's time stamp of the picture.
    pub stamp: MonotonicTime,
    /// The pose.
    pub world_from_camera: RigidTransform,
    /// Root mean square reprojection error, pixels.
    pub rms: f64,
    /// The landmarks' points in the picture, pixels.
    pub points: Vec<DVec2>,
}

/// Finds the pose of the scene camera from landmarks.
pub(super) struct PoseFinder {
    lens: Lens,
    detector: LandmarkDetector,
}

enum LandmarkDetector {
    Tags(Box<(Detector, Registrar, PinholeCamera)>),
    /// The board, and the orientation in the last picture that showed it.
    Board(Board, Option<RigidTransform>),
}

impl PoseFinder {
    /// Creates a finder for the scene camera of this rig.
    pub fn new(rig: &RigCalibration, landmarks: Landmarks) -> Self {
        let camera = &rig.scene_camera.camera;
        let detector = match landmarks {
            Landmarks::Tags(map) => {
                let detector = Detector::new(&map.families(), &rig.scene_camera.response);
                LandmarkDetector::Tags(Box::new((detector, Registrar::new(map), camera.clone())))
            }
            Landmarks::Board(board) => LandmarkDetector::Board(board, None),
        };
        Self {
            lens: Lens::from(camera),
            detector,
        }
    }

    /// Returns the pose in a picture; `None` where too few landmarks are visible or the pose is
    /// ambiguous.
    pub fn find(&mut self, picture: &Picture, stamp: MonotonicTime) -> Option<CameraPose> {
        if (picture.width, picture.height) != (self.lens.width, self.lens.height) {
            return None;
        }
        match &mut self.detector {
            LandmarkDetector::Tags(tags) => {
                let (detector, registrar, camera) = &mut **tags;
                let seen = detector.detect(picture, Some(&*camera));
                let found = registrar.register(camera, seen, stamp)?;
                if found.method == RegistrationMethod::TagGuessed {
                    return None;
                }
                let known = |t: &&TagObservation| registrar.map().get(t.family, t.id).is_some();
                let points = seen.iter().filter(known).flat_map(|t| t.corners).collect();
                Some(CameraPose {
                    stamp,
                    world_from_camera: found.map_from_camera,
                    rms: found.estimate.rms,
                    points,
                })
            }
            LandmarkDetector::Board(board, last) => {
                let found = find_board(&self.lens, board, picture, stamp, *last)?;
                *last = Some(found.world_from_camera);
                Some(found)
            }
        }
    }
}

/// Finds the pose from a chessboard that is completely visible.
fn find_board(
    lens: &Lens,
    board: &Board,
    picture: &Picture,
    stamp: MonotonicTime,
    last: Option<RigidTransform>,
) -> Option<CameraPose> {
    let Board::Chess {
        columns,
        rows,
        square,
    } = *board
    else {
        return None;
    };
    let seen = find_chessboard(&Grey::from_picture(picture), columns, rows).ok()?;
    let mut points = seen.correspondences(square);
    let pose = match seen.placement {
        Placement::Unknown => return None,
        Placement::Known => pose(lens, &points)?,
        Placement::KnownButHalfTurn => {
            // The board is symmetric under a half turn: take the pose nearer to the last one.
            let far = DVec2::new(f64::from(columns) - 1.0, f64::from(rows) - 1.0) * square;
            let reversed: Vec<_> = points
                .iter()
                .map(|c| Correspondence {
                    point: far - c.point,
                    pixel: c.pixel,
                })
                .collect();
            let (one, other) = (pose(lens, &points)?, pose(lens, &reversed)?);
            let angle =
                |p: RigidTransform| last.map_or(0.0, |l| p.rotation.angle_between(l.rotation));
            if angle(other) < angle(one) {
                points = reversed;
                other
            } else {
                one
            }
        }
    };
    let camera_from_board = (flat_on_table(0.0, DVec3::ZERO).inverse() * pose).inverse();
    let rms = root_mean_square(points.iter().map(|c| {
        let projected = lens.project(camera_from_board.transform_point(c.point.extend(0.0)));
        projected.map_or(f64::INFINITY, |p| p.distance(c.pixel))
    }));
    (rms < MAX_RMS).then(|| CameraPose {
        stamp,
        world_from_camera: pose,
        rms,
        points: points.iter().map(|c| c.pixel).collect(),
    })
}

/// Returns `world_from_camera`, with the world's +Z out of the paper.
fn pose(lens: &Lens, points: &[Correspondence]) -> Option<RigidTransform> {
    Some(flat_on_table(0.0, DVec3::ZERO) * board_pose(lens, points)?.inverse())
}
