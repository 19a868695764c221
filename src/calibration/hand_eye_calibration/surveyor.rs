//! Where the scene camera was, by what it sees.

use crate::intrinsics::detect::{Placement, find_chessboard};
use crate::intrinsics::{Board, Correspondence, Grey, board_pose};
use crate::simulation::lying;
use glam::{DVec2, DVec3};
use penumbra_camera::Lens;
use penumbra_camera::PinholeCamera;
use penumbra_fiducials::{Detector, Registrar, Registration, TagMap, TagSeen};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_numerics::root_mean_square;
use penumbra_picture::Picture;
use penumbra_rig_model::RigCalibration;

/// A board whose corners lie farther from where its pose puts them is not seen well enough, pixels.
const MOST_RMS: f64 = 2.0;

/// What stands still in the world.
#[derive(Clone, Debug)]
pub enum Landmarks {
    /// Tags at known places.
    Tags(TagMap),
    /// A board. The world begins at its first corner, +X along its rows, +Z out of the paper.
    Board(Board),
}

/// The camera's pose in one picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// The driver's stamp.
    pub stamp: MonotonicTime,
    /// By the landmarks.
    pub world_from_camera: RigidTransform,
    /// Root mean square reprojection error, pixels.
    pub rms: f64,
    /// Where the landmarks' points are seen, pixels.
    pub marks: Vec<DVec2>,
}

/// Finds it.
pub struct Surveyor {
    lens: Lens,
    eye: Eye,
}

enum Eye {
    Tags(Box<(Detector, Registrar, PinholeCamera)>),
    Board(Board, Option<(MonotonicTime, RigidTransform)>),
}

impl Surveyor {
    /// For the scene camera of this rig.
    #[must_use]
    pub fn new(rig: &RigCalibration, landmarks: Landmarks) -> Self {
        let camera = &rig.scene_camera.camera;
        let eye = match landmarks {
            Landmarks::Tags(map) => {
                let detector = Detector::new(&map.families(), &rig.scene_camera.response);
                Eye::Tags(Box::new((detector, Registrar::new(map), camera.clone())))
            }
            Landmarks::Board(board) => Eye::Board(board, None),
        };
        Self {
            lens: Lens::from(camera),
            eye,
        }
    }

    /// The pose in a picture; `None` where it shows too little, or leaves two poses open.
    pub fn look(&mut self, picture: &Picture, stamp: MonotonicTime) -> Option<Sighting> {
        if (picture.width, picture.height) != (self.lens.width, self.lens.height) {
            return None;
        }
        match &mut self.eye {
            Eye::Tags(eye) => {
                let (detector, registrar, camera) = &mut **eye;
                let seen = detector.detect(picture, Some(&*camera));
                let found = registrar.register(camera, seen, stamp)?;
                if found.how == Registration::TagGuessed {
                    return None;
                }
                let known = |t: &&TagSeen| registrar.map().get(t.family, t.id).is_some();
                let marks = seen.iter().filter(known).flat_map(|t| t.corners).collect();
                Some(Sighting {
                    stamp,
                    world_from_camera: found.map_from_camera,
                    rms: found.estimate.rms,
                    marks,
                })
            }
            Eye::Board(board, last) => {
                let found = by_board(&self.lens, board, picture, stamp, *last)?;
                *last = Some((stamp, found.world_from_camera));
                Some(found)
            }
        }
    }
}

/// By a chessboard that is whole in the picture.
fn by_board(
    lens: &Lens,
    board: &Board,
    picture: &Picture,
    stamp: MonotonicTime,
    last: Option<(MonotonicTime, RigidTransform)>,
) -> Option<Sighting> {
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
            // Both ways round look alike: the one nearer to the picture before.
            let far = DVec2::new(f64::from(columns) - 1.0, f64::from(rows) - 1.0) * square;
            let turned: Vec<_> = points
                .iter()
                .map(|c| Correspondence {
                    point: far - c.point,
                    pixel: c.pixel,
                })
                .collect();
            let (one, other) = (pose(lens, &points)?, pose(lens, &turned)?);
            let off =
                |p: RigidTransform| last.map_or(0.0, |(_, l)| p.rotation.angle_between(l.rotation));
            if off(other) < off(one) {
                points = turned;
                other
            } else {
                one
            }
        }
    };
    let camera_from_board = (lying(0.0, DVec3::ZERO).inverse() * pose).inverse();
    let rms = root_mean_square(points.iter().map(|c| {
        let there = lens.project(camera_from_board.transform_point(c.point.extend(0.0)));
        there.map_or(f64::INFINITY, |p| p.distance(c.pixel))
    }));
    (rms < MOST_RMS).then(|| Sighting {
        stamp,
        world_from_camera: pose,
        rms,
        marks: points.iter().map(|c| c.pixel).collect(),
    })
}

/// `world_from_camera`, the world's +Z out of the paper.
fn pose(lens: &Lens, points: &[Correspondence]) -> Option<RigidTransform> {
    Some(lying(0.0, DVec3::ZERO) * board_pose(lens, points)?.inverse())
}
