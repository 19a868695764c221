//! What the six numbers of a D1 message mean.

use std::fmt;

const NAMES: [&str; 6] = ["pan", "tilt", "roll", "x", "y", "z"];

/// Order and signs of a message's six numbers.
///
/// Written as in `pan,tilt,roll,x,y,z`, which is the manual's and the default: for each
/// place in the message the quantity that stands there, with `-` before it where it counts
/// the other way round. Angles stand in the first three places, positions in the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    /// For pan, tilt, roll, x, y, z: its place in the message and its sign.
    places: [(usize, f64); 6],
}

impl Default for Axes {
    fn default() -> Self {
        Self {
            places: [0, 1, 2, 3, 4, 5].map(|place| (place, 1.0)),
        }
    }
}

impl Axes {
    /// From text such as `-tilt,pan,roll,z,y,x`. `None` if a quantity is missing, unknown
    /// or on the other half's place.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut places = [None; 6];
        for (place, field) in text.split(',').enumerate() {
            let field = field.trim();
            let (name, sign) = match field.strip_prefix('-') {
                Some(name) => (name, -1.0),
                None => (field, 1.0),
            };
            let quantity = NAMES.iter().position(|known| *known == name)?;
            if place >= 6 || quantity / 3 != place / 3 {
                return None;
            }
            places[quantity] = Some((place, sign));
        }
        let [Some(a), Some(b), Some(c), Some(d), Some(e), Some(f)] = places else {
            return None;
        };
        Some(Self {
            places: [a, b, c, d, e, f],
        })
    }

    /// Pan, tilt, roll, x, y, z from the numbers in the message's order.
    pub(super) fn sorted(&self, numbers: [f64; 6]) -> [f64; 6] {
        self.places.map(|(place, sign)| sign * numbers[place])
    }

    /// The numbers in the message's order from pan, tilt, roll, x, y, z.
    pub(super) fn placed(&self, quantities: [f64; 6]) -> [f64; 6] {
        let mut numbers = [0.0; 6];
        for (quantity, (place, sign)) in quantities.into_iter().zip(self.places) {
            numbers[place] = sign * quantity;
        }
        numbers
    }
}

impl fmt::Display for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for place in 0..6 {
            let found = self
                .places
                .iter()
                .zip(NAMES)
                .find(|((p, _), _)| *p == place);
            if let Some(((_, sign), name)) = found {
                let comma = if place > 0 { "," } else { "" };
                let minus = if *sign < 0.0 { "-" } else { "" };
                write!(f, "{comma}{minus}{name}")?;
            }
        }
        Ok(())
    }
}
