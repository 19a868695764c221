//! All protocols under one type, by the names under which sessions keep them.

use crate::{Decoder, Framing, Verdict, csv, fastrak, flock, freed, liberty, vrpn};

/// How a tracker's bytes are spelled, whatever the tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Format {
    /// Polhemus FASTRAK.
    Fastrak(fastrak::Format),
    /// Polhemus Liberty and Patriot.
    Liberty(liberty::Format),
    /// Ascension Flock of Birds.
    Flock(flock::Format),
    /// FreeD D1.
    Freed(freed::Format),
    /// Penumbra's line protocol for home-made trackers.
    Csv(csv::Format),
    /// `Pos_Quat` messages of a VRPN server.
    Vrpn(vrpn::Format),
}

/// A decoder of any protocol.
pub type AnyDecoder = Decoder<Format>;

/// Every protocol name, for messages and for asking a port. `freed` may be followed by the
/// meaning of its numbers, see [`freed::Axes`]: `freed:-tilt,pan,roll,z,y,x`.
pub const PROTOCOLS: [&str; 18] = [
    "fastrak",
    "fastrak-ascii-quaternion",
    "fastrak-ascii-extended-euler",
    "fastrak-ascii-extended-quaternion",
    "fastrak-binary-euler",
    "fastrak-binary-quaternion",
    "liberty",
    "liberty-euler",
    "flock",
    "flock-inverted",
    "flock-angles",
    "flock-group",
    "flock-group-inverted",
    "flock-angles-group",
    "patriot",
    "freed",
    "csv",
    "vrpn",
];

impl Format {
    /// The format that a protocol name stands for, with the protocol's usual units. `None`
    /// for a name that is not in [`PROTOCOLS`].
    #[must_use]
    pub fn for_protocol(name: &str) -> Option<Self> {
        let flock = |angles, group, inverted| {
            Self::Flock(flock::Format {
                angles,
                group,
                inverted,
                ..flock::Format::default()
            })
        };
        Some(match name {
            "liberty" | "patriot" => Self::Liberty(liberty::Format::default()),
            "liberty-euler" => Self::Liberty(liberty::Format {
                euler: true,
                ..liberty::Format::default()
            }),
            "flock" => flock(false, false, false),
            "flock-inverted" => flock(false, false, true),
            "flock-angles" => flock(true, false, false),
            "flock-group" => flock(false, true, false),
            "flock-group-inverted" => flock(false, true, true),
            "flock-angles-group" => flock(true, true, false),
            "csv" => Self::Csv(csv::Format::default()),
            "vrpn" => Self::Vrpn(vrpn::Format::default()),
            _ => {
                return fastrak::Format::for_protocol(name)
                    .map(Self::Fastrak)
                    .or_else(|| freed_format(name));
            }
        })
    }

    /// With another length of the device's unit, where the device has a choice of units
    /// (FASTRAK, Liberty, Flock of Birds). FreeD, CSV and VRPN have one unit each, by their
    /// specification, and keep it.
    #[must_use]
    pub fn with_metres_per_unit(mut self, metres: f64) -> Self {
        match &mut self {
            Self::Fastrak(format) => format.metres_per_unit = metres,
            Self::Liberty(format) => format.metres_per_unit = metres,
            Self::Flock(format) => format.metres_per_unit = metres,
            Self::Freed(_) | Self::Csv(_) | Self::Vrpn(_) => {}
        }
        self
    }
}

fn freed_format(name: &str) -> Option<Format> {
    let axes = match name.strip_prefix("freed")? {
        "" => freed::Axes::default(),
        axes => freed::Axes::parse(axes.strip_prefix(':')?)?,
    };
    Some(Format::Freed(freed::Format {
        axes,
        ..freed::Format::default()
    }))
}

impl Default for Format {
    /// A FASTRAK as it leaves the factory.
    fn default() -> Self {
        Self::Fastrak(fastrak::Format::default())
    }
}

impl Framing for Format {
    fn judge(&self, before: Option<u8>, bytes: &[u8]) -> Verdict {
        match self {
            Self::Fastrak(format) => format.judge(before, bytes),
            Self::Liberty(format) => format.judge(before, bytes),
            Self::Flock(format) => format.judge(before, bytes),
            Self::Freed(format) => format.judge(before, bytes),
            Self::Csv(format) => format.judge(before, bytes),
            Self::Vrpn(format) => format.judge(before, bytes),
        }
    }
}

impl AnyDecoder {
    /// A decoder for a protocol's name, with the protocol's usual units; `None` for a name
    /// that is not in [`PROTOCOLS`]. Behind the name may stand the line's speed,
    /// `fastrak@115200`, by which arrival times are corrected: see [`Decoder::with_baud`].
    ///
    /// [`Decoder::with_baud`]: crate::Decoder::with_baud
    #[must_use]
    pub fn for_protocol(name: &str) -> Option<Self> {
        let (name, baud) = match name.split_once('@') {
            Some((name, baud)) => (name, Some(baud.parse().ok()?)),
            None => (name, None),
        };
        let decoder = Self::new(Format::for_protocol(name)?);
        Some(match baud {
            Some(baud) => decoder.with_baud(baud),
            None => decoder,
        })
    }

    /// With another length of the device's unit, see [`Format::with_metres_per_unit`].
    #[must_use]
    pub fn with_metres_per_unit(mut self, metres: f64) -> Self {
        self.set_format(self.format().with_metres_per_unit(metres));
        self
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn every_listed_protocol_is_known() {
        for name in PROTOCOLS {
            assert!(Format::for_protocol(name).is_some(), "{name}");
        }
        for name in ["", "freed:", "freed:pan", "freedom", "polaris", "FASTRAK"] {
            assert_eq!(Format::for_protocol(name), None, "{name}");
        }
    }

    #[test]
    fn a_line_speed_corrects_arrival_times() {
        let arrival = |name: &str| {
            let mut decoder = AnyDecoder::for_protocol(name).unwrap();
            let mut first = None;
            let bytes = b"1,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0\n";
            let now = penumbra_interface::MonotonicTime::from_nanos(1_000_000_000);
            decoder.push(bytes, now, |pose| first = first.or(Some(pose.arrived_at)));
            now.nanos_since(first.unwrap())
        };
        assert_eq!(arrival("csv"), 0);
        // The first line may have begun before we listened; after the second, 16 bytes of ten
        // bits come.
        let late = arrival("csv@9600");
        assert!((late - 16_666_667).abs() < 1000, "{late}");
        assert!(AnyDecoder::for_protocol("csv@fast").is_none());
    }

    #[test]
    fn protocols_of_one_unit_keep_it() {
        for name in ["freed", "csv", "vrpn"] {
            let format = Format::for_protocol(name).unwrap();
            assert_eq!(format.with_metres_per_unit(0.0254), format, "{name}");
        }
        let Format::Liberty(format) = Format::for_protocol("liberty")
            .unwrap()
            .with_metres_per_unit(0.01)
        else {
            unreachable!()
        };
        assert!((format.metres_per_unit - 0.01).abs() < 1e-12);
    }
}
