//! Tone curves: from a camera's 8-bit codes to linear radiance and back.

use serde::de::{Error as _, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;
use thiserror::Error;

/// A camera's tone curve, equal for all channels: codes 0..=255 to linear 0..=1.
///
/// In a configuration: `"srgb"`, `"linear"`, a gamma such as `2.2`, or a table of 256 ascending
/// linear values.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    linear_from_code: [f32; 256],
    /// `boundary[i]`: linear value between the codes `i` and `i + 1`; ascending.
    boundary: [f32; 255],
}

/// An invalid tone curve.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ResponseError {
    /// An unknown name.
    #[error("response \"{0}\" is unknown; write \"srgb\", \"linear\", a gamma or a table")]
    UnknownName(String),
    /// A gamma out of range.
    #[error("response gamma {0} is out of range; write one from 0.2 to 5")]
    Gamma(f64),
    /// A table whose length is not 256.
    #[error("response table has {0} values; write 256, one for each code")]
    Length(usize),
    /// A table value outside 0..=1.
    #[error("response table holds {value} for code {code}; write values from 0 to 1")]
    Value {
        /// Index in the table.
        code: usize,
        /// Value in the table.
        value: f32,
    },
    /// A table that does not strictly ascend and cannot be inverted.
    #[error("response table does not rise from code {0} to the next; make it ascend")]
    NotAscending(usize),
}

impl Response {
    /// sRGB (IEC 61966-2-1), which most webcams approximate.
    #[must_use]
    pub fn srgb() -> Self {
        Self::from_curve(linear_from_srgb)
    }

    /// Linear codes.
    #[must_use]
    pub fn linear() -> Self {
        Self::from_curve(|code| code)
    }

    /// A power: `linear = code^gamma`, code 0..=1. Use [`Self::try_gamma`] for a gamma that a user
    /// writes.
    #[must_use]
    pub fn gamma(gamma: f32) -> Self {
        Self::from_curve(|code| code.powf(gamma))
    }

    /// A power with an exponent from 0.2 to 5.
    ///
    /// # Errors
    /// The exponent is out of range.
    pub fn try_gamma(gamma: f64) -> Result<Self, ResponseError> {
        if !(0.2..=5.0).contains(&gamma) {
            return Err(ResponseError::Gamma(gamma));
        }
        Ok(Self::gamma(gamma as f32))
    }

    /// A measured curve: 256 linear values, strictly ascending within 0..=1.
    ///
    /// # Errors
    /// The table has another length, holds a value out of range or does not ascend.
    pub fn from_table(linear_from_code: &[f32]) -> Result<Self, ResponseError> {
        let table: [f32; 256] = linear_from_code
            .try_into()
            .map_err(|_| ResponseError::Length(linear_from_code.len()))?;
        let outside = |&(_, value): &(usize, f32)| !(0.0..=1.0).contains(&value);
        if let Some((code, value)) = table.into_iter().enumerate().find(outside) {
            return Err(ResponseError::Value { code, value });
        }
        if let Some(code) = table.array_windows().position(|[a, b]| a >= b) {
            return Err(ResponseError::NotAscending(code));
        }
        let boundary = std::array::from_fn(|i| 0.5 * (table[i] + table[i + 1]));
        Ok(Self {
            linear_from_code: table,
            boundary,
        })
    }

    /// Returns the curve of a name in a configuration: `srgb` or `linear`.
    ///
    /// # Errors
    /// The name is unknown.
    pub fn from_name(name: &str) -> Result<Self, ResponseError> {
        match name {
            "srgb" | "sRGB" => Ok(Self::srgb()),
            "linear" => Ok(Self::linear()),
            _ => Err(ResponseError::UnknownName(name.to_owned())),
        }
    }

    fn from_curve(linear_from_encoded: impl Fn(f32) -> f32) -> Self {
        Self {
            linear_from_code: std::array::from_fn(|i| linear_from_encoded(i as f32 / 255.0)),
            boundary: std::array::from_fn(|i| linear_from_encoded((i as f32 + 0.5) / 255.0)),
        }
    }

    /// Linear value of each code, ascending.
    #[must_use]
    pub const fn linear_from_code(&self) -> &[f32; 256] {
        &self.linear_from_code
    }

    /// Linear value of one pixel.
    #[must_use]
    pub fn linear_from_rgb(&self, codes: [u8; 3]) -> [f32; 3] {
        codes.map(|code| self.linear_from_code[usize::from(code)])
    }

    /// Returns the code whose encoded value is nearest to `linear`, as the camera would encode it.
    /// Maps the linear value of each code back to that code; clamps outside 0..=1; NaN gives 0.
    #[must_use]
    pub fn code_from_linear(&self, linear: f32) -> u8 {
        self.boundary.partition_point(|&end| end <= linear) as u8
    }

    /// Encodes `linear` to 0..=1 without rounding to a code, by linear interpolation between codes.
    #[must_use]
    pub fn encoded_from_linear(&self, linear: f32) -> f32 {
        let table = &self.linear_from_code;
        let above = table.partition_point(|&value| value <= linear);
        if above == 0 || above == 256 {
            return if above == 0 { 0.0 } else { 1.0 };
        }
        let (low, high) = (table[above - 1], table[above]);
        (above as f32 - 1.0 + (linear - low) / (high - low)) / 255.0
    }

    /// Change of the linear value per code at `code`.
    #[must_use]
    pub fn step(&self, code: u8) -> f32 {
        let low = usize::from(code.max(1)) - 1;
        let high = usize::from(code.min(254)) + 1;
        (self.linear_from_code[high] - self.linear_from_code[low]) / (high - low) as f32
    }
}

impl<'de> Deserialize<'de> for Response {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ResponseVisitor)
    }
}

struct ResponseVisitor;

impl<'de> Visitor<'de> for ResponseVisitor {
    type Value = Response;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("\"srgb\", \"linear\", a gamma such as 2.2, or a table of 256 linear values")
    }

    fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<Response, E> {
        Response::from_name(name).map_err(E::custom)
    }

    fn visit_f64<E: serde::de::Error>(self, gamma: f64) -> Result<Response, E> {
        Response::try_gamma(gamma).map_err(E::custom)
    }

    fn visit_i64<E: serde::de::Error>(self, gamma: i64) -> Result<Response, E> {
        self.visit_f64(gamma as f64)
    }

    fn visit_u64<E: serde::de::Error>(self, gamma: u64) -> Result<Response, E> {
        self.visit_f64(gamma as f64)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut values: A) -> Result<Response, A::Error> {
        let mut table = Vec::with_capacity(256);
        while let Some(value) = values.next_element()? {
            table.push(value);
            if table.len() > 256 {
                break;
            }
        }
        Response::from_table(&table).map_err(A::Error::custom)
    }
}

/// sRGB decoding (IEC 61966-2-1), 0..=1 to 0..=1.
#[must_use]
pub fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.040_45 {
        encoded / 12.92
    } else {
        ((encoded + 0.055) / 1.055).powf(2.4)
    }
}

/// sRGB encoding (IEC 61966-2-1), clamped to 0..=1.
#[must_use]
pub fn srgb_from_linear(linear: f32) -> f32 {
    let x = linear.clamp(0.0, 1.0);
    if x <= 0.003_130_8 {
        x * 12.92
    } else {
        1.055 * x.powf(1.0 / 2.4) - 0.055
    }
}

#[cfg(test)]
mod tests {

    use super::*;
    use proptest::prelude::*;

    fn curves() -> Vec<Response> {
        let table: Vec<f32> = (0..256).map(|i| (i as f32 / 255.0).powf(1.7)).collect();
        vec![
            Response::srgb(),
            Response::linear(),
            Response::gamma(2.2),
            Response::gamma(0.2),
            Response::gamma(5.0),
            Response::from_table(&table).unwrap(),
        ]
    }

    #[test]
    fn code_from_linear_inverts_linear_from_code() {
        for response in curves() {
            for code in 0..=255u8 {
                let linear = response.linear_from_code()[usize::from(code)];
                assert_eq!(response.code_from_linear(linear), code, "{linear}");
                let encoded = response.encoded_from_linear(linear);
                assert!((encoded * 255.0 - f32::from(code)).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn clamps_values_out_of_range() {
        for response in curves() {
            assert_eq!(response.code_from_linear(-1.0), 0);
            assert_eq!(response.code_from_linear(7.0), 255);
            assert_eq!(response.code_from_linear(f32::INFINITY), 255);
            assert_eq!(response.code_from_linear(f32::NAN), 0);
            assert_eq!(response.encoded_from_linear(7.0), 1.0);
            assert_eq!(response.encoded_from_linear(-7.0), 0.0);
        }
    }

    #[test]
    fn step_is_the_slope_of_the_curve() {
        let linear = Response::linear();
        for code in [0u8, 1, 128, 255] {
            assert!((linear.step(code) - 1.0 / 255.0).abs() < 1e-6);
        }
        assert!(Response::srgb().step(250) > 5.0 * Response::srgb().step(10));
    }

    #[test]
    fn reads_name_gamma_and_table() {
        let read = |json: &str| serde_json::from_str::<Response>(json);
        assert_eq!(read("\"srgb\"").unwrap(), Response::srgb());
        assert_eq!(read("\"linear\"").unwrap(), Response::linear());
        assert_eq!(read("2.2").unwrap(), Response::gamma(2.2));
        assert_eq!(read("1").unwrap(), Response::linear());
        let table: Vec<f32> = (0..256).map(|i| i as f32 / 255.0).collect();
        let text = serde_json::to_string(&table).unwrap();
        assert_eq!(
            read(&text).unwrap().linear_from_code(),
            Response::linear().linear_from_code()
        );
        let toml: std::collections::BTreeMap<String, Response> =
            toml::from_str("a = \"srgb\"\nb = 2\n").unwrap();
        assert_eq!(toml["b"], Response::gamma(2.0));
    }

    #[test]
    fn rejects_invalid_curves_with_the_reason() {
        let text = |json: &str| {
            serde_json::from_str::<Response>(json)
                .unwrap_err()
                .to_string()
        };
        assert!(text("\"rec709\"").contains("\"rec709\" is unknown"));
        assert!(text("-2.2").contains("out of range"));
        assert!(text("9").contains("out of range"));
        assert!(text("[0.0, 1.0]").contains("has 2 values"));
        assert!(text("true").contains("a gamma such as 2.2"));
        let mut table: Vec<f32> = (0..256).map(|i| i as f32 / 255.0).collect();
        table[9] = table[8];
        assert_eq!(
            Response::from_table(&table),
            Err(ResponseError::NotAscending(8))
        );
        table[9] = f32::NAN;
        assert!(matches!(
            Response::from_table(&table),
            Err(ResponseError::Value { code: 9, .. })
        ));
    }

    proptest! {
        #[test]
        fn srgb_rounds_to_the_nearest_code(linear in 0.0f32..1.0) {
            let exact = 255.0 * srgb_from_linear(linear);
            // Not at a tie, where the rounding of the two powers decides.
            prop_assume!((exact.fract() - 0.5).abs() > 1e-3);
            prop_assert_eq!(Response::srgb().code_from_linear(linear), exact.round() as u8);
        }

        #[test]
        fn any_ascending_table_round_trips(steps in prop::collection::vec(0.01f32..1.0, 256)) {
            let total: f32 = steps.iter().sum();
            let table: Vec<f32> = steps.iter().scan(0.0, |sum, step| {
                *sum += step;
                Some((*sum / total).min(1.0))
            }).collect();
            let response = Response::from_table(&table).unwrap();
            for code in 0..=255u8 {
                prop_assert_eq!(response.code_from_linear(table[usize::from(code)]), code);
            }
        }
    }
}
