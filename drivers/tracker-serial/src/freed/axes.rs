//! The order of the six numbers in a D1 message.

use std::fmt;

const NAMES: [&str; 6] = ["pan", "tilt", "roll", "x", "y", "z"];

/// Order and signs of the six numbers in a message.
///
/// Written as in `pan,tilt,roll,x,y,z`, the manual's order and the default: the quantity in
/// each field of the message, with `-` where its sign is reversed. The first three fields are
/// angles, the others are positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    /// For pan, tilt, roll, x, y, z: the field of the message and the sign.
    fields: [(usize, f64); 6],
}

impl Default for Axes {
    fn default() -> Self {
        Self {
            fields: [0, 1, 2, 3, 4, 5].map(|field| (field, 1.0)),
        }
    }
}

impl Axes {
    /// Parses text such as `-tilt,pan,roll,z,y,x`. `None` if a quantity is missing or unknown,
    /// or an angle is in the field of a position.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut fields = [None; 6];
        for (field, word) in text.split(',').map(str::trim).enumerate() {
            let (name, sign) = match word.strip_prefix('-') {
                Some(name) => (name, -1.0),
                None => (word, 1.0),
            };
            let quantity = NAMES.iter().position(|known| *known == name)?;
            if field >= 6 || quantity / 3 != field / 3 {
                return None;
            }
            fields[quantity] = Some((field, sign));
        }
        let [Some(a), Some(b), Some(c), Some(d), Some(e), Some(f)] = fields else {
            return None;
        };
        Some(Self {
            fields: [a, b, c, d, e, f],
        })
    }

    /// Pan, tilt, roll, x, y, z from the numbers in the order of the message.
    pub(super) fn to_quantities(self, numbers: [f64; 6]) -> [f64; 6] {
        self.fields.map(|(field, sign)| sign * numbers[field])
    }

    /// The numbers in the order of the message from pan, tilt, roll, x, y, z.
    pub(super) fn to_fields(self, quantities: [f64; 6]) -> [f64; 6] {
        let mut numbers = [0.0; 6];
        for (quantity, (field, sign)) in quantities.into_iter().zip(self.fields) {
            numbers[field] = sign * quantity;
        }
        numbers
    }
}

impl fmt::Display for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for position in 0..6 {
            let mut quantities = self.fields.iter().zip(NAMES);
            let found = quantities.find(|((field, _), _)| *field == position);
            if let Some(((_, sign), name)) = found {
                let comma = if position > 0 { "," } else { "" };
                let minus = if *sign < 0.0 { "-" } else { "" };
                write!(f, "{comma}{minus}{name}")?;
            }
        }
        Ok(())
    }
}
