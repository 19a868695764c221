//! Values of `rig.json` that check their range as they are read.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, DVec4};
use penumbra_interface::RigidTransform;
use serde::de::value::Error as FieldError;
use serde::de::{Error, IgnoredAny, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::marker::PhantomData;

/// Maximum magnitude of a number (metres or pixels).
pub(super) const MAX_MAGNITUDE: f64 = 1e6;
/// Maximum number of pixels along a side, and of a marker's number.
pub(super) const MAX_COUNT: u64 = 16_384;
/// Maximum deviation of a matrix from a rotation: nine decimals are customary, hand-written files
/// have four.
const ROTATION_TOLERANCE: f64 = 2e-3;
/// Maximum latency, seconds.
pub(super) const MAX_LATENCY_SECONDS: f64 = 10.0;

/// A number of at most [`MAX_MAGNITUDE`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Number(pub f64);

/// A number above 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Positive(pub f64);

/// A focal length, pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Focal(pub f64);

/// A number of at least 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct NotNegative(pub f64);

/// A latency in nanoseconds, written in seconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Latency(pub i64);

/// A whole number of at most [`MAX_COUNT`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Count(pub u32);

struct NumberVisitor(&'static str);

impl Visitor<'_> for NumberVisitor {
    type Value = f64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }

    fn visit_f64<E>(self, value: f64) -> Result<f64, E> {
        Ok(value)
    }

    fn visit_u64<E>(self, value: u64) -> Result<f64, E> {
        Ok(value as f64)
    }

    fn visit_i64<E>(self, value: i64) -> Result<f64, E> {
        Ok(value as f64)
    }
}

/// Reads a finite number of at most [`MAX_MAGNITUDE`] that passes `check`.
fn number<'de, D: Deserializer<'de>>(
    from: D,
    expected: &'static str,
    check: fn(f64) -> bool,
) -> Result<f64, D::Error> {
    let value = from.deserialize_f64(NumberVisitor(expected))?;
    if value.abs() <= MAX_MAGNITUDE && check(value) {
        return Ok(value);
    }
    Err(D::Error::invalid_value(Unexpected::Float(value), &expected))
}

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        number(from, "a number between -1e6 and 1e6", |_| true).map(Self)
    }
}

impl<'de> Deserialize<'de> for Positive {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        number(from, "a number above 0 (and at most 1e6)", |x| x > 0.0).map(Self)
    }
}

impl<'de> Deserialize<'de> for Focal {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        number(from, "a focal length from 1 to 1e6 pixels", |x| x >= 1.0).map(Self)
    }
}

impl<'de> Deserialize<'de> for NotNegative {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        number(from, "a number of at least 0 (and at most 1e6)", |x| {
            x >= 0.0
        })
        .map(Self)
    }
}

impl<'de> Deserialize<'de> for Latency {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let possible = |s: f64| s.abs() <= MAX_LATENCY_SECONDS;
        let seconds = number(from, "seconds, at most 10", possible)?;
        Ok(Self((seconds * 1e9).round() as i64))
    }
}

struct CountVisitor;

impl Visitor<'_> for CountVisitor {
    type Value = Count;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a whole number between 0 and {MAX_COUNT}")
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Count, E> {
        match u32::try_from(value) {
            Ok(count) if value <= MAX_COUNT => Ok(Count(count)),
            _ => Err(E::invalid_value(Unexpected::Unsigned(value), &self)),
        }
    }
}

impl<'de> Deserialize<'de> for Count {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_u64(CountVisitor)
    }
}

/// A list of `MIN` to `MAX` entries. Reading stops at the first entry too many.
#[derive(Clone, Debug)]
pub(super) struct List<T, const MIN: usize, const MAX: usize>(pub Vec<T>);

struct ListVisitor<T, const MIN: usize, const MAX: usize>(PhantomData<T>);

impl<'de, T: Deserialize<'de>, const MIN: usize, const MAX: usize> Visitor<'de>
    for ListVisitor<T, MIN, MAX>
{
    type Value = List<T, MIN, MAX>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if MIN == MAX {
            write!(f, "a list of {MAX} entries")
        } else if MIN == 0 {
            write!(f, "a list of at most {MAX} entries")
        } else {
            write!(f, "a list of {MIN} to {MAX} entries")
        }
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut from: A) -> Result<Self::Value, A::Error> {
        let mut entries = Vec::new();
        while entries.len() < MAX {
            match from.next_element()? {
                Some(entry) => entries.push(entry),
                None if entries.len() < MIN => {
                    return Err(A::Error::invalid_length(entries.len(), &self));
                }
                None => return Ok(List(entries)),
            }
        }
        match from.next_element::<IgnoredAny>()? {
            Some(_) => Err(A::Error::invalid_length(MAX + 1, &self)),
            None => Ok(List(entries)),
        }
    }
}

impl<'de, T: Deserialize<'de>, const MIN: usize, const MAX: usize> Deserialize<'de>
    for List<T, MIN, MAX>
{
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_seq(ListVisitor(PhantomData))
    }
}

impl<T, const MIN: usize, const MAX: usize> Default for List<T, MIN, MAX> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

/// A list of `N` entries.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "List<T, N, N>", bound(deserialize = "T: Deserialize<'de>"))]
pub(super) struct Array<T, const N: usize>(pub [T; N]);

impl<T, const N: usize> TryFrom<List<T, N, N>> for Array<T, N> {
    type Error = String;

    fn try_from(list: List<T, N, N>) -> Result<Self, String> {
        let entries = list.0.try_into();
        entries
            .map(Self)
            .map_err(|_| format!("must be a list of {N} entries"))
    }
}

impl<const N: usize> Array<Number, N> {
    fn numbers(self) -> [f64; N] {
        self.0.map(|n| n.0)
    }
}

/// A point or displacement, metres.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(from = "Array<Number, 3>")]
pub(super) struct Vector(pub DVec3);

impl From<Array<Number, 3>> for Vector {
    fn from(xyz: Array<Number, 3>) -> Self {
        Self(DVec3::from(xyz.numbers()))
    }
}

/// A unit vector; written with any length other than 0.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Vector")]
pub(super) struct Direction(pub DVec3);

impl TryFrom<Vector> for Direction {
    type Error = &'static str;

    fn try_from(vector: Vector) -> Result<Self, Self::Error> {
        let unit = vector.0.try_normalize();
        unit.map(Self)
            .ok_or("must be a direction other than 0, 0, 0")
    }
}

/// Linear RGB, each at least 0.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Array<Number, 3>")]
pub(super) struct Colour(pub [f32; 3]);

impl TryFrom<Array<Number, 3>> for Colour {
    type Error = &'static str;

    fn try_from(rgb: Array<Number, 3>) -> Result<Self, Self::Error> {
        let rgb = rgb.numbers();
        if rgb.iter().any(|c| *c < 0.0) {
            return Err("must be three numbers, each at least 0");
        }
        Ok(Self(rgb.map(|c| c as f32)))
    }
}

/// Linear diffuse reflectance, each channel from 0 to 1.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Colour")]
pub(super) struct Albedo(pub [f32; 3]);

impl TryFrom<Colour> for Albedo {
    type Error = &'static str;

    fn try_from(rgb: Colour) -> Result<Self, Self::Error> {
        if rgb.0.iter().any(|c| *c > 1.0) {
            return Err("must be three numbers between 0 and 1");
        }
        Ok(Self(rgb.0))
    }
}

/// Width and height, pixels.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Array<Count, 2>")]
pub(super) struct ImageSize(pub (u32, u32));

impl TryFrom<Array<Count, 2>> for ImageSize {
    type Error = &'static str;

    fn try_from(size: Array<Count, 2>) -> Result<Self, Self::Error> {
        match size.0 {
            [Count(0), _] | [_, Count(0)] => Err("must be [width, height], both above 0"),
            [Count(width), Count(height)] => Ok(Self((width, height))),
        }
    }
}

/// A camera matrix: focal lengths and principal point, pixels.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Array<Array<Number, 3>, 3>")]
pub(super) struct CameraMatrix {
    pub focal: DVec2,
    pub centre: DVec2,
}

impl TryFrom<Array<Array<Number, 3>, 3>> for CameraMatrix {
    type Error = &'static str;

    fn try_from(rows: Array<Array<Number, 3>, 3>) -> Result<Self, Self::Error> {
        match rows.0.map(Array::numbers) {
            [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]] if fx >= 1.0 && fy >= 1.0 => Ok(Self {
                focal: DVec2::new(fx, fy),
                centre: DVec2::new(cx, cy),
            }),
            _ => Err(
                "must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels, with fx and fy from 1 to 1e6",
            ),
        }
    }
}

/// An invertible affine matrix, written row by row.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Array<Array<Number, 4>, 4>")]
struct Affine(DMat4);

impl TryFrom<Array<Array<Number, 4>, 4>> for Affine {
    type Error = &'static str;

    fn try_from(rows: Array<Array<Number, 4>, 4>) -> Result<Self, Self::Error> {
        let [x, y, z, last] = rows.0.map(|row| DVec4::from(row.numbers()));
        let matrix = DMat4::from_cols(x, y, z, last).transpose();
        if last != DVec4::W || matrix.determinant().abs() < 1e-12 {
            return Err("must be an invertible 4x4 matrix, row by row, whose last row is 0 0 0 1");
        }
        Ok(Self(matrix))
    }
}

/// A rotation, written w, x, y, z.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Array<Number, 4>")]
struct UnitQuaternion(DQuat);

impl TryFrom<Array<Number, 4>> for UnitQuaternion {
    type Error = &'static str;

    fn try_from(wxyz: Array<Number, 4>) -> Result<Self, Self::Error> {
        let [w, x, y, z] = wxyz.numbers();
        let rotation = DQuat::from_xyzw(x, y, z, w);
        if (rotation.length() - 1.0).abs() > ROTATION_TOLERANCE {
            return Err("must be a unit quaternion w, x, y, z");
        }
        Ok(Self(rotation.normalize()))
    }
}

#[derive(Deserialize)]
#[serde(expecting = "an object with matrix_row_major, or position and quaternion_wxyz")]
struct PlacementFields {
    matrix_row_major: Option<Affine>,
    position: Option<Vector>,
    quaternion_wxyz: Option<UnitQuaternion>,
}

/// An affine placement: `matrix_row_major`, or `position` with `quaternion_wxyz`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "PlacementFields")]
pub(super) struct Placement(pub DMat4);

impl TryFrom<PlacementFields> for Placement {
    type Error = FieldError;

    fn try_from(fields: PlacementFields) -> Result<Self, FieldError> {
        if let Some(Affine(matrix)) = fields.matrix_row_major {
            return match contradiction(&matrix, fields.position, fields.quaternion_wxyz) {
                Some(key) => Err(FieldError::custom(format_args!(
                    "matrix_row_major and {key} contradict each other; remove one of them"
                ))),
                None => Ok(Self(matrix)),
            };
        }
        let missing = FieldError::missing_field;
        let Vector(position) = fields.position.ok_or_else(|| missing("position"))?;
        let rotation = fields
            .quaternion_wxyz
            .ok_or_else(|| missing("quaternion_wxyz"))?;
        Ok(Self(DMat4::from_rotation_translation(rotation.0, position)))
    }
}

/// Returns the key that states another placement than the matrix, beyond the rounding of digits.
fn contradiction(
    matrix: &DMat4,
    position: Option<Vector>,
    rotation: Option<UnitQuaternion>,
) -> Option<&'static str> {
    let stated = matrix.w_axis.truncate();
    if position.is_some_and(|p| p.0.distance(stated) > ROTATION_TOLERANCE) {
        return Some("position");
    }
    // The axes of an object may be scaled.
    let axes = DMat3::from_mat4(*matrix);
    let differs = |UnitQuaternion(rotation): UnitQuaternion| {
        let columns = [axes.x_axis, axes.y_axis, axes.z_axis];
        let turned = DMat3::from_quat(rotation);
        let turned = [turned.x_axis, turned.y_axis, turned.z_axis];
        let mut pairs = columns.into_iter().zip(turned);
        pairs.any(|(column, axis)| column.normalize_or_zero().distance(axis) > ROTATION_TOLERANCE)
    };
    rotation.is_some_and(differs).then_some("quaternion_wxyz")
}

/// A placement without scale or mirroring.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Placement")]
pub(super) struct Pose(pub RigidTransform);

impl TryFrom<Placement> for Pose {
    type Error = &'static str;

    fn try_from(placement: Placement) -> Result<Self, Self::Error> {
        let matrix = DMat3::from_mat4(placement.0);
        let error = matrix * matrix.transpose() - DMat3::IDENTITY;
        let worst = error
            .to_cols_array()
            .into_iter()
            .fold(0.0, |a: f64, x| a.max(x.abs()));
        if worst > ROTATION_TOLERANCE || matrix.determinant() < 0.0 {
            return Err("must be a rotation and a translation (no scale, no mirroring)");
        }
        let rotation = DQuat::from_mat3(&matrix).normalize();
        Ok(Self(RigidTransform::new(
            rotation,
            placement.0.w_axis.truncate(),
        )))
    }
}
