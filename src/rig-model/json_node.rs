//! A walk through a JSON document that remembers where it is, so that every complaint
//! names the key by its whole path.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, DVec4};
use penumbra_interface::RigidTransform;
use serde_json::Value;
use thiserror::Error;

/// Why a `rig.json` cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum RigJsonError {
    /// Not JSON at all.
    #[error("rig.json: line {line}, column {column}: {reason}; mend the JSON")]
    NotJson {
        /// From 1.
        line: usize,
        /// From 1.
        column: usize,
        /// The parser's words.
        reason: String,
    },
    /// Larger than any calibration can be.
    #[error("rig.json: {bytes} bytes, more than the {limit} allowed; is it the right file?")]
    TooLarge {
        /// Size found.
        bytes: usize,
        /// Size allowed.
        limit: usize,
    },
    /// A key that is needed is not there.
    #[error("rig.json: key `{path}` is missing; add it ({expected})")]
    Missing {
        /// Dotted path from the root.
        path: String,
        /// What the value should be.
        expected: &'static str,
    },
    /// A value of the wrong kind or outside its range.
    #[error("rig.json: `{path}` must be {expected}")]
    Wrong {
        /// Dotted path from the root.
        path: String,
        /// What the value should be.
        expected: String,
    },
}

type Result<T> = std::result::Result<T, RigJsonError>;

/// No length or position of a rig is larger (metres or pixels).
const LARGEST: f64 = 1e6;
/// How far a matrix may be from a rotation before it is called wrong: nine decimals are
/// customary, hand-written files have four.
const ROTATION_TOLERANCE: f64 = 2e-3;

/// One value of the document and the path to it.
#[derive(Clone, Debug)]
pub(super) struct Node<'a> {
    value: &'a Value,
    path: String,
}

impl<'a> Node<'a> {
    pub(super) const fn root(value: &'a Value) -> Self {
        Self {
            value,
            path: String::new(),
        }
    }

    fn child_path(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    /// The member `key`, unless it is absent or null.
    pub(super) fn find(&self, key: &str) -> Option<Self> {
        let value = self.value.get(key).filter(|v| !v.is_null())?;
        Some(Self {
            value,
            path: self.child_path(key),
        })
    }

    /// The member `key`, which must be there.
    pub(super) fn need(&self, key: &str, expected: &'static str) -> Result<Self> {
        self.find(key).ok_or_else(|| RigJsonError::Missing {
            path: self.child_path(key),
            expected,
        })
    }

    pub(super) fn wrong(&self, expected: impl Into<String>) -> RigJsonError {
        RigJsonError::Wrong {
            path: self.path.clone(),
            expected: expected.into(),
        }
    }

    pub(super) fn text(&self) -> Result<&'a str> {
        self.value.as_str().ok_or_else(|| self.wrong("a text"))
    }

    pub(super) fn flag(&self) -> Result<bool> {
        self.value
            .as_bool()
            .ok_or_else(|| self.wrong("true or false"))
    }

    pub(super) fn number(&self) -> Result<f64> {
        self.value
            .as_f64()
            .filter(|x| x.abs() <= LARGEST)
            .ok_or_else(|| self.wrong("a number between -1e6 and 1e6"))
    }

    pub(super) fn positive(&self) -> Result<f64> {
        self.number()
            .ok()
            .filter(|x| *x > 0.0)
            .ok_or_else(|| self.wrong("a number above 0 (and at most 1e6)"))
    }

    pub(super) fn pixels(&self) -> Result<u32> {
        self.value
            .as_u64()
            .and_then(|n| u32::try_from(n).ok())
            .filter(|n| *n <= 16_384)
            .ok_or_else(|| self.wrong("a whole number of pixels between 0 and 16384"))
    }

    /// All elements of an array of at most `most`.
    pub(super) fn list(&self, most: usize) -> Result<Vec<Self>> {
        let array = self
            .value
            .as_array()
            .filter(|a| a.len() <= most)
            .ok_or_else(|| self.wrong(format!("a list of at most {most} entries")))?;
        Ok(array
            .iter()
            .enumerate()
            .map(|(i, value)| Self {
                value,
                path: format!("{}[{i}]", self.path),
            })
            .collect())
    }

    pub(super) fn is_list(&self) -> bool {
        self.value.is_array()
    }

    pub(super) fn is_object(&self) -> bool {
        self.value.is_object()
    }

    /// Exactly `N` elements.
    pub(super) fn array<const N: usize>(&self) -> Result<[Self; N]> {
        let list = self.list(N)?;
        list.try_into()
            .map_err(|_| self.wrong(format!("a list of {N} entries")))
    }

    pub(super) fn numbers<const N: usize>(&self) -> Result<[f64; N]> {
        let nodes = self.array::<N>()?;
        let mut out = [0.0; N];
        for (slot, node) in out.iter_mut().zip(&nodes) {
            *slot = node.number()?;
        }
        Ok(out)
    }

    pub(super) fn vector(&self) -> Result<DVec3> {
        self.numbers::<3>().map(DVec3::from)
    }

    /// Linear RGB, each at least 0.
    pub(super) fn colour(&self) -> Result<[f32; 3]> {
        let rgb = self.numbers::<3>()?;
        if rgb.iter().any(|c| *c < 0.0) {
            return Err(self.wrong("three numbers, each at least 0"));
        }
        Ok(rgb.map(|c| c as f32))
    }

    /// `image_size` as `[width, height]`.
    pub(super) fn image_size(&self) -> Result<(u32, u32)> {
        let [w, h] = self.array::<2>()?;
        match (w.pixels()?, h.pixels()?) {
            (0, _) | (_, 0) => Err(self.wrong("[width, height], both above 0")),
            size => Ok(size),
        }
    }

    /// A camera matrix: focal lengths and principal point, pixels.
    pub(super) fn camera_matrix(&self) -> Result<(DVec2, DVec2)> {
        let wrong =
            || self.wrong("[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels, fx and fy above 0");
        let [a, b, c] = self.array::<3>().map_err(|_| wrong())?;
        let [fx, skew, cx] = a.numbers::<3>().map_err(|_| wrong())?;
        let [zero, fy, cy] = b.numbers::<3>().map_err(|_| wrong())?;
        let last = c.numbers::<3>().map_err(|_| wrong())?;
        if fx <= 0.0 || fy <= 0.0 || skew != 0.0 || zero != 0.0 || last != [0.0, 0.0, 1.0] {
            return Err(wrong());
        }
        Ok((DVec2::new(fx, fy), DVec2::new(cx, cy)))
    }

    /// An affine placement that keeps volume: `matrix_row_major`, or `position` with
    /// `quaternion_wxyz`.
    pub(super) fn transform(&self) -> Result<DMat4> {
        if let Some(rows) = self.find("matrix_row_major") {
            return rows.affine();
        }
        let position = self
            .need(
                "position",
                "matrix_row_major, or position and quaternion_wxyz",
            )?
            .vector()?;
        let node = self.need("quaternion_wxyz", "four numbers w, x, y, z")?;
        let [w, x, y, z] = node.numbers::<4>()?;
        let q = DQuat::from_xyzw(x, y, z, w);
        if (q.length() - 1.0).abs() > ROTATION_TOLERANCE {
            return Err(node.wrong("a unit quaternion w, x, y, z"));
        }
        Ok(DMat4::from_rotation_translation(q.normalize(), position))
    }

    fn affine(&self) -> Result<DMat4> {
        let rows = self.array::<4>()?;
        let mut m = [DVec4::ZERO; 4];
        for (slot, row) in m.iter_mut().zip(&rows) {
            *slot = DVec4::from(row.numbers::<4>()?);
        }
        let matrix = DMat4::from_cols(m[0], m[1], m[2], m[3]).transpose();
        if m[3] != DVec4::W || matrix.determinant().abs() < 1e-12 {
            return Err(
                self.wrong("an invertible 4x4 matrix, row by row, whose last row is 0 0 0 1")
            );
        }
        Ok(matrix)
    }

    /// A placement without scale or mirroring.
    pub(super) fn rigid(&self) -> Result<RigidTransform> {
        let matrix = self.transform()?;
        let r = DMat3::from_mat4(matrix);
        let off = r * r.transpose() - DMat3::IDENTITY;
        let worst = off
            .to_cols_array()
            .iter()
            .fold(0.0, |a: f64, x| a.max(x.abs()));
        if worst > ROTATION_TOLERANCE || r.determinant() < 0.0 {
            return Err(self.wrong("a rotation and a translation (no scale, no mirroring)"));
        }
        let rotation = DQuat::from_mat3(&r).normalize();
        Ok(RigidTransform::new(rotation, matrix.w_axis.truncate()))
    }
}
