//! Typed access to a document, with the path and line of each value for messages.

use super::yaml::{Kind, Value};
use super::{FormatError, Result};
use glam::DVec2;
use penumbra_camera::{Lens, LensModel};

/// Maximum magnitude of a camera parameter.
const MAX_PARAMETER: f64 = 1e6;
/// Maximum width and height, pixels.
const MAX_PIXELS: f64 = 65_536.0;

/// A mapping of the document and its path from the root.
pub(super) struct Fields<'a> {
    entries: &'a [(String, Value)],
    path: String,
}

impl<'a> Fields<'a> {
    pub fn root(value: &'a Value) -> Result<Self> {
        match &value.kind {
            Kind::Map(entries) => Ok(Self {
                entries,
                path: String::new(),
            }),
            _ => Err(FormatError::Unknown),
        }
    }

    pub fn keys(&self) -> impl Iterator<Item = &'a str> + use<'a> {
        self.entries.iter().map(|(key, _)| key.as_str())
    }

    pub fn find(&self, key: &str) -> Option<&'a Value> {
        self.entries.iter().find(|(k, _)| k == key).map(|(_, v)| v)
    }

    fn key(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    fn required(&self, key: &str, expected: &'static str) -> Result<&'a Value> {
        self.find(key).ok_or_else(|| FormatError::Missing {
            key: self.key(key),
            expected,
        })
    }

    pub fn wrong(&self, key: &str, expected: &'static str) -> FormatError {
        FormatError::Wrong {
            line: self.find(key).map_or(0, |v| v.line),
            key: self.key(key),
            expected,
        }
    }

    pub fn map(&self, key: &str, expected: &'static str) -> Result<Self> {
        match &self.required(key, expected)?.kind {
            Kind::Map(entries) => Ok(Self {
                entries,
                path: self.key(key),
            }),
            _ => Err(self.wrong(key, expected)),
        }
    }

    pub fn text(&self, key: &str, expected: &'static str) -> Result<&'a str> {
        match &self.required(key, expected)?.kind {
            Kind::Scalar(text) => Ok(text),
            _ => Err(self.wrong(key, expected)),
        }
    }

    pub fn numbers(&self, key: &str, expected: &'static str) -> Result<Vec<f64>> {
        let Kind::List(values) = &self.required(key, expected)?.kind else {
            return Err(self.wrong(key, expected));
        };
        let number = |v: &Value| match &v.kind {
            Kind::Scalar(text) => text.parse().ok().filter(|x: &f64| x.abs() <= MAX_PARAMETER),
            _ => None,
        };
        values
            .iter()
            .map(|v| number(v).ok_or_else(|| self.wrong(key, expected)))
            .collect()
    }

    pub fn pixels(&self, key: &str) -> Result<u32> {
        const EXPECTED: &str = "an integer number of pixels, 1 to 65536";
        let text = self.text(key, EXPECTED)?;
        // OpenCV sometimes writes integers as `640.`.
        let value: f64 = text.parse().map_err(|_| self.wrong(key, EXPECTED))?;
        let is_valid = (1.0..=MAX_PIXELS).contains(&value) && value.fract() == 0.0;
        is_valid
            .then_some(value as u32)
            .ok_or_else(|| self.wrong(key, EXPECTED))
    }

    /// Returns the numbers of a matrix `{rows, cols, data}`.
    pub fn matrix(&self, key: &str) -> Result<Vec<f64>> {
        const EXPECTED: &str = "a matrix with rows, cols and data";
        let matrix = self.map(key, EXPECTED)?;
        let data = matrix.numbers("data", "a list of numbers")?;
        let count = matrix.pixels("rows")? * matrix.pixels("cols")?.min(1000);
        if data.len() == count as usize {
            Ok(data)
        } else {
            Err(matrix.wrong("data", "a list of rows × cols numbers"))
        }
    }

    /// Returns the lens of a 3×3 camera matrix, without distortion.
    pub fn lens(&self, key: &str, size: (u32, u32)) -> Result<Lens> {
        let wrong = || {
            self.wrong(
                key,
                "fx, 0, cx, 0, fy, cy, 0, 0, 1 with fx and fy from 1 to 1e6 pixels",
            )
        };
        let k: [f64; 9] = self.matrix(key)?.try_into().map_err(|_| wrong())?;
        let [fx, skew, cx, zero, fy, cy, ..] = k;
        let is_focal = |f: f64| (1.0..=1e6).contains(&f);
        if !is_focal(fx) || !is_focal(fy) || skew != 0.0 || zero != 0.0 || k[6..] != [0.0, 0.0, 1.0]
        {
            return Err(wrong());
        }
        Ok(Lens::ideal(
            LensModel::Brown,
            size,
            DVec2::new(fx, fy),
            DVec2::new(cx, cy),
        ))
    }
}
