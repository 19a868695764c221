//! The six lights for shading in the papers.

use super::build::upper_corners;
use super::{Face, GeodesicDome};
use glam::{DVec3, Vec3};

/// Assignment of the faces to six lights.
#[derive(Clone, Debug, PartialEq)]
pub struct SixGroups {
    /// Unit vectors to the lights: the zenith, then by azimuth.
    pub directions: [Vec3; 6],
    /// Group of each face.
    pub group_of: Vec<u8>,
}

impl SixGroups {
    /// Returns the irradiance on surfaces that face each light, from the faces' sums.
    #[must_use]
    pub fn sums(&self, faces: &[Vec3]) -> [Vec3; 6] {
        let mut sums = [Vec3::ZERO; 6];
        for (&group, sum) in self.group_of.iter().zip(faces) {
            sums[usize::from(group)] += *sum;
        }
        sums
    }
}

impl GeodesicDome {
    /// Returns the papers' six directional lights: the faces' sums are added up around six
    /// directions that divide the hemisphere evenly, the icosahedron's upper corners (the
    /// directions nearest to each cover 2π/6 sr).
    ///
    /// A face belongs to the corner nearest to its centre. Where two or three are equally near, it
    /// belongs to the lower one, and to the first anticlockwise, so that the five lower groups are
    /// equal; the zenith's is then up to 29 % smaller than a sixth, and theirs 6 % larger.
    #[must_use]
    pub fn six_groups(&self) -> SixGroups {
        let directions = upper_corners().map(DVec3::as_vec3);
        let nearest = |face: &Face| {
            let c = face.centre;
            // Breaks ties only: all other centres are farther than this from any border.
            let tipped = c + (Vec3::Z.cross(c) - Vec3::Z * 0.5) * 1e-3;
            let mut best = 0;
            for k in 1..6 {
                if directions[k].dot(tipped) > directions[best].dot(tipped) {
                    best = k;
                }
            }
            best as u8
        };
        SixGroups {
            group_of: self.faces.iter().map(nearest).collect(),
            directions,
        }
    }
}
